import re

import numpy as np
import pytest

from papers import ipmc
from truth import hidden_truth


@pytest.fixture(scope="module")
def study():
    """The study at every other frequency."""
    with hidden_truth(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(ipmc, "FREQUENCIES", ipmc.FREQUENCIES[::2])
        return ipmc.run_study(3)


def test_the_two_densities_differ_between_the_levels_only(study):
    uniform, ours = (one.identification.model for one in (study.uniform, study.ours))
    np.testing.assert_allclose(uniform.weights, ours.weights, atol=1e-6)
    on_levels = study.uniform.voltages
    np.testing.assert_allclose(uniform.simulate(on_levels), ours.simulate(on_levels), atol=1e-6)
    assert study.figures()["positioning"]["between_levels"] > 0.05


@pytest.mark.usefixtures("without_pictures")
def test_the_report_shows_every_figure_of_the_paper(study):
    figures = study.figures()
    report = ipmc.STUDY.report(study, figures, [figures, figures])
    html = report.html()
    named = " ".join(re.findall(r"Figs? ([\d, to]+)", html))
    assert set(re.findall(r"\d+", named)) == {str(number) for number in range(4, 17)}
    assert html.count("<img") == 14
    assert "the strip is a twin" in html.lower()
    assert "gives the radius" in html
    first = report.sections[0]["table"]
    assert 5 <= len(first.rows) <= 10

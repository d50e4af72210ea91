import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop.studies.positioning import run_positioning
from minorloop.studies.positioning_report import positioning_report


def test_hysteresis_known_is_several_times_better_than_ignored():
    ratios = [run_positioning(seed).summary["rms_ratio"] for seed in range(20)]
    assert np.median(ratios) >= 5
    assert min(ratios) >= 3.3


def test_a_noisy_sensor_costs_some_of_it():
    ratios = [run_positioning(seed, noise=0.1).summary["rms_ratio"] for seed in range(5)]
    assert np.median(ratios) >= 4.5


def test_is_the_papers_experiment():
    result = run_positioning(3)
    assert result.summary["measurements"] == result.summary["unknowns"] == 56
    assert np.abs(result.targets).max() <= 7.5
    assert np.abs(result.quadratic.voltages).max() <= 1.2
    np.testing.assert_allclose(
        result.preisach.errors, result.preisach.achieved - result.targets, atol=1e-12
    )


def test_repeats_itself_by_seed():
    assert run_positioning(4, 0.1).summary == run_positioning(4, 0.1).summary
    assert run_positioning(4).summary != run_positioning(5).summary


def test_report_shows_every_figure():
    page = positioning_report(run_positioning(0)).html()
    assert page.count("data:image/svg+xml;base64,") == 6
    assert "figures are those of the twin" in page.replace("\n", " ")


@pytest.mark.parametrize("seed", [-1, 1.5, True])
def test_refuses_what_is_no_seed(seed):
    with pytest.raises(ParameterError, match="seed"):
        run_positioning(seed)

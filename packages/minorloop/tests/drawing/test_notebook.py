"""What a notebook shows of models and results."""

import re
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop.drawing import notebook
from minorloop.drawing.layout import new_figure
from minorloop.dynamics.linear import Linear
from minorloop.errors import ParameterError
from minorloop.figures import Drawn, plot
from minorloop.identification import Smooth
from minorloop.identification.bands import Prediction
from minorloop.identification.excitation import report
from minorloop.identification.frequency import FrequencyResponse
from minorloop.lab.records import Record
from minorloop.lab.reduction import reduce
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel
from minorloop.registry import registered

LEVELS = np.linspace(-1, 1, 5)
MODEL = Preisach(LEVELS, np.tril(np.ones((4, 4))))
U = np.array([-1.0, 0.6, -0.4, 1.0, -1.0, 0.1, -0.7, 0.9, -1.0])
Y = U + 0.3 * U**2
GAINS = np.array([[1.0, 0.5 - 0.5j]])


def a_reduction():
    u = np.repeat(U, 40)
    return reduce(Record(u, np.repeat(Y, 40), np.arange(u.size) * 0.1, "u [V]", "y [1/m]"))


RESULTS = {
    "Preisach": lambda: MODEL,
    "RelayModel": lambda: RelayModel.from_preisach(MODEL),
    "PrandtlIshlinskii": lambda: PrandtlIshlinskii([0.0, 0.4], [1.0, 2.0]),
    "GeneralisedPrandtlIshlinskii": lambda: GeneralisedPrandtlIshlinskii.fit(
        U, Y, radii=2, thresholds=2
    ),
    "Polynomial": lambda: Polynomial([0.0, 1.0, 0.5], -1, 1),
    "Inversion": lambda: MODEL.invert([0.0, 1.0]),
    "Identification": lambda: identify(U, Y, Plane(4), prior=Smooth(0.1)),
    "Prediction": lambda: Prediction(U, Y, np.full(U.size, 0.1), 0.9),
    "FrequencyResponse": lambda: FrequencyResponse(
        np.array([1.0, 2.0]), np.ones(1), 0.0, GAINS, GAINS, np.zeros((1, 2)), np.zeros((1, 2))
    ),
    "Linear": lambda: Linear([1.0], [0.5, 1.0]),
    "ExcitationReport": lambda: report(U, LEVELS),
    "Reduction": a_reduction,
}


@pytest.mark.parametrize("name", RESULTS)
def test_a_notebook_shows_a_figure_and_a_table(name):
    result = RESULTS[name]()
    assert type(result).__name__ == name
    html = result._repr_html_()
    assert f"<b>{name}</b>" in html
    assert "<td>" in html or "<pre>" in html
    assert 'src="data:image/png;base64,iVBOR' in html
    assert len(html) < 150_000


def subclasses(one):
    return [each for below in one.__subclasses__() for each in (below, *subclasses(below))]


def test_everything_that_can_be_drawn_is_shown():
    drawn = ("dynamics.cascade", "dynamics.creep", "scoring", "identification.linear_fit")
    drawn += ("identification.after_effect_result", "identification.oscillator_result")
    for name in drawn:
        import_module(f"minorloop.{name}")
    shown = {each.__name__ for each in subclasses(Drawn)}
    assert shown >= registered("minorloop.drawing").keys() - {"html"}


def test_a_subclass_is_drawn_as_its_class_and_anything_else_refused():
    class Special(Polynomial):
        pass

    assert len(plot(Special([0.0, 1.0], -1, 1)).axes) == 1
    with pytest.raises(ParameterError, match=r"int cannot be drawn; give one of AfterEffect, "):
        plot(3)


def test_the_table_of_an_identification_has_its_scores_and_advice():
    found = RESULTS["Identification"]()
    html = found._repr_html_()
    assert "<th>error on fitted data</th>" in html
    assert re.search(rf"<li>{re.escape(found.advice[0][:20])}", html)


def test_texts_of_a_result_are_no_html(monkeypatch):
    class Odd(Drawn):
        def summary(self):
            return [("<script>", "&")]

    monkeypatch.setattr(notebook, "plot", lambda result: new_figure()[0])
    assert "<tr><th>&lt;script&gt;</th><td>&amp;</td></tr>" in Odd()._repr_html_()


def test_nothing_heavy_is_imported_until_it_is_shown():
    code = (
        "import sys; from minorloop import Polynomial; Polynomial([0.0, 1.0], -1, 1); "
        "sys.exit('matplotlib' in sys.modules or 'minorloop.drawing' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0

import numpy as np

from minorloop.figures import plot
from minorloop.identification import Viscosity, identify
from minorloop.lab.records import Record
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.preisach import Preisach


def test_a_model_is_drawn_with_its_holds():
    plane = Preisach(np.linspace(-1, 1, 4), np.tril(np.ones((3, 3))))
    loop, holds = plot(AfterEffect(plane, 0.02, 5.0), input_label="field [T]").axes
    assert loop.get_xlabel() == "field [T]"
    assert len(holds.lines) == 3
    assert np.ptp(holds.lines[0].get_ydata()) > 0


def test_an_identification_is_drawn_with_its_laws():
    u = np.repeat(np.random.default_rng(1000).uniform(-1, 1, 20), 5)
    found = identify(Record(u, u, np.arange(100.0)), Viscosity(4, creep="none", rate=False))
    record, *_, laws = plot(found).axes
    assert record.get_xlabel() == "time [s]"
    assert [bar.get_height() for bar in laws.patches] == [100 * found.tried[0].error]

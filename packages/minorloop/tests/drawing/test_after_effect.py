import numpy as np

from minorloop import Record, Viscosity, identify, plot


def test_an_identification_is_drawn_with_its_laws():
    u = np.repeat(np.random.default_rng(1000).uniform(-1, 1, 20), 5)
    found = identify(Record(u, u, np.arange(100.0)), Viscosity(4, creep="none", rate=False))
    record, *_, laws = plot(found).axes
    assert record.get_xlabel() == "time [s]"
    assert [bar.get_height() for bar in laws.patches] == [100 * found.tried[0].error]

import numpy as np
import pytest

from fault_records import kinds, record
from minorloop.identification import identify
from minorloop.identification.curves import Curves
from minorloop.identification.screening import record_faults


@pytest.mark.parametrize("lag", [-4, 2, 5])
@pytest.mark.parametrize("shape", ["sine", "levels"])
def test_a_lag_is_named_until_the_model_has_it(shape, lag):
    u, y = record(shape)
    shifted = (
        np.r_[np.full(lag, y[0]), y[:-lag]] if lag > 0 else np.r_[y[-lag:], np.full(-lag, np.nan)]
    )
    (finding,) = record_faults(u, shifted, Curves.whole("negative"), 0)
    assert finding.kind == "lag"
    assert ("--lag auto" in finding.text) == (lag > 0)
    (finding,) = record_faults(u, shifted, Curves.whole("negative"), 0, searched=True)
    assert "--lag auto" not in finding.text
    if lag > 0:
        assert kinds(u, shifted, lag) == []


def test_a_filter_of_the_sensor_is_named_where_a_lag_does_not_replace_it():
    u, y = record()
    for k in range(1, y.size):
        y[k] = y[k - 1] + 0.2 * (y[k] - y[k - 1])
    found = identify(u, y, levels=12, lag="auto")
    assert found.lag > 0
    assert any("a filter of the sensor" in text for text in found.warnings)


def test_a_lag_as_long_as_the_record_leaves_nothing_to_screen():
    u = np.r_[np.zeros(60), 1.0]
    assert kinds(u, np.arange(61.0), 45) == []

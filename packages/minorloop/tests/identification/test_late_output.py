import numpy as np
import pytest

from fault_records import kinds, record
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
    assert ("--law lag=auto" in finding.remedy) == (lag > 0)
    (finding,) = record_faults(u, shifted, Curves.whole("negative"), 0, searched=True)
    assert "--law lag=auto" not in finding.remedy
    if lag > 0:
        assert kinds(u, shifted, lag) == []


def test_a_lag_as_long_as_the_record_leaves_nothing_to_screen():
    u = np.r_[np.zeros(60), 1.0]
    assert kinds(u, np.arange(61.0), 45) == []

import numpy as np
import pytest

from fixed_options import Plane, identify
from plane_records import a_record


def test_scores_are_what_they_say():
    u, y = a_record()
    found = identify(u, y, Plane(10), holdout=0.25)
    assert found.fitted.sum() == 1125
    assert found.held_out[1125:].all()
    predicted = found.model.simulate(u)
    np.testing.assert_array_equal(found.predict(u), predicted)
    error = (predicted - y)[1125:]
    assert found.holdout_nrmse == pytest.approx(np.sqrt(np.mean(error**2)) / np.ptp(y[1125:]))
    assert found.rmse == pytest.approx(np.sqrt(np.mean((predicted - y)[:1125] ** 2)))
    assert found.nrmse == pytest.approx(found.rmse / np.ptp(y[:1125]))
    assert found.holdout_nrmse < 0.01 < found.baseline_nrmse
    assert "held out" in str(found)

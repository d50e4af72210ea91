import numpy as np
import pytest

from minorloop import Linear, ParameterError
from minorloop.identification import arx as identification_arx
from minorloop.identification.arx import arx, step_response
from minorloop.identification.linear_fit import StepResponse

PLANT = Linear.lags(27.0, 6.0)


def record(noise=1e-3, seed=0, hold=300):
    t = np.arange(1.0, 101 + hold)
    u = np.where(t <= 100, 0.0, 1.0)
    return t, u, PLANT.simulate(t, u) + np.random.default_rng(seed).normal(0, noise, t.size)


def test_the_band_of_the_step_response_is_the_scatter_over_many_records(monkeypatch):
    monkeypatch.setattr(identification_arx, "HIGHEST_ORDER", 2)
    monkeypatch.setattr(identification_arx, "LONGEST_DEAD_TIME", 0)
    t = np.array([5.0, 20.0, 60.0, 150.0])
    fits = [arx(*record(seed=seed)) for seed in range(40)]
    spread = np.std([one.model.step_response(t) for one in fits], axis=0)
    predicted = np.mean([one.step_deviation(t) for one in fits], axis=0)
    np.testing.assert_allclose(predicted, spread, rtol=0.5)
    errors = np.array([one.model.step_response(t) for one in fits]) - PLANT.step_response(t)
    assert np.mean(np.abs(errors) <= 2 * predicted) >= 0.85


def test_both_directions():
    t = np.arange(1.0, 901)
    u = np.repeat([0.0, 1.0, 0.0], 300)
    both = step_response(t, u, PLANT.simulate(t, u))
    assert both.models == (both.rising.model, both.falling.model)
    assert str(both).count("time constants [s]") == 2
    assert len(both.plot().axes) == 1
    only = StepResponse(both.rising, None)
    assert "no such step" in str(only)
    assert only.models == (both.rising.model, both.rising.model)
    assert len(only.plot().axes) == 1
    with pytest.raises(ParameterError, match="at least one direction"):
        _ = StepResponse(None, None).models

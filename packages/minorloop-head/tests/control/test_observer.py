import math

import numpy as np
import pytest

from minorloop_head.control.observer import ObserverControl, PowerObserver
from minorloop_head.twins.wire import Wire
from wires import angle, identified, made_up


def follow(observer, plant_bias, seconds, *, power=0.125, noise=0.0, delay=1):
    """Estimate of a wire that is heated by a power, in surroundings with a bias."""
    wire = observer.wire
    plant, estimate = wire.begin(), observer.found()
    seen, rng = [plant.angle] * (delay + 1), np.random.default_rng(0)
    for _ in range(round(seconds / observer.interval)):
        plant = wire.step(plant, power, observer.interval, ambient=plant_bias)
        seen.append(plant.angle + noise * rng.normal())
        estimate = observer.update(estimate, math.sqrt(power), seen[-1 - delay])
    return plant, estimate


@pytest.mark.parametrize(("bias", "delay"), [(-0.01, 0), (0.0, 1), (0.01, 4)])
def test_the_bias_of_the_surroundings_is_learnt(bias, delay):
    observer = PowerObserver(wire=made_up(), delay=delay)
    plant, estimate = follow(observer, bias, 60.0, delay=delay)
    assert estimate.wire.angle == pytest.approx(plant.angle, abs=0.2)
    assert estimate.wire.power == pytest.approx(plant.power, abs=1.5e-3)
    assert estimate.ambient == pytest.approx(bias, abs=2e-3)


def test_the_bias_stays_within_bounds_for_wrong_readings():
    observer = PowerObserver(wire=made_up())
    for reading in (-45.0, 130.0):
        estimate = observer.found()
        for _ in range(3000):
            estimate = observer.update(estimate, 0.2, reading)
        assert abs(estimate.ambient) <= 0.6 * 0.16 + 1e-12
        assert math.isfinite(estimate.wire.power)


def test_full_current_is_used_until_the_target_is_near():
    law, plant = ObserverControl(wire=identified().model), Wire(noise=0.05, seed=1)
    state, seen = law.begin(), 0.0
    full = []
    for _ in range(400):
        current, state = law.step(state, 40.0, seen)
        seen = plant.exchange(current)
        if angle(plant) < 35.0:
            full.append(current)
    assert min(full) == law.highest
    assert angle(plant) == pytest.approx(40.0, abs=0.3)

from dataclasses import replace

import numpy as np
import pytest

from papers.catheter.control.internal_model import InternalModel, margins, poles, robust_margins
from wires import identified, made_up


def growth(law, *, gain=1.0, delay=0, lag=1.0, steps=4000):
    """Growth in a step of a loop without operator and limits, by running it."""
    keep, model_keep, filtered = np.exp(
        -law.interval / np.array([law.model_lag * lag, law.model_lag, law.response])
    )
    ratio = law.model_lag / law.response
    y, model = np.zeros(steps + 1), np.zeros(steps + 1)
    state, sizes = 1e-3, np.zeros(steps)
    for n in range(steps):
        seen = y[n - law.delay - delay] if n >= law.delay + delay else 0.0
        known = model[n - law.delay] if n >= law.delay else 0.0
        wanted = known - seen
        v = state + ratio * (wanted - state)
        state = wanted + (state - wanted) * filtered
        y[n + 1] = gain * v + (y[n] - gain * v) * keep
        model[n + 1] = v + (model[n] - v) * model_keep
        sizes[n] = abs(y[n + 1]) + abs(model[n + 1]) + abs(state)
        if sizes[n] > 1e100:
            break
    middle, last = n // 2, n + 1
    size = [np.max(sizes[k - 100 : k]) for k in (middle, last)]
    return (size[1] / size[0]) ** (1.0 / (last - middle))


@pytest.mark.parametrize(
    "plant",
    [{"gain": 3.0}, {"gain": 20.0}, {"delay": 10}, {"delay": 30}, {"gain": 2.0, "lag": 0.3}],
)
def test_the_greatest_pole_is_the_growth_of_the_loop(plant):
    law = InternalModel(wire=made_up())
    assert growth(law, **plant) == pytest.approx(poles(law, **plant)[0], abs=2e-3)


@pytest.mark.parametrize("response", [0.3, 0.6, 2.0])
def test_margins_are_edges(response):
    law = InternalModel(wire=made_up(), response=response)
    found = margins(law)
    assert poles(law, gain=0.999 * found.gain)[0] < 1.0 < poles(law, gain=1.001 * found.gain)[0]
    late = round(found.delay / law.interval)
    assert poles(law, delay=late)[0] < 1.0 <= poles(law, delay=late + 1)[0]
    assert found.lag < 1.0
    slower = margins(replace(law, response=2.0 * response))
    assert slower.gain > found.gain
    assert slower.delay > found.delay


@pytest.mark.parametrize(("share", "moves"), [(1.0, False), (2.5, True)])
def test_a_wire_is_stable_up_to_the_predicted_delay_and_not_far_beyond(share, moves):
    wire = identified().model
    law = InternalModel(wire=wire)
    late = round(share * robust_margins(law).delay / law.interval)
    state, plant, angles = law.begin(), wire.begin(), [0.0] * (late + 1)
    for _ in range(1500):
        current, state = law.step(state, 30.0, angles[-1 - late])
        plant = wire.step(plant, current**2, law.interval)
        angles.append(plant.angle)
    assert bool(np.ptp(angles[-375:]) > 2.0) is moves

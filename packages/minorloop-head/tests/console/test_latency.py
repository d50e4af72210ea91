import math

import numpy as np
import pytest

from minorloop_head.console.latency import STAGES, Latency, delay

TICK = 0.04


def followed(seconds, *, loop=3, wire=10):
    """A head that follows a swinging one some ticks later."""
    found = Latency(TICK)
    t = TICK * np.arange(-50, round(seconds / TICK))
    swing = 0.2 * np.stack([np.sin(t), np.cos(0.7 * t)], axis=1)
    for n in range(50, len(t)):
        found.note(
            tracker=0.008, waited=0.05, aimed=swing[n], command=swing[n - loop],
            angle=0.9 * swing[n - loop - wire], picture=0.08,
        )  # fmt: skip
    return found


def test_each_stage_has_the_delay_that_it_was_given():
    stages = followed(60.0).stages()
    assert tuple(stages) == STAGES
    known = {name: value for name, value in stages.items() if name != "network"}
    wanted = {"tracker": 0.008, "loop": 0.05 + 3 * TICK, "wire": 10 * TICK, "picture": 0.08}
    assert known == pytest.approx(wanted, abs=TICK)
    assert math.isnan(stages["network"])


@pytest.mark.parametrize("shift", [0, 1, 40])
def test_a_delay_is_found_whatever_the_offset(shift):
    signal = np.cumsum(np.random.default_rng(1).normal(size=(500, 2)), axis=0)
    response = 3.0 + np.roll(signal, shift, axis=0)
    assert delay(signal[100:], response[100:], TICK) == pytest.approx(shift * TICK)

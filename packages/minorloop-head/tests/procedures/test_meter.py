import numpy as np
import pytest

from minorloop_head.procedures.meter import LIMITS, Metering
from minorloop_head.procedures.values import Reading

from .fakes import CALIBRATION, TICK

METERING = Metering(calibration=CALIBRATION)


def metered(light, seconds=1.0, gain=1.0):
    """Requests to a camera whose grey is light times gain."""
    from dataclasses import replace

    metering = replace(METERING, seconds=seconds)
    state, asked, gains = metering.begin(gain), [], [gain]
    for k in range(1000):
        grey = np.clip(light * gains[-1], 0, 255)
        reading = Reading(t=k * TICK, angles=np.zeros(2), image=np.full((8, 8), grey, np.uint8))
        state, request = metering.step(state, reading)
        asked.append(request)
        gains += [request.exposure[1]] if request.exposure else []
        if state.done:
            break
    return state, asked, light * gains[-1]


@pytest.mark.parametrize("light", [15.0, 60.0, 250.0])
def test_the_gain_comes_to_a_middle_grey(light):
    state, asked, grey = metered(light)
    assert state.done
    assert grey == pytest.approx(LIMITS.grey, rel=0.05)
    assert len(asked) == pytest.approx(1 / TICK, abs=2)


def test_the_focus_follows_the_wall_ahead_within_its_limits():
    ahead = [METERING.ahead(Reading(t=0.0, angles=np.array([pan, 0.0]))) for pan in (0.0, 0.3, 1.0)]
    assert ahead[0] == LIMITS.farthest
    assert ahead == sorted(ahead, reverse=True)
    assert ahead[-1] >= LIMITS.nearest


def test_a_place_is_exposed_for_though_the_rest_of_the_picture_is_dark():
    lens = CALIBRATION.lens
    angles = np.array([0.4, 0.0])
    camera = CALIBRATION.camera_at(np.zeros(2))
    place = camera.place(np.add(lens.centre, (0.2 * lens.width, 0.0)), *angles)
    image = np.full((lens.height, lens.width), 10, np.uint8)
    image[:, lens.width // 2 :] = 200
    reading = Reading(t=0.0, angles=angles, image=image)
    whole, _ = METERING.step(METERING.begin(), reading)
    state, request = METERING.step(METERING.begin(place=place), reading)
    assert state.gain == request.exposure[1] == pytest.approx((LIMITS.grey / 200) ** METERING.share)
    away, _ = METERING.step(METERING.begin(place=np.add(place, (np.pi, 0.0))), reading)
    assert away.gain == whole.gain > 1.5 * state.gain

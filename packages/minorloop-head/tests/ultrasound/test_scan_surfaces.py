import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop_head.ultrasound.echoes import Pulse
from minorloop_head.ultrasound.recorded_scan import RecordedScan
from minorloop_head.ultrasound.scan_surfaces import depth_step, recorded_field

FREQUENCY, STEP = 2.25e6, 0.8e-3
PULSE = Pulse(FREQUENCY, 0.7)


def point(x, depth, speed, count=81, lines=1):
    """Echoes of a point in one layer: their times are those of straight rays."""
    places = STEP * np.arange(count)
    across = STEP * np.arange(lines)
    away = np.hypot(places[:, None] - x, across - across.mean())
    times = 2 * np.hypot(away, depth) / speed
    interval = 0.04e-6
    t = np.arange(0, times.max() + 3e-6, interval)
    width = PULSE.bandwidth * FREQUENCY / 2 / np.sqrt(2 * np.log(2))
    late = t[:, None, None] - times
    traces = np.exp(-0.5 * (2 * np.pi * width * late) ** 2) * np.cos(2 * np.pi * FREQUENCY * late)
    tilt = away / depth
    traces *= np.exp(-((tilt / 0.3) ** 2))  # a disc sends little to the side
    return RecordedScan(
        traces, interval, 0.0, (STEP, STEP), (speed,), (), (0.7 * FREQUENCY, 1.4 * FREQUENCY)
    )


def peak(scan, speed):
    field = recorded_field(scan)
    depths = np.arange(5e-3, 60e-3, depth_step(field, speed))
    picture = np.abs(field.image(speed, depths))
    z, x, y = np.unravel_index(picture.argmax(), picture.shape)
    beside = picture[z, :, y] > 0.5 * picture.max()
    return STEP * x, depths[z], STEP * beside.sum()


@settings(max_examples=10)
@given(st.floats(20e-3, 44e-3), st.floats(15e-3, 50e-3), st.sampled_from([1480.0, 2730.0, 5900.0]))
def test_a_point_is_focused_to_a_point(x, depth, speed):
    at, deep, wide = peak(point(x, depth, speed), speed)
    assert at == pytest.approx(x, abs=STEP)
    assert deep == pytest.approx(depth, abs=0.12 * speed / FREQUENCY)
    assert wide <= 4 * max(STEP, speed / FREQUENCY)


def test_a_point_is_focused_in_a_raster():
    at, deep, _ = peak(point(12e-3, 20e-3, 1480.0, count=31, lines=25), 1480.0)
    assert (at, deep) == pytest.approx((12e-3, 20e-3), abs=STEP)


def test_two_layers_of_one_speed_are_one_layer():
    field = recorded_field(point(30e-3, 40e-3, 1480.0))
    depths = np.arange(10e-3, 30e-3, 1e-4)
    once, twice = field.image(1480.0, depths + 15e-3), field.down(1480.0, 15e-3)
    beyond = twice.image(1480.0, depths)
    inside = slice(15, -15)  # the first cuts the field off beside the scan
    off = np.abs(once - beyond)[:, inside].max() / np.abs(once).max()
    assert off < 0.05


def test_what_all_places_share_is_taken_away_and_what_few_have_is_not():
    scan = point(30e-3, 20e-3, 1480.0)
    common = np.roll(scan.traces[:, 40], 200, axis=0)[:, None]
    both = RecordedScan(
        scan.traces + 30 * common, scan.interval, 0.0, scan.steps, (1480.0,), (), scan.band
    )
    left, alone = recorded_field(both).local().spectrum, recorded_field(scan).spectrum
    assert np.abs(left - alone).max() < 0.2 * np.abs(alone).max()


def test_a_part_of_the_time_shows_the_depths_in_it_as_the_whole_does():
    field = recorded_field(point(30e-3, 20e-3, 1480.0))
    depths = np.arange(16e-3, 25e-3, 1e-4)
    part = field.within(20e-6, 45e-6)
    assert len(part.omega) < 0.6 * len(field.omega)
    whole = field.image(1480.0, depths)
    assert np.abs(part.image(1480.0, depths) - whole).max() < 0.02 * np.abs(whole).max()

import numpy as np
import pytest

from minorloop_head.geometry import Mount, Probe, wall_point
from minorloop_head.reconstruction.depth_map import find_water
from minorloop_head.twins.pipe import Pipe
from minorloop_head.twins.ultrasound import Ultrasound
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.wall_echoes import Profile, centred, joined, wall_profile

from .synthetic import heard

WATER = -1.5e-3
OFFSET = (0.1e-3, -0.05e-3)
ROLLS = np.radians(np.arange(-180, 180, 15.0))


@pytest.fixture(scope="module")
def swept():
    """A sweep round a pipe that is a little more than half full, with a misplaced pivot."""
    sonar = Ultrasound(Pipe(water=WATER), noise=0.03)
    profiles = []
    for roll in ROLLS:
        known = Mount(roll=float(roll), advance=20e-3)
        probe = CalibratedProbe(Probe(), known)
        angles = probe.transducer.aim(known, wall_point(roll, 20e-3, 10e-3))
        sonar.move(Mount(offset=OFFSET, roll=float(roll), advance=20e-3))
        profiles.append(wall_profile([heard(sonar, angles)], probe))
    return joined(profiles)


def test_the_wall_echoes_under_water_only(swept):
    under = 10e-3 * np.sin(ROLLS) > WATER + 0.4e-3
    above = 10e-3 * np.sin(ROLLS) < WATER - 0.4e-3
    assert swept.detected[under].all()
    assert not swept.detected[above].any()
    assert np.isnan(swept.depths[above]).all()


def test_the_water_line_is_found(swept):
    line = find_water(swept.spots[:, 0], swept.detected, 10e-3, face=2e-3)
    assert line.height == pytest.approx(WATER, abs=np.sqrt(12) * line.sd)
    assert line.sd < 1e-3


def test_a_pivot_off_its_place_is_found_and_taken_out(swept):
    wet = 10e-3 * np.sin(swept.spots[:, 0]) > WATER + 2e-3
    assert np.ptp(swept.depths[wet]) > 60e-6
    level = centred(swept)
    assert np.abs(level.depths[wet]).max() < 15e-6


def test_too_few_echoes_are_left_as_they_are():
    few = Profile(np.zeros((3, 2)), np.ones(3), np.ones(3))
    assert np.array_equal(centred(few).depths, few.depths)

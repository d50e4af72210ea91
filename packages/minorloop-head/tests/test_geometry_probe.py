from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop_head.geometry import Mount, Probe, meet_wall, wall_point

near = st.floats(-0.08, 0.08)


@given(near, st.floats(-1e-3, 1e-3), st.floats(-np.pi, np.pi), st.floats(-0.3e-3, 0.3e-3))
def test_the_beam_goes_where_it_is_aimed(off, along, roll, eccentric):
    mount = Mount(offset=(eccentric, -eccentric), roll=roll, advance=20e-3)
    phi, z = roll + off, 20e-3 + along
    pan, tilt = Probe().aim(mount, wall_point(phi, z, 10e-3))
    found = meet_wall(*Probe().beam(mount, pan, tilt), 10e-3)
    assert found[1] == pytest.approx(z, abs=1e-9)
    assert np.exp(1j * found[0]) == pytest.approx(np.exp(1j * phi), abs=1e-9)


def test_the_default_probe_meets_the_wall_squarely_at_20_degrees_on_the_cold_side():
    pan, tilt = Probe().aim(Mount(), wall_point(np.pi, 0.0, 10e-3))
    assert np.degrees(pan) == pytest.approx(-20.0)
    assert tilt == pytest.approx(0.0, abs=1e-12)
    origin, along = Probe().beam(Mount(), pan, tilt)
    assert along == pytest.approx([-1, 0, 0], abs=1e-12)
    assert origin == pytest.approx([-2e-3, 0, 0], abs=1e-12)


@given(st.floats(0.5, 1.4), st.floats(-np.pi, np.pi), st.floats(-0.4, 0.4))
def test_the_beam_is_at_a_right_angle_to_the_pipe_at_the_pan_that_says_so(squint, azimuth, tilt):
    probe, mount = Probe(squint=squint, azimuth=azimuth), Mount(roll=0.4)
    along = probe.beam(mount, probe.perpendicular(mount, tilt), tilt)[1]
    assert along[2] == pytest.approx(0.0, abs=1e-9)


@given(near, near, st.floats(-np.pi, np.pi), st.floats(-0.05, 0.05))
def test_angles_at_another_roll_give_the_same_beam(pan, tilt, roll, rolled):
    mount = Mount(offset=(0.1e-3, -0.2e-3), roll=roll, advance=20e-3, squint=0.02, camera_roll=0.1)
    other, pan, tilt = replace(mount, roll=roll + rolled), pan - 0.35, tilt - 0.25
    there = Probe().beam(other, *Probe().moved(mount, pan, tilt, other))
    for found, was in zip(there, Probe().beam(mount, pan, tilt), strict=True):
        assert found == pytest.approx(was, abs=1e-9)

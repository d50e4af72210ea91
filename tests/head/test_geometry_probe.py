import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import ParameterError
from minorloop.head.geometry import Mount, Probe, meet_wall, wall_point

near = st.floats(-0.08, 0.08)


@given(near, st.floats(-1e-3, 1e-3), st.floats(-np.pi, np.pi), st.floats(-0.3e-3, 0.3e-3))
def test_the_beam_goes_where_it_is_aimed(off, along, roll, eccentric):
    mount = Mount(offset=(eccentric, -eccentric), roll=roll, advance=20e-3)
    phi, z = roll + off, 20e-3 + along
    pan, tilt = Probe().aim(mount, wall_point(phi, z, 10e-3))
    found = meet_wall(*Probe().beam(mount, pan, tilt), 10e-3)
    assert found[1] == pytest.approx(z, abs=1e-9)
    assert np.exp(1j * found[0]) == pytest.approx(np.exp(1j * phi), abs=1e-9)


def test_the_default_probe_meets_the_wall_squarely_at_18_degrees():
    pan, tilt = Probe().aim(Mount(), wall_point(0.0, 0.0, 10e-3))
    assert np.degrees(pan) == pytest.approx(18.0)
    assert tilt == pytest.approx(0.0, abs=1e-12)
    origin, along = Probe().beam(Mount(), pan, tilt)
    assert along == pytest.approx([1, 0, 0], abs=1e-12)
    assert origin == pytest.approx([2e-3, 0, 0], abs=1e-12)


def test_impossible_values_are_refused():
    with pytest.raises(ParameterError, match="squint"):
        Probe(squint=2.0)
    with pytest.raises(ParameterError, match="positive lengths"):
        Probe(aperture=0.0)
    with pytest.raises(ParameterError, match="roll"):
        Probe().aim(Mount(), wall_point(np.pi / 2, 0.0, 10e-3))

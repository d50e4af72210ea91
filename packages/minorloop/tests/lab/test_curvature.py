import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import ParameterError
from minorloop.lab.curvature import displacement_from_curvature

D0, H0 = 0.05, 0.015
curvatures = st.floats(-60.0, 60.0)


@given(curvatures.filter(lambda kappa: abs(kappa) > 1e-3))
def test_the_laser_meets_the_arc_of_a_circle(kappa):
    x = D0 - displacement_from_curvature(kappa, D0, H0, length=0.03)
    assert np.hypot(x - 1 / kappa, H0) == pytest.approx(1 / abs(kappa), rel=1e-9)


def test_a_straight_strip_has_no_curvature_and_no_singularity():
    assert displacement_from_curvature(0.0, D0, H0) == D0
    tiny = 1e-9
    assert D0 - displacement_from_curvature(tiny, D0, H0) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("h0", [0.0, -0.01, np.nan, np.inf])
def test_refuses_impossible_geometry(h0):
    with pytest.raises(ParameterError, match=r"h0 is .*; give a positive length"):
        displacement_from_curvature(0.0, D0, h0)
    with pytest.raises(ParameterError, match="d0 is nan"):
        displacement_from_curvature(0.0, np.nan, H0)

import pytest

from minorloop_head.ultrasound.pit_search import solve_without_floor
from minorloop_head.ultrasound.through_hole import is_through_hole

from .synthetic import fit_of, pit


@pytest.mark.parametrize(("gain", "through"), [(0.0, True), (0.3, False), (1.0, False)])
def test_only_a_mouth_without_a_floor_is_a_through_hole(gain, through):
    fit = fit_of(pit(gain=gain, depth=0.8e-3))
    hole = solve_without_floor(fit, fit.solve(pit(gain=gain, depth=0.8e-3)))
    assert is_through_hole(fit, hole) == through

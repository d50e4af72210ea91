import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop_head.control.limits import WireLimits
from wires import made_up


@given(
    effective=st.floats(0.0, 0.3), bias=st.floats(-0.05, 0.05), latent=st.sampled_from([0, 2e-3])
)
def test_the_allowed_power_never_makes_the_wire_too_hot(effective, bias, latent):
    wire, limits = made_up(latent=latent), WireLimits()
    power = limits.allowed(wire, effective, bias, 0.04)
    assert power >= 0
    after = wire.step(wire.begin(effective), power, 0.04, ambient=bias).power
    assert after <= max(limits.highest_power, effective, bias) * (1 + 1e-9)


def test_a_wire_at_its_highest_power_has_the_highest_temperature():
    limits = WireLimits()
    assert limits.temperature(limits.highest_power) == pytest.approx(150.0)
    assert limits.temperature(0.0) == limits.ambient


def test_the_advised_stress_is_exceeded_from_25_degrees():
    limits = WireLimits()
    assert not limits.stressed(24.0)
    assert limits.stressed(28.0)

import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop_head.twins.surroundings import GASES, Course, Filling, Surroundings, convection


@pytest.mark.parametrize(
    ("course", "values"),
    [
        (Course(3.0), {-1.0: 3.0, 0.0: 3.0, 1e6: 3.0}),
        (Course(3.0, 5.0, at=10.0), {9.999: 3.0, 10.0: 5.0, 99.0: 5.0}),
        (Course(3.0, 5.0, at=10.0, duration=4.0), {10.0: 3.0, 11.0: 3.5, 14.0: 5.0, 20.0: 5.0}),
        (Course(3.0, amplitude=2.0, period=4.0), {-1.0: 3.0, 0.0: 3.0, 1.0: 5.0, 3.0: 1.0}),
        (Course(0.0, 1.0, at=8.0, amplitude=2.0, period=4.0), {7.0: 0.0, 9.0: 3.0, 11.0: -1.0}),
    ],
)
def test_a_course_steps_ramps_and_swings(course, values):
    for t, value in values.items():
        assert course(t) == pytest.approx(value, abs=1e-12)


numbers = st.floats(-1e3, 1e3)


@given(numbers, numbers, numbers, st.floats(0, 50), numbers, st.floats(0.1, 10), numbers)
def test_a_course_never_leaves_its_bounds(start, end, at, duration, amplitude, period, t):
    course = Course(start, end, at, duration, amplitude, period)
    low, high = course.bounds
    slack = 1e-9 * (abs(low) + abs(high))
    assert low - slack <= course(t) <= high + slack


def test_still_gases_cool_by_their_properties():
    properties = {  # conductivity, density, heat capacity and viscosity at 300 K
        "air": (0.0263, 1.161, 1007.0, 184.6e-7),
        "nitrogen": (0.0259, 1.123, 1041.0, 178.2e-7),
        "argon": (0.0177, 1.603, 520.0, 227e-7),
        "helium": (0.152, 0.1625, 5193.0, 199e-7),
    }

    def film(k, density, capacity, viscosity):
        return k * (density**2 * capacity / (k * viscosity)) ** 0.148

    for gas, values in properties.items():
        ratio = film(*values) / film(*properties["air"])
        assert convection(gas) / convection("air") == pytest.approx(ratio, rel=0.01)
    assert {*properties, "forced gas"} == set(GASES)


def test_a_dense_gas_cools_better_and_a_dense_liquid_does_not():
    for medium, gain in (("air", 10**0.296), ("forced gas", 10**0.384), ("flooded", 1.0)):
        ratio = convection(medium, pressure=1_013_250.0) / convection(medium)
        assert ratio == pytest.approx(gain, rel=1e-12)


def test_water_and_gas_of_a_pipe_set_ambient_and_convection():
    load = Surroundings(load=1e-3)
    wet = Filling(level=-5e-3, temperature=12.0, sleeve=1.04).around(load)
    assert (wet.ambient, wet.load) == (12.0, 1e-3)
    assert wet.convection == pytest.approx(1.04 * convection("flooded, sleeved"))
    low = Filling(level=5e-3, temperature=12.0).around(load)
    assert low.convection == convection("air")  # the wires are about the axis, above the water
    gas = Filling(gas="forced gas", pressure=2e5).around(load)
    assert gas.convection == convection("forced gas", pressure=2e5)

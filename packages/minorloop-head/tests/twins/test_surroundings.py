import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop_head.twins.surroundings import Course, Filling, Surroundings, convection


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


def test_water_and_gas_of_a_pipe_set_ambient_and_convection():
    load = Surroundings(load=1e-3)
    wet = Filling(level=-5e-3, temperature=12.0, sleeve=1.04).around(load)
    assert (wet.ambient, wet.load) == (12.0, 1e-3)
    assert wet.convection == pytest.approx(1.04 * convection("flooded, sleeved"))
    low = Filling(level=5e-3, temperature=12.0).around(load)
    assert low.convection == convection("air")  # the wires are about the axis, above the water
    gas = Filling(gas="forced gas", pressure=2e5).around(load)
    assert gas.convection == convection("forced gas", pressure=2e5)

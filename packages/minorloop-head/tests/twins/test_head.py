import numpy as np
import pytest

from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import Cooling, Course, Surroundings
from minorloop_head.twins.wire import Wire


def settled(pan, tilt, **options):
    """Pan and tilt after a long hold from the cold, and the truth there."""
    twin = Head(log_truth=True, **options)
    y = twin.apply(np.array([pan, tilt]), 120.0, 120.0).y[:, -1]
    return y, {name: values[-1] for name, values in twin._truth().items()}


def test_each_axis_reaches_the_published_angle():
    for currents, axis in (((0.4, 0.0), 0), ((0.0, 0.4), 1)):
        y, truth = settled(*currents)
        assert y[axis] == pytest.approx(60.0, abs=1.0)
        assert truth["temperature"][axis] == pytest.approx(128.0, abs=0.5)


def test_each_sensor_sees_a_tenth_of_the_other_axis_at_most():
    for cold, hot, currents in ((1, 0, (0.4, 0.0)), (0, 1, (0.0, 0.4))):
        y, _ = settled(*currents)
        assert 0.04 < y[cold] / y[hot] < 0.10


def test_the_other_spring_adds_or_takes_ten_megapascals():
    _, alone = settled(0.4, 0.0)
    _, both = settled(0.4, 0.4)
    wire = Wire(log_truth=True)
    wire.apply(0.4, 120.0, 120.0)
    single = wire._truth()["stress"][-1, 0]
    assert alone["stress"][0] - single == pytest.approx(-10e6, abs=1.5e6)
    assert both["stress"][0] - single == pytest.approx(+10e6, abs=3e6)


def test_moving_one_axis_disturbs_the_wire_of_the_other():
    twin, alone = Head(log_truth=True), Head(log_truth=True)
    for head in (twin, alone):
        head.apply(np.array([0.4, 0.0]), 80.0, 80.0)
        head.apply(np.array([0.3, 0.0]), 80.0, 80.0)
    twin.apply(np.array([0.3, 0.4]), 80.0, 80.0)
    alone.apply(np.array([0.3, 0.0]), 80.0, 80.0)
    pushed, free = (head._truth()["martensite"][-1, 0] for head in (twin, alone))
    assert pushed - free > 0.05


def test_the_flow_makes_a_held_head_sway():
    sway = (Course(0.0, amplitude=1e-3, period=1 / 0.3), Course(0.0, amplitude=1e-3, period=4.3))
    twin = Head(surroundings=Surroundings(load=sway))
    y = twin.apply(np.array([0.33, 0.33]), 100.0, 0.04).y[:, -500:]
    assert np.all(np.ptp(y, axis=1) > 0.2)


def test_one_wire_warms_the_other_through_the_body():
    around = Surroundings(cooling=Cooling())
    _, alone = settled(0.0, 0.0, surroundings=around)
    _, beside = settled(0.0, 0.4, surroundings=around)
    np.testing.assert_allclose(alone["temperature"], 20.0)
    assert beside["body"][0] == beside["body"][1] > 21.0
    between = 20.0 + 0.5 * (beside["body"][0] - 20.0)
    assert beside["temperature"][0] == pytest.approx(between, abs=0.1)


def test_the_warmth_of_the_body_is_part_of_a_checkpoint():
    around = Surroundings(cooling=Cooling())
    first = Head(surroundings=around)
    first.apply(np.array([0.3, 0.1]), 60.0, 60.0)
    other = Head(surroundings=around)
    other.restore(first.checkpoint())
    after = [twin.apply(np.array([0.25, 0.2]), 60.0, 1.0).y for twin in (first, other)]
    np.testing.assert_array_equal(*after)

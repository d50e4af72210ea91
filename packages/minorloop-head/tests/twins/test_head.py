import numpy as np
import pytest

from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import Cooling, Surroundings


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


def test_the_warmth_of_the_body_is_part_of_a_checkpoint():
    around = Surroundings(cooling=Cooling())
    first = Head(surroundings=around)
    first.apply(np.array([0.3, 0.1]), 60.0, 60.0)
    other = Head(surroundings=around)
    other.restore(first.checkpoint())
    after = [twin.apply(np.array([0.25, 0.2]), 60.0, 1.0).y for twin in (first, other)]
    np.testing.assert_array_equal(*after)

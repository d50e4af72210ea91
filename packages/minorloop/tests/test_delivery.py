"""Targets delivered in time, on a plant that is the model itself, and on another."""

import numpy as np
import pytest

from minorloop.delivery import Delivery
from minorloop.errors import NotInvertibleError, UnreachableError
from minorloop.lab.actuator import Channel
from minorloop.lab.store import Point
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.preisach import Preisach

LEVELS = np.linspace(-1, 1, 5)
WEIGHTS = np.tril(np.random.default_rng(1000).uniform(0.2, 1, (4, 4)))
PLANE = Preisach(LEVELS, WEIGHTS, relay="unipolar", diagonal="reversible")
MODEL = AfterEffect(PLANE, times=[1.0, 20.0], creep=[0.3 * WEIGHTS, 0.2 * WEIGHTS])
CHANNEL = Channel("voltage", "V", -1.0, 1.0)
TARGETS = [2.0, 5.0, 3.0]


def delivery(**options):
    fields = {"every": 0.3, "hold": 3.0, "saturation": -1.0, "low": -1.0, "high": 1.0}
    return Delivery(**{"model": MODEL, "targets": TARGETS, **fields, **options})


def carried(chosen, plant, gap=0.0, offset=0.0):
    """Points of a run on a plant; its source needs a gap in seconds for a new input."""
    tracker, points, t = plant.track("negative"), [], 0.0
    while (u := chosen.choose(points)) is not None:
        held = chosen.settling if not points else chosen.every
        if points and gap:
            tracker.push(points[-1].input, gap)
        y = tracker.push(u, held) + offset
        t += held + gap * bool(points)
        points.append(
            Point(index=len(points), input=u, value=y, sd=0.0, verdict="settled", t=t, held=held)
        )
    return points


@pytest.mark.parametrize("gap", [0.0, 0.05])
def test_every_interval_ends_at_its_target_whatever_creeps(gap):
    chosen = delivery()
    points = carried(chosen, MODEL, gap, offset=0.7)
    y = np.array([point.value for point in points[1:]]) - 0.7
    np.testing.assert_allclose(y, np.repeat(TARGETS, chosen.intervals), atol=1e-9)
    inputs = np.array([point.input for point in points[1:11]])
    assert np.ptp(inputs) > 0.05  # it follows the creep
    result = chosen.result(points)
    assert result.offset == pytest.approx(0.7)
    assert result.errors == pytest.approx(0, abs=1e-9)
    assert result.arrivals[0].tries == 10
    assert not result.advice


def test_a_plant_that_creeps_otherwise_misses_its_targets():
    slower = AfterEffect(PLANE, times=[1.0], creep=[1.5 * WEIGHTS])
    chosen = delivery()
    result = chosen.result(carried(chosen, slower))
    assert result.missed
    assert "longer intervals (--every)" in result.advice[-1]
    assert chosen.result([]).arrivals == ()


def test_the_plan_settles_in_saturation_and_never_ends_an_interval_early():
    chosen = delivery()
    plan = chosen.plan(input="voltage [V]")
    assert plan.longest[0] == 100.0
    assert len(plan) == 1 + 3 * 10
    np.testing.assert_array_equal(plan.shortest, plan.longest)
    again = Delivery.from_json(chosen.to_json(), written=float)
    assert again.model == MODEL
    assert again.to_json() == chosen.to_json()


def test_inputs_stay_within_the_limits_of_the_actuator():
    points = carried(delivery(low=-1.0, high=0.2), MODEL)
    assert max(point.input for point in points) == 0.2


def test_targets_that_are_never_reached_and_models_without_an_inverse_are_refused():
    with pytest.raises(UnreachableError, match="the target at index 1 is 50"):
        delivery(targets=[2.0, 50.0]).check(CHANNEL)
    with pytest.raises(NotInvertibleError, match="not monotone"):
        delivery(model=AfterEffect(PLANE, times=[1.0], creep=[-1.1 * WEIGHTS]))

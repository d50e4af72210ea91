import math
from types import SimpleNamespace

import numpy as np
import pytest

from minorloop.errors import InstrumentError, LimitError, ParameterError, SafetyError
from minorloop.lab.actuator import Actuator, Channel
from minorloop.lab.limited_actuator import LimitedActuator
from minorloop.lab.records import Record
from minorloop.lab.run import Restorable
from minorloop.twins.ipmc import Ipmc


class HomeMade:
    inputs = (Channel("current", "A", 0.0, 0.4, rate=5.0),)
    outputs = (Channel("angle", "deg"),)
    tick = 0.04

    def __init__(self, failure=None):
        self.sent, self.failure = [], failure

    def exchange(self, u):
        if self.failure is not None:
            raise self.failure
        self.sent.append(float(u))
        return 100.0 * u

    def apply(self, u, duration, sample_interval):
        self.exchange(u)
        return Record([u], [100.0 * u], [duration], "current [A]", "angle [deg]")

    def safe(self):
        self.sent.append("safe")


def test_it_is_an_actuator_that_passes_on_what_is_allowed():
    plant = LimitedActuator(HomeMade())
    assert isinstance(plant, Actuator)
    assert plant.exchange(0.1) == 10.0
    assert plant.apply(0.3, 1.0, 1.0).y[-1] == 30.0
    plant.safe()
    assert plant._actuator.sent == [0.1, 0.3, "safe"]
    assert isinstance(LimitedActuator(Ipmc()), Restorable)
    assert not isinstance(plant, Restorable)


@pytest.mark.parametrize("wrong", [0.5, -0.1, math.nan, math.inf, 1e308, [0.1, 0.1]])
def test_nothing_beyond_the_limits_reaches_it(wrong):
    home = HomeMade()
    plant = LimitedActuator(home)
    for act in (plant.exchange, lambda u: plant.apply(u, 1.0, 0.5)):
        with pytest.raises((LimitError, ParameterError)):
            act(wrong)
    assert home.sent == []


def test_a_tick_changes_it_no_faster_than_its_rate():
    home = HomeMade()
    plant = LimitedActuator(home)
    plant.exchange(0.0)
    with pytest.raises(LimitError, match="faster than the limit 5 A/s"):
        plant.exchange(0.3)
    plant.exchange(0.2)
    assert home.sent == [0.0, 0.2]


@pytest.mark.parametrize("failure", [ValueError("cable"), ZeroDivisionError(), OSError(5, "port")])
def test_any_failure_makes_it_safe_and_is_one_sentence(failure):
    home = HomeMade(failure)
    with pytest.raises(InstrumentError, match=r"the actuator failed: (ValueError|ZeroDiv|OSError)"):
        LimitedActuator(home).exchange(0.1)
    assert home.sent == ["safe"]


def test_readings_of_another_number_make_it_safe():
    home = HomeMade()
    home.exchange = lambda u: np.zeros(3)
    with pytest.raises(InstrumentError, match="gives 3 readings for 1 outputs"):
        LimitedActuator(home).exchange(0.1)
    assert home.sent == ["safe"]


def test_one_that_cannot_be_made_safe_may_still_be_on():
    home = HomeMade()

    def safe():
        raise ValueError("no answer")

    home.safe = safe
    with pytest.raises(SafetyError, match="may still be on, switch it off by hand: ValueError: no"):
        LimitedActuator(home).safe()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"safe": None}, "SimpleNamespace is no actuator: it has no safe"),
        ({"inputs": ("current",)}, "'current' is no channel; give a minorloop.Channel"),
        ({"inputs": (Channel("current", "A"),)}, "has no limits; give the least and greatest"),
    ],
)
def test_what_is_no_actuator_is_refused(changes, sentence):
    home = HomeMade()
    names = ("inputs", "outputs", "tick", "apply", "exchange", "safe")
    known = {name: getattr(home, name) for name in names} | changes
    with pytest.raises(ParameterError, match=sentence):
        LimitedActuator(SimpleNamespace(**{k: v for k, v in known.items() if v is not None}))

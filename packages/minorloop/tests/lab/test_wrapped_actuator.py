import math
from types import SimpleNamespace

import numpy as np
import pytest

from minorloop.connect import connect
from minorloop.errors import InstrumentError, LimitError, ParameterError, SafetyError, SignalError
from minorloop.lab.actuator import Actuator, Channel
from minorloop.lab.conversion import CalibrationPolynomial, CalibrationTable
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.records import Record
from minorloop.lab.run import Restorable
from minorloop.lab.wrapped_actuator import (
    LimitedActuator,
    SingleChannel,
    WrappedActuator,
    single_channel,
)
from minorloop.twins.ipmc import Ipmc

TENFOLD = CalibrationPolynomial(name="bend", unit="cm", coefficients=(1.0, 10.0))
NARROW = CalibrationTable(name="bend", unit="cm", readings=(1e3, 2e3), values=(0.0, 1.0))


class TestConverted:
    def test_records_and_exchanges_are_converted_and_the_rest_is_the_actuators(self):
        plain, shown = Ipmc(), SingleChannel(Ipmc(), conversion=TENFOLD)
        assert [str(channel) for channel in shown.outputs] == ["bend [cm]"]
        assert (shown.inputs, shown.tick) == (plain.inputs, plain.tick)
        raw, record = plain.apply(0.5, 3.0, 1.0), shown.apply(0.5, 3.0, 1.0)
        np.testing.assert_allclose(record.y, 1 + 10 * raw.y)
        np.testing.assert_array_equal(record.t, raw.t)
        assert str(record.output) == "bend [cm]"
        assert shown.exchange(0.2) == pytest.approx(1 + 10 * plain.exchange(0.2))
        assert (shown.answer_time(), shown.written(0.123456789)) == (0.0, 0.123456789)
        assert shown.description is None

    def test_a_twin_can_still_be_restored_and_another_actuator_not(self):
        twin = SingleChannel(Ipmc(), conversion=TENFOLD)
        state, first = twin.checkpoint(), twin.apply(1.0, 2.0, 1.0).y
        twin.restore(state)
        np.testing.assert_array_equal(twin.apply(1.0, 2.0, 1.0).y, first)
        assert isinstance(twin, Restorable)
        assert not isinstance(WrappedActuator(Ipmc(), restorable=False), Restorable)

    def test_a_conversion_that_covers_no_reading_is_refused_unless_the_run_had_begun(self):
        with pytest.raises(SignalError, match="covers none of the readings"):
            SingleChannel(Ipmc(), conversion=NARROW).apply(0.5, 3.0, 1.0)
        resumed = SingleChannel(Ipmc(), conversion=NARROW, begun=True)
        assert np.isnan(resumed.apply(0.5, 3.0, 1.0).y).all()


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


class TestLimited:
    def test_it_is_an_actuator_that_passes_on_what_is_allowed(self):
        plant = LimitedActuator(HomeMade())
        assert isinstance(plant, Actuator)
        assert plant.exchange(0.1) == 10.0
        assert plant.apply(0.3, 1.0, 1.0).y[-1] == 30.0
        plant.safe()
        assert plant._actuator.sent == [0.1, 0.3, "safe"]
        assert isinstance(LimitedActuator(Ipmc()), Restorable)
        assert not isinstance(plant, Restorable)

    @pytest.mark.parametrize("wrong", [0.5, -0.1, math.nan, math.inf, 1e308, [0.1, 0.1]])
    def test_nothing_beyond_the_limits_reaches_it(self, wrong):
        plant = LimitedActuator(HomeMade())
        for act in (plant.exchange, lambda u: plant.apply(u, 1.0, 0.5)):
            with pytest.raises((LimitError, ParameterError)):
                act(wrong)
        assert plant._actuator.sent == []

    def test_a_tick_changes_it_no_faster_than_its_rate(self):
        plant = LimitedActuator(HomeMade())
        plant.exchange(0.0)
        with pytest.raises(LimitError, match="faster than the limit 5 A/s"):
            plant.exchange(0.3)
        plant.exchange(0.2)
        assert plant._actuator.sent == [0.0, 0.2]

    @pytest.mark.parametrize("failure", [ValueError("cable"), OSError(5, "port"), "readings"])
    def test_any_failure_makes_it_safe_and_is_one_sentence(self, failure):
        home = HomeMade(failure)
        if failure == "readings":
            home.exchange = lambda u: np.zeros(3)
        sentence = r"the actuator failed: (ValueError|OSError)|gives 3 readings for 1 outputs"
        with pytest.raises(InstrumentError, match=sentence):
            LimitedActuator(home).exchange(0.1)
        assert home.sent == ["safe"]

    def test_one_that_cannot_be_made_safe_may_still_be_on(self):
        home = HomeMade()
        home.safe = lambda: {}["no answer"]
        sentence = "may still be on, switch it off by hand: KeyError: 'no"
        with pytest.raises(SafetyError, match=sentence):
            LimitedActuator(home).safe()

    @pytest.mark.parametrize(
        ("changes", "sentence"),
        [
            ({"safe": None}, "SimpleNamespace is not an actuator: it has no safe"),
            ({"inputs": ("current",)}, "'current' is not a channel; give a minorloop.Channel"),
            ({"inputs": (Channel("current", "A"),)}, "has no limits; give the least and greatest"),
        ],
    )
    def test_what_is_no_actuator_is_refused(self, changes, sentence):
        home = HomeMade()
        names = ("inputs", "outputs", "tick", "apply", "exchange", "safe")
        known = {name: getattr(home, name) for name in names} | changes
        with pytest.raises(ParameterError, match=sentence):
            LimitedActuator(SimpleNamespace(**{k: v for k, v in known.items() if v is not None}))


class Both:
    """Sources and sensors: a is of right, b and c are of left."""

    def __init__(self):
        self.sent = []

    def set(self, values):
        self.sent.append(values.tolist())

    def read(self):
        return np.array([1.0, 2.0, 3.0])

    def safe(self):
        self.sent.append("safe")


def bench():
    inputs = [Channel(name, "V", 0.0, 1.0) for name in ("left", "right")]
    outputs = [Channel(name, "mm") for name in ("a", "b", "c")]
    both = Both()
    return Bench(both, both, inputs, outputs, rest=[0.1, 0.2], tick=1e-4, measures=(1, 0, 0)), both


class TestSingleChannel:
    def test_an_input_is_applied_with_the_others_at_rest_and_its_own_output_read(self):
        plant, both = bench()
        right = single_channel(plant, "right")
        assert isinstance(right, Actuator)
        assert (right.inputs[0].name, right.outputs[0].name) == ("right", "a")
        assert right.exchange(0.5) == 1.0
        assert right.apply(0.7, 1e-3, 1e-3).y[-1] == 1.0
        right.safe()
        assert both.sent == [[0.1, 0.5], [0.1, 0.7], "safe"]
        strip = connect("twin:ipmc")
        assert single_channel(strip) is strip

    @pytest.mark.parametrize(
        ("names", "sentence"),
        [
            ((), r"has the inputs 'left \[V\]', 'right \[V\]'; choose one with --input"),
            (("left",), "has the outputs .*; choose one with --output"),
            (("middle",), "has no input 'middle'; it has"),
            (("left [V]", "d"), "has no output 'd'"),
        ],
    )
    def test_a_channel_has_to_be_named_where_there_are_several(self, names, sentence):
        with pytest.raises(ParameterError, match=sentence):
            single_channel(bench()[0], *names)

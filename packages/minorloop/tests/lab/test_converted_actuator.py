import numpy as np
import pytest

from minorloop.connect import connect
from minorloop.errors import ParameterError, SignalError
from minorloop.lab.conversion import CalibrationPolynomial, CalibrationTable
from minorloop.lab.converted_actuator import ConvertedActuator
from minorloop.lab.run import Restorable
from minorloop.lab.wrapped_actuator import WrappedActuator

TENFOLD = CalibrationPolynomial(name="bend", unit="cm", coefficients=(1.0, 10.0))


def test_records_and_exchanges_are_converted_and_the_rest_is_the_actuators():
    plain, shown = connect("twin:ipmc"), ConvertedActuator(connect("twin:ipmc"), TENFOLD)
    assert [str(channel) for channel in shown.outputs] == ["bend [cm]"]
    assert (shown.inputs, shown.tick) == (plain.inputs, plain.tick)
    raw, record = plain.apply(0.5, 3.0, 1.0), shown.apply(0.5, 3.0, 1.0)
    np.testing.assert_allclose(record.y, 1 + 10 * raw.y)
    np.testing.assert_array_equal(record.t, raw.t)
    assert str(record.output) == "bend [cm]"
    assert shown.exchange(0.2) == pytest.approx(1 + 10 * plain.exchange(0.2))
    assert (shown.answer_time(), shown.written(0.123456789)) == (0.0, 0.123456789)
    assert shown.description is None


def test_a_twin_can_still_be_restored_and_another_actuator_not():
    twin = ConvertedActuator(connect("twin:ipmc"), TENFOLD)
    state, first = twin.checkpoint(), twin.apply(1.0, 2.0, 1.0).y
    twin.restore(state)
    np.testing.assert_array_equal(twin.apply(1.0, 2.0, 1.0).y, first)
    assert isinstance(twin, Restorable)
    assert not isinstance(WrappedActuator(connect("twin:ipmc"), restorable=False), Restorable)


def test_a_conversion_that_covers_no_reading_is_refused_at_once():
    narrow = CalibrationTable(name="bend", unit="cm", readings=(1e3, 2e3), values=(0.0, 1.0))
    shown = ConvertedActuator(connect("twin:ipmc"), narrow)
    with pytest.raises(SignalError, match="covers none of the readings"):
        shown.apply(0.5, 3.0, 1.0)


def test_a_resumed_run_does_not_judge_its_first_hold_anew():
    narrow = CalibrationTable(name="bend", unit="cm", readings=(1e3, 2e3), values=(0.0, 1.0))
    shown = ConvertedActuator(connect("twin:ipmc"), narrow, begun=True)
    assert np.isnan(shown.apply(0.5, 3.0, 1.0).y).all()


def test_several_outputs_are_refused():
    class Two:
        outputs = connect("twin:ipmc").outputs * 2

    with pytest.raises(ParameterError, match="has 2 outputs; a conversion is for one"):
        ConvertedActuator(Two(), TENFOLD)

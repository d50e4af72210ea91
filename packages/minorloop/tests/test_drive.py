import numpy as np
import pytest

from minorloop.drive import Arrival, DriveResult, TargetDrive
from minorloop.errors import InstrumentError, ParameterError, UnreachableError
from minorloop.lab.actuator import Channel
from minorloop.lab.store import Point
from minorloop.operators.preisach import Preisach

MODEL = Preisach(np.linspace(-1.2, 1.2, 9), np.tril(np.full((8, 8), 0.24)), offset=0.5)
VOLTAGE = Channel("voltage", "V", -1.2, 1.2)
TARGETS = (3.0, -4.0, 6.0, 0.5, -7.0)


def drive(targets=TARGETS, **options):
    return TargetDrive(MODEL, np.asarray(targets), -1.2, **options)


def point(index, u, y, sd=0.0):
    return Point(
        index=index,
        input=u,
        value=y,
        sd=sd,
        verdict="settled",
        t=float(index),
        held=1.0,
        checkpoint=None,
        sample_interval=0.1,
        time_uncertainty=0.0,
    )


def driven(chosen, plant):
    """Carry a drive out on a function from memory and input to the measured output."""
    points, memory = [], "negative"
    while (u := chosen.choose(points)) is not None:
        y, memory = plant(memory, u)
        points.append(point(len(points), u, y))
    return chosen.result(points)


def test_open_loop_on_the_model_itself_meets_every_target():
    result = driven(drive(), MODEL.step)
    np.testing.assert_allclose(result.errors, 0, atol=1e-12)
    np.testing.assert_array_equal([a.target for a in result.arrivals], TARGETS)
    assert result.offset == 0
    assert [a.tries for a in result.arrivals] == [1] * 5


@pytest.mark.parametrize("absolute", [False, True])
def test_the_offset_of_a_sensor_is_found_and_subtracted(absolute):
    def shifted(memory, u):
        y, after = MODEL.step(memory, u)
        return y + 1.5, after

    result = driven(drive(TARGETS[:4], absolute=absolute), shifted)
    assert result.offset == pytest.approx(1.5)
    np.testing.assert_allclose(result.errors, 0, atol=1e-12)


def weak(memory, u):
    """A plant of 90 % of the model's output."""
    y, after = MODEL.step(memory, u)
    return 0.9 * y, after


@pytest.mark.parametrize(
    ("gain", "said"),
    [
        (0.1, "moves by 0.1 times what the model predicts; check the unit and the conversion"),
        (10, "moves by 10 times"),
        (-1, "moves by -1 times what the model predicts, with the opposite sign"),
    ],
)
@pytest.mark.parametrize("corrections", [0, 3])
def test_a_sensor_of_another_gain_ends_the_drive_at_the_first_target(gain, said, corrections):
    low = MODEL.step("negative", -1.2)[0]
    inputs = []

    def scaled(memory, u):
        inputs.append(u)
        y, after = MODEL.step(memory, u)
        return low + gain * (y - low), after

    with pytest.raises(InstrumentError, match=said):
        driven(drive(corrections=corrections), scaled)
    assert len(inputs) == 2


def test_targets_that_are_missed_are_counted_and_explained():
    result = driven(drive(), weak)
    assert result.allowed == pytest.approx(0.05 * np.subtract(*MODEL.range[::-1]))
    assert result.missed == [k for k, e in enumerate(result.errors) if abs(e) > result.allowed]
    assert 0 < len(result.missed) < 5
    assert f"{len(result.missed)} of 5 targets ended off by more than" in result.advice[0]
    assert "--corrections" in result.advice[0]
    assert driven(drive(nrmse=0.2), weak).advice == []
    missed = (Arrival(1.0, 0.0, 2.0, 0.0, 4, "settled"),)
    said = DriveResult(0.0, missed, 0.5, corrections=3).advice[0]
    assert "correct more often (--corrections, now 3)" in said
    corrected = driven(drive(corrections=8, within=1e-3), weak)
    assert corrected.missed == []
    assert corrected.summary()["worst"] <= 1e-3 < 0.3 < result.summary()["worst"]


def test_what_was_not_measured_is_tried_again_and_counts_as_not_reached():
    chosen = drive([1.0], corrections=1)
    points = [point(0, -1.2, MODEL.step("negative", -1.2)[0]), point(1, 0.3, np.nan)]
    again = chosen.choose(points)
    assert np.isfinite(again)
    result = chosen.result([*points, point(2, again, np.nan)])
    assert np.isnan(result.errors).all()
    assert result.summary() == {"rms": None, "worst": None}


def test_inputs_are_those_that_the_source_writes():
    result = driven(drive(written=lambda u: round(u, 2)), MODEL.step)
    inputs = np.array([a.input for a in result.arrivals])
    np.testing.assert_array_equal(inputs, inputs.round(2))


def test_a_stopped_drive_continues_with_the_same_inputs():
    chosen, points, memory = drive(corrections=2), [], "negative"
    while (u := chosen.choose(points)) is not None:
        again = TargetDrive.from_json(chosen.to_json(), written=float)
        assert again.choose(points) == u
        y, memory = weak(memory, u)
        points.append(point(len(points), u, y))


@pytest.mark.parametrize(
    ("targets", "said"),
    [
        ([1.0, 99.0], r"target at index 1 is 99 .* reaches -8.14 to 9.14 \(1 of 2 targets"),
        ([5.0, 12.0], r"target at index 1 is 12 .*adding -\S+ to every target would bring them in"),
        ([-10.0, 10.0], "the targets span more than that: give nearer ones"),
    ],
)
def test_targets_out_of_reach_are_refused_with_the_shift_that_helps(targets, said):
    with pytest.raises(UnreachableError, match=said):
        drive(targets).check(VOLTAGE)


def test_a_model_beyond_the_limits_of_the_actuator_is_refused():
    with pytest.raises(ParameterError, match=r"saturated at -1.2 V, .* limited to \[-1, 1\]"):
        drive().check(Channel("voltage", "V", -1.0, 1.0))

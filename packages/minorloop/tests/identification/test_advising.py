import numpy as np
import pytest

import minorloop as ml
from fault_records import INPUTS, record, sine
from fixed_options import Options, Plane, identify
from minorloop import Preisach, Record, Smooth, excitation
from minorloop.operators.densities import GaussianDensity
from plane_records import LEVELS, a_plane, a_record


def test_warnings_come_first_and_go_with_every_inverse():
    u, y = record()
    y[40:120] = y[40]
    found = identify(u, y, Plane(8), holdout=0.3)
    assert "the output is stuck" in found.warnings[0]
    assert found.advice[: len(found.warnings)] == found.warnings
    inverse = found.invert([0.0])
    assert inverse.warnings == found.warnings
    assert f"warning: {found.warnings[0]}" in str(inverse)
    assert "warning" not in str(found.model.invert([0.0]))


@pytest.mark.parametrize(
    ("u", "y", "says"),
    [
        (excitation.major_loop(LEVELS), None, "one major loop"),
        (LEVELS[[0, 10, 1, 9, 2, 8, 3, 7, 4, 6, 5]], None, "reversal points only"),
        (a_record(30)[0], None, "30 samples for 56 unknowns"),
    ],
)
def test_advice_names_a_poor_input(u, y, says):
    advice = " ".join(identify(u, a_plane().simulate(u), Plane(LEVELS)).advice)
    assert says in advice
    assert "no data were held out" in advice


def test_groups_that_differ_are_named():
    u, y = a_record(400)
    groups = np.arange(400) // 80
    same = " ".join(identify(Record(u, y, groups=groups), Plane(10)).advice)
    assert "no data were held out" not in same
    few = groups[::4]
    differ = identify(Record(u[:100], y[:100], groups=few), Plane(10), prior=Smooth(0.0))
    assert "the error on left-out groups" in " ".join(differ.advice)


def test_advice_names_a_falling_output():
    u, y = a_record(400)
    assert "reverse the sign of the output" in " ".join(identify(u, -y, Plane(10)).advice)
    assert "reverse the sign" not in " ".join(identify(u, y, Plane(10)).advice)


@pytest.mark.parametrize("shape", INPUTS)
def test_exchanged_columns_are_named_unless_weights_may_be_negative(shape):
    u, y = record(shape)
    says = "loops run clockwise"
    assert says in " ".join(identify(y, u, Plane(8), holdout=0.3).warnings)
    assert says not in " ".join(identify(u, y, Plane(8), holdout=0.3).warnings)
    assert says not in " ".join(identify(y, u, Plane(8, signed=True), holdout=0.3).warnings)


def test_an_output_that_comes_before_the_input_is_not_said_to_follow_it(shared_data):
    names = {"input": "Lead Actuator Displacment", "output": "Lead Actuator Force", "time": None}
    found = ml.identify(ml.read(shared_data / "structural_test_spc1.csv", **names))
    assert "loops run clockwise" in " ".join(found.warnings)
    assert "the output follows" not in " ".join(found.advice)


def advice(u, y, **options):
    return " ".join(
        Options.of({"levels": 8, "holdout": 0.3, **options}).identify(Record(u, y)).advice
    )


def test_a_startup_is_named_with_its_rows_and_its_share():
    u, y = record()
    y[:6] += np.ptp(y) * np.array([0.5, 0.4, 0.3, 0.2, 0.15, 0.1])
    found = identify(u, y, Plane(8), holdout=0.3)
    startup = found.residual.startup
    assert 4 <= startup.rows <= 10
    assert startup.share > 0.5
    assert f"skip={startup.rows} (--record skip={startup.rows})" in " ".join(found.advice)
    skipped = identify(Record(u, y, skip=startup.rows), Plane(8), holdout=0.3)
    assert skipped.residual.startup is None
    assert skipped.nrmse < 0.5 * found.nrmse


@pytest.mark.parametrize("shape", ["sine", "staircase", "levels"])
def test_a_sound_record_has_neither_startup_nor_drift(shape):
    said = advice(*record(shape))
    assert "start-up" not in said
    assert "drifts" not in said


def test_a_shift_of_the_sensor_is_named_with_its_row_and_size():
    u, y = record()
    first, size = int(0.55 * y.size), 0.05 * np.ptp(y)
    found = identify(u, y + size * (np.arange(y.size) >= first), Plane(16))
    assert found.residual.step.sample == first
    assert found.residual.step.size == pytest.approx(0.05, rel=0.4)
    said = " ".join(found.advice)
    assert f"from sample {first} on the output is shifted by +" in said
    assert "drifts" not in said
    assert "autocorrelation" not in said


def test_groups_that_differ_are_named_and_not_taken_for_rate_or_creep():
    u, y = record()
    groups = np.repeat(np.arange(4), y.size)
    u, y = np.tile(u, 4), np.tile(y, 4) * (1 + 0.03 * groups)
    found = identify(Record(u, y, curves=groups, start_of_curve="negative"), Plane(8))
    said = " ".join(found.advice)
    assert found.residual.groups.share > 0.5
    assert "the 4 groups differ from one another" in said
    assert "rate" not in said
    assert "drifts" not in said


def test_an_error_that_grows_with_the_loop_or_the_rate_is_named():
    noise = np.random.default_rng(0).normal(size=1000)
    u = sine()
    rate = np.abs(np.gradient(u))
    y = u + 0.1 * rate / rate.max() * noise[: u.size]
    assert "at fast inputs" in advice(u, y, slope=True, prior="none", holdout=0.0)
    once = np.concatenate([np.linspace(0, 1, 21), np.linspace(1, 0, 21)[1:]])
    sizes = np.repeat([0.2, 0.5, 1.0], 3 * once.size)
    u = sizes * np.tile(once, 9)
    y = u + 0.1 * sizes**2 * noise[: u.size]
    assert "at large loops" in advice(u, y, slope=True, prior="none", holdout=0.0)


@pytest.mark.parametrize("start", [None, "positive", "demagnetised"])
def test_curves_that_begin_with_another_memory_are_named(start):
    magnet = Preisach.from_density(np.linspace(-1, 1, 31), GaussianDensity(0.3, 0.3, 0.3))
    turn = np.cos(np.linspace(0, 2 * np.pi, 60))
    loops = [size * np.append(np.linspace(0, 1, 10), turn) for size in (0.3, 0.5, 0.7, 1.0)]
    y = np.concatenate([magnet.simulate(loop, "demagnetised") for loop in loops])
    y += 1e-3 * np.ptp(y) * np.random.default_rng(1000).normal(size=y.size)
    labels = np.repeat(np.arange(len(loops)), loops[0].size)
    found = identify(
        Record(np.concatenate(loops), y, curves=labels, start_of_curve=start), Plane(15)
    )
    said = any('start_of_curve="demagnetised"' in text for text in found.advice)
    assert said == (start != "demagnetised")

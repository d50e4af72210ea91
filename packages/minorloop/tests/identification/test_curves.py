import numpy as np
import pytest

from fixed_options import Options, Plane, identify
from minorloop import Memory, ParameterError, Record, SignalError, Smooth
from plane_records import LEVELS, a_plane

STARTS = ["negative", "positive", "demagnetised", Memory([-1.2, 0.5, 0.1])]
LABELS = np.repeat(np.arange(4), 120)


def curves_of(start, seed=0, **options):
    """Curves of a plane, each simulated alone from its start."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1.2, 1.2, LABELS.size)
    parts = [a_plane(**options).simulate(u[k == LABELS], start) for k in range(4)]
    return u, np.concatenate(parts)


@pytest.mark.parametrize("start", STARTS)
def test_curves_whose_memory_is_reset_are_fitted_exactly(start):
    u, y = curves_of(start)
    found = identify(Record(u, y, curves=LABELS, start_of_curve=start), Plane(LEVELS))
    assert found.nrmse < 1e-9
    np.testing.assert_allclose(found.prediction, y, atol=1e-7)
    np.testing.assert_allclose(found.predict(u, curves=LABELS), y, atol=1e-7)
    continued = identify(Record(u, y, curves=LABELS, start_of_curve="as-left"), Plane(LEVELS))
    assert continued.nrmse > 0.01


def test_a_lag_does_not_reach_into_the_previous_curve():
    u, y = curves_of("negative")
    late = np.concatenate(
        [np.r_[[y[k] for _ in range(3)], y[k : k + 117]] for k in range(0, 480, 120)]
    )
    found = identify(Record(u, late, curves=LABELS), Plane(LEVELS, lag="auto"))
    assert found.lag == 3
    assert found.samples == 4 * 117
    assert found.nrmse < 1e-9


def test_skipped_rows_set_the_memory_and_are_not_fitted():
    u, y = curves_of("negative")
    spoilt = y.copy()
    spoilt[np.arange(480) % 120 < 2] += 100.0
    found = identify(Record(u, spoilt, curves=LABELS, skip=2), Plane(LEVELS), prior=Smooth(0.0))
    assert (found.samples, found.skipped) == (4 * 118, 8)
    np.testing.assert_allclose(found.prediction, y, atol=1e-6)


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"curves": [1, 2]}, SignalError, "one label for each of 480 rows"),
        ({"groups": np.full(480, np.nan)}, SignalError, "groups is NaN at index 0"),
        ({"curves": np.arange(480)}, ParameterError, "480 groups of one row, the first is 0"),
        ({"curves": np.zeros(480), "slope": "auto"}, ParameterError, "rows are of one group"),
        (
            {"groups": np.where(np.arange(480) == 7, 9, np.arange(480) // 100)},
            ParameterError,
            "groups has 9 in one row only, at index 7; correct this label",
        ),
        (
            {"curves": np.tile(["A", "B"], 240)},
            ParameterError,
            "changes from row to row, A, B, A, B, and each change begins a curve",
        ),
        ({"start_of_curve": "negative"}, ParameterError, "without curves"),
        ({"curves": LABELS, "start_of_curve": "odd"}, ParameterError, "is 'odd'; give one of"),
        ({"skip": 480}, ParameterError, "whole rows from 0 to 479"),
        ({"skip": 478}, ParameterError, "skip leaves 2 measured rows"),
    ],
)
def test_refuses(options, error, says):
    with pytest.raises(error, match=says):
        Options.of({"levels": 5, **options}).identify(Record(*curves_of("negative")))

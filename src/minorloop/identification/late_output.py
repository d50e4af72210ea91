"""An output that follows its input late, beyond the hysteresis."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.rough_model import RecordFault, RoughRecord, few, least_error

LONGEST_LAG, _TURNS, _FEWEST_TURNS, _JUST_BEFORE = 10, (6, 4, 3), 4, 2
_BETTER, _BETTER_BY = 0.72, 0.007
"""Share of the error that a shift leaves, and spans that it gains, that tell of a lag."""
_OVERSHOOT, _OVERSHOOT_HINTED, _HINT = 0.02, 0.012, 0.85
"""Spans by which an output goes on that tell of a lag, fewer where a shift leaves that share."""


def lagging(record: RoughRecord, sound: BoolArray) -> Iterator[RecordFault]:
    """A shift with which the rough model does far better, or an output that turns late."""
    rows = np.flatnonzero(sound)
    size = record.y.size
    rows = few(rows[(rows >= LONGEST_LAG + record.lag) & (rows < size - LONGEST_LAG)])
    if rows.size < 2 * record.matrix.shape[1]:
        return
    shifts = range(-LONGEST_LAG, LONGEST_LAG + 1)
    errors = [least_error(record.matrix[rows - shift], record.y[rows]) for shift in shifts]
    here, best = errors[LONGEST_LAG], int(np.argmin(errors))
    shift = shifts[best]
    better = errors[best] < _BETTER * here and here - errors[best] > _BETTER_BY * record.span
    late, overshoot = _late(record)
    hinted = errors[best] < _HINT * here
    goes_on = overshoot > (_OVERSHOOT_HINTED if hinted and shift > 0 else _OVERSHOOT)
    if better and shift:
        why = (
            f"the error of a rough model falls from {here / record.span:.1%} to "
            f"{errors[best] / record.span:.1%} of range with it"
        )
    elif goes_on and not (hinted and shift < 0):
        shift = late
        why = f"it goes on by {overshoot:.1%} of range after the input has turned"
    else:
        return
    way = "follows" if shift > 0 else "comes before"
    more = " more" if record.lag else ""
    todo = "it may help to shift one of the two columns"
    if record.lag + shift > 0:
        todo = f'lag="auto" or lag={record.lag + shift} (--lag auto) takes it into account'
    yield RecordFault(
        "lag",
        (),
        f"the output {way} the input by about {abs(shift)}{more} samples, a lag that the model "
        f"does not have: {why}; {todo}",
    )


def _late(record: RoughRecord) -> tuple[int, float]:
    """How many samples the output goes on for after the input has turned, and how far, in spans.

    Without a lag an output that goes with its input turns with it, whatever its hysteresis.
    """
    sound = np.zeros(record.u.size, dtype=np.bool_)
    sound[record.places] = True
    for width in _TURNS:
        turns = _turns(record.u, sound, width)
        if turns.size >= _FEWEST_TURNS:
            break
    else:
        return 0, 0.0
    y = record.y
    before = np.sign(y[turns] - y[turns - _JUST_BEFORE])
    after = before * (y[turns[None, :] + np.arange(1, width + 1)[:, None]] - y[turns])
    # Without the largest, so that one odd turn is no lag.
    mean = np.sort(after, axis=1)[:, :-1].mean(axis=1) / record.span
    last = int(np.argmax(mean))
    return last + 1, float(mean[last])


def _turns(u: FloatArray, sound: BoolArray, width: int) -> IntArray:
    """Where the input turns after and before so many sound samples of one direction."""
    way = np.sign(np.diff(u))
    turns = np.flatnonzero((way[1:] != way[:-1]) & (way[1:] != 0)) + 1
    turns = turns[(turns >= width) & (turns < u.size - width)]
    around = turns[:, None] + np.arange(-width, width)
    same = way[around] * np.repeat([1, -1], width) == way[turns - 1, None]
    kept = same.all(axis=1) & sound[around].all(axis=1) & sound[turns + width]
    return np.asarray(turns[kept])

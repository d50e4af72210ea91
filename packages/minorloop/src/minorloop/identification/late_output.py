"""Detection of a lag between input and output, in addition to hysteresis."""

from collections.abc import Iterator

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.baseline import lateness
from minorloop.identification.rough_model import RoughRecord, few, least_error
from minorloop.lab.faults import Fault

LONGEST_LAG, _REVERSAL_WIDTH, _FEWEST_REVERSALS, _JUST_BEFORE = 10, 4, 4, 2
_BETTER, _BETTER_BY = 0.72, 0.007
"""A shift is a lag if it reduces the error to this share, and by this number of spans."""
_OVERSHOOT = 0.007
"""Overshoot after reversals, in spans, that shows a lag."""


def lagging(record: RoughRecord, sound: BoolArray, searched: bool) -> Iterator[Fault]:
    """Find a shift that makes the rough model much better, or an output that reverses late.

    If the lag was ``searched``, the cause is more than a lag. Loops must not run clockwise.
    """
    rows = np.flatnonzero(sound)
    size = record.y.size
    inside = record.curves.positions(size)[rows] >= LONGEST_LAG + record.lag
    inside &= record.curves.positions(size)[np.minimum(rows + LONGEST_LAG, size - 1)] >= LONGEST_LAG
    rows = few(rows[inside & (rows < size - LONGEST_LAG)])
    if rows.size < 2 * record.basis.columns:
        return
    shifts = range(-LONGEST_LAG, LONGEST_LAG + 1)
    errors = [least_error(record.basis.rows(rows - shift), record.y[rows]) for shift in shifts]
    here, best = errors[LONGEST_LAG], int(np.argmin(errors))
    shift = shifts[best]
    better = errors[best] < _BETTER * here and here - errors[best] > _BETTER_BY * record.span
    late, overshoot = _late(record)
    if better and shift:
        why = (
            f"the error of a rough model falls from {here / record.span:.1%} to "
            f"{errors[best] / record.span:.1%} of range with the lag"
        )
    elif overshoot > _OVERSHOOT and lateness(record.u, record.y, sound, record.curves) > 0:
        shift = late
        why = f"it continues by {overshoot:.1%} of range after the input has reversed"
    else:
        return
    way = "follows" if shift > 0 else "comes before"
    more = " more" if record.lag else ""
    todo = "it may help to shift one of the two columns"
    if searched and shift > 0:
        todo = (
            "a filter of the sensor or a slow source has this effect: change the input more slowly "
            "or record settled outputs"
        )
    elif record.lag + shift > 0:
        todo = f'lag="auto" or lag={record.lag + shift} (--law lag=auto) takes it into account'
    yield Fault(
        "lag",
        (),
        float(shift),
        f"the output {way} the input by about {abs(shift)}{more} samples, a lag that the model "
        f"does not have: {why}",
        todo,
    )


def _late(record: RoughRecord) -> tuple[int, float]:
    """Samples for which the output continues after a reversal of the input; overshoot in spans.

    Without a lag the output of any hysteresis reverses together with the input.
    """
    sound = np.zeros(record.u.size, dtype=np.bool_)
    sound[record.places] = True
    sound[record.curves.begins] = False
    width = _REVERSAL_WIDTH
    reversals = _reversals(record.u, sound, width)
    if reversals.size < _FEWEST_REVERSALS:
        return 0, 0.0
    y = record.y
    before = np.sign(y[reversals] - y[reversals - _JUST_BEFORE])
    after = before * (y[reversals[None, :] + np.arange(1, width + 1)[:, None]] - y[reversals])
    # Without the largest, so that a single unusual reversal does not count as a lag.
    mean = np.sort(after, axis=1)[:, :-1].mean(axis=1) / record.span
    last = int(np.argmax(mean))
    return last + 1, float(mean[last])


def _reversals(u: FloatArray, sound: BoolArray, width: int) -> IntArray:
    """Reversals of the input between ``width`` valid samples of one direction on either side."""
    way = np.sign(np.diff(u))
    reversals = np.flatnonzero((way[1:] != way[:-1]) & (way[1:] != 0)) + 1
    reversals = reversals[(reversals >= width) & (reversals < u.size - width)]
    around = reversals[:, None] + np.arange(-width, width)
    same = way[around] * np.repeat([1, -1], width) == way[reversals - 1, None]
    kept = same.all(axis=1) & sound[around].all(axis=1) & sound[reversals + width]
    return np.asarray(reversals[kept])

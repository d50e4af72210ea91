"""Find the intervals of a record in which rows are missing."""

import numpy as np

from minorloop.arrays import BoolArray, FloatArray

_NEAR = 3
"""Intervals on either side that an interval is compared with: of so many the median ignores one
that is long too, and four slow rows in a row are a rate of their own."""
_LONGER = 5.0
"""Ratio to those on both sides from which an interval is a gap, as in the times of a log."""


def isolated_long(steps: FloatArray) -> BoolArray:
    """Return which intervals are far longer than those before and those after.

    Where the rate of a record changes, intervals are as long as those on one side.

    Parameters
    ----------
    steps : (N,) array
        Intervals in seconds.

    Returns
    -------
    (N,) array of bool
    """
    if steps.size < 2:
        return np.zeros(steps.size, dtype=np.bool_)
    nothing = np.full(_NEAR, np.nan)
    windows = np.lib.stride_tricks.sliding_window_view
    near = windows(np.concatenate([nothing, steps, nothing]), _NEAR)
    before, after = near[: steps.size].copy(), near[_NEAR + 1 :].copy()
    # At an end of the record the intervals on the other side count.
    before[0], after[-1] = after[0], before[-1]
    usual = np.maximum(np.nanmedian(before, axis=1), np.nanmedian(after, axis=1))
    return np.asarray(steps > _LONGER * usual)

"""Advice on the residual of a fit: what it shows, and what to do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from minorloop.errors import are, counted
from minorloop.identification.residuals import (
    PARTS,
    GroupDifference,
    OffsetStep,
    ResidualSummary,
    Startup,
)

if TYPE_CHECKING:
    from minorloop.identification.fitted import Fit

_LEAST_DRIFT = 0.005
"""Least drift or step that is reported, in ranges."""
_SHOWN = 6
_ALIKE, _LEAST_ERROR = 0.8, 0.005
"""Autocorrelation of a residual that is no noise; and its least size in ranges."""
_UNEVEN = 2.5
"""Ratio of the errors of parts that is reported."""
_BEGIN, _TOGETHER = 10, 0.6
"""The first rows of a curve are one in so many; and their mean error, over that of all rows, from
which they are off together: without noise or misfit in common it is far below."""
_CONSTANT = 1.5
"""Ratio of amplitudes or rates below which they are all alike."""


def residual_advice(result: Fit) -> Iterator[str]:
    """Give sentences about the residual; none where nothing is unusual."""
    found = result.residual
    if found.startup is not None:
        yield _startup_text(found.startup)
    if found.outliers:
        yield _outliers_text(found.outliers, result)
    if found.step is not None and abs(found.step.size) > _LEAST_DRIFT:
        yield _step_text(found.step)
    if abs(found.drift) > _LEAST_DRIFT:
        yield (
            f"the output drifts by {abs(found.drift):.2%} of range along the record: let "
            "actuator and sensor warm up and measure again, or subtract the drift from the output"
        )
    if result.nrmse < _LEAST_ERROR:
        return
    yield from _starts(result)
    if found.groups is not None:
        yield _groups_text(found.groups)
    yield from _uneven(found, result)
    explained = found.groups or found.step or found.drift
    if found.autocorrelation > _ALIKE and not explained:
        yield (
            f"neighbouring residuals are alike (autocorrelation {found.autocorrelation:.2f}), so "
            f"they are an error of the model and no noise: {_remedy(result)}"
        )


def _remedy(result: Fit) -> str:
    if any(choice.name == "structure" for choice in result.choices):
        more = (
            "; Dynamics() (--time COLUMN --dynamics auto) shows whether rate or creep"
            if result.measured is None
            else ""
        )
        return (
            "the options that were compared do not remove it, so it may depend on the rate, creep "
            f"or temperature{more}"
        )
    lag = "" if result.searched else ' or lag="auto" (--lag auto)'
    return f'other levels, slope="auto" (--slope){lag} may reduce it'


def _startup_text(startup: Startup) -> str:
    first = "the first row is" if startup.rows == 1 else f"the first {startup.rows} rows are"
    has = "has" if startup.rows == 1 else "have"
    return (
        f"{first} off by up to {startup.largest:.1%} of range and {has} {startup.share:.0%} of the "
        "squared error, a start-up that the model does not follow: let them set the memory without "
        f"being fitted, skip={startup.rows} (--skip {startup.rows}), or give the start state that "
        "the record has"
    )


def _starts(result: Fit) -> Iterator[str]:
    """Say that the first rows of curves are off together, as where another memory came before."""
    curves, start = result.curves, result.start
    if curves.begins.size == 1 or not isinstance(start, str):
        return
    rows = np.flatnonzero(result.fitted)
    position = curves.positions(result.u.size)
    length = np.diff(np.append(curves.begins, result.u.size))
    first = rows[position[rows] * _BEGIN < np.repeat(length, length)[rows]]
    if not first.size:
        return
    off = float((result.prediction - result.y)[first].mean()) / result.span(result.fitted)
    if abs(off) >= max(_TOGETHER * result.nrmse, _LEAST_ERROR):
        others = [name for name in ("negative", "positive", "demagnetised") if name != start]
        yield (
            f"the first rows of the curves are off together, by {-off:+.2%} of range in the mean: "
            f"the memory before them may not be {start!r}; try "
            f'start_of_curve="{others[1]}" or "{others[0]}" (--start-of-curve)'
        )


def _outliers_text(samples: tuple[int, ...], result: Fit) -> str:
    shown = ", ".join(f"sample {k} ({result.y[k]:.6g})" for k in samples[:_SHOWN])
    more = f" and {len(samples) - _SHOWN} more" if len(samples) > _SHOWN else ""
    one = len(samples) == 1
    return (
        f"{counted(len(samples), 'reading')} {are(len(samples))} far from the model and from the "
        f"readings around {'it' if one else 'them'}: {shown}{more}; empty "
        f"{'this cell, which then counts' if one else 'these cells, which then count'} as not "
        "measured, and check the cable and the trigger of the sensor"
    )


def _step_text(step: OffsetStep) -> str:
    return (
        f"from sample {step.sample} on the output is shifted by {step.size:+.2%} of range: the "
        "sensor or its mount moved, or its zero was set anew; identify the rows before and behind "
        "apart (--rows), or subtract the shift from the output"
    )


def _groups_text(found: GroupDifference) -> str:
    gains = f" and gains of up to {found.gain:.1%}" if found.gain else ""
    return (
        f"the {found.groups} groups differ from one another, by offsets of up to "
        f"{found.offset:.2%} of range{gains}, which are "
        f"{found.share:.0%} of the squared error: no option of one model removes it; identify each "
        "group by itself (minorloop fleet identify), or correct the offset of the sensor"
    )


def _uneven(found: ResidualSummary, result: Fit) -> Iterator[str]:
    """Say at which amplitudes and rates the error is large."""
    for parts, small, large, todo in (
        (
            found.by_amplitude,
            "small loops",
            "large loops",
            "measure more loops of that size, or use more levels",
        ),
        (
            found.by_rate,
            "slow inputs",
            "fast inputs",
            "measure at the rate that you will use"
            + ("" if result.searched else ', try lag="auto" (--lag auto)')
            + ", or add linear dynamics",
        ),
    ):
        if len(parts) < PARTS or parts[-1][0] <= _CONSTANT * parts[0][1]:
            continue
        first, last = parts[0][2], parts[-1][2]
        if max(first, last) >= _UNEVEN * min(first, last):
            where = large if last > first else small
            yield (
                f"the error is {max(first, last):.2%} of range at {where} and "
                f"{min(first, last):.2%} at {large if where == small else small}: {todo}"
            )

"""Errors of a model against measured outputs, in the measures that different fields use."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.identification.baseline import percent
from minorloop.identification.curves import Curves
from minorloop.identification.loops import closed_loops, loop_areas

_MOST_CURVES = 10
"""Most rows of a table of curves; of more curves, it shows those with the largest errors."""
_CURVE_COLUMNS = ("curve", "samples", "error", "of its rms", "worst", "loop area", "left out")
_CurveTable: TypeAlias = tuple[tuple[str, ...], list[tuple[str, ...]], str]
"""Headings, rows and title of a table of curves."""


@dataclass(frozen=True)
class Accuracy:
    """Errors of a model on some samples of a record."""

    samples: int
    """Samples that are scored."""
    rmse: float
    """Root-mean-square error, in the unit of the output."""
    nrmse: float
    """`rmse` over the range of the output."""
    relative_rms: float
    """`rmse` over the root-mean-square of the output. It depends on the zero of the output; its
    square is the relative square error."""
    worst: float
    """The largest error, model less measured, over the range of the output."""
    worst_sample: int
    """Sample of the largest error."""
    loops: int
    """Closed loops among the samples, as `closed_loops` finds them."""
    loop_area: float | None
    """Sum of the absolute errors of their areas over the sum of their measured areas; None without
    closed loops."""


@dataclass(frozen=True)
class CurveAccuracy:
    """Errors of a model on one curve of a record."""

    name: str
    """Label of the curve."""
    first: int
    """First row of the curve."""
    accuracy: Accuracy
    """Errors on its fitted and held-out samples, over the range of the whole record."""
    left_out: float | None
    """Root-mean-square error of a fit without the group of the curve, over the same range; None
    where groups were not left out."""


def accuracy(
    u: FloatArray,
    y: FloatArray,
    predicted: FloatArray,
    scored: BoolArray,
    curves: Curves,
    span: float | None = None,
) -> Accuracy:
    """Return the errors of predicted outputs.

    ``u``, ``y`` and ``predicted`` (T,): inputs, measured and predicted outputs; ``scored`` (T,) of
    bool: samples to score, at least one; others may be NaN; ``curves``: parts of the record;
    ``span``: range of the output; by default the range of the scored samples.
    """
    measured = y[scored]
    error = predicted[scored] - measured
    width = (float(np.ptp(measured)) if span is None else span) or 1.0
    worst = int(np.argmax(np.abs(error)))
    rmse = float(np.sqrt(np.mean(error**2)))
    loops = closed_loops(u, scored, curves)
    areas = loop_areas(u, y, loops)
    off, whole = np.abs(loop_areas(u, predicted, loops) - areas).sum(), np.abs(areas).sum()
    return Accuracy(
        samples=error.size,
        rmse=rmse,
        nrmse=rmse / width,
        relative_rms=rmse / (float(np.sqrt(np.mean(measured**2))) or 1.0),
        worst=float(error[worst]) / width,
        worst_sample=int(np.flatnonzero(scored)[worst]),
        loops=len(loops),
        loop_area=float(off / whole) if whole else None,
    )


def by_curve(
    u: FloatArray,
    y: FloatArray,
    predicted: FloatArray,
    scored: BoolArray,
    curves: Curves,
    left_out: FloatArray | None = None,
) -> tuple[CurveAccuracy, ...]:
    """Return the errors on each curve that has scored samples, in the order of the record.

    ``u``, ``y``, ``predicted``, ``scored``, ``curves`` are as of `accuracy`; ``left_out`` (T,):
    outputs predicted without the group of each row, or NaN.
    """
    span, found = float(np.ptp(y[scored])), []
    for number, (first, last) in enumerate(curves.parts(u.size)):
        rows = slice(first, last)
        if not scored[rows].any():
            continue
        own = Curves.whole(curves.start)
        errors = accuracy(u[rows], y[rows], predicted[rows], scored[rows], own, span)
        errors = replace(errors, worst_sample=errors.worst_sample + first)
        off = None if left_out is None else (left_out - y)[rows]
        found.append(CurveAccuracy(curves.name(number), first, errors, _rms(off, span)))
    return tuple(found)


def _rms(error: FloatArray | None, span: float) -> float | None:
    """Root-mean-square of the finite errors over a range; None if no error is finite."""
    known = np.zeros(0) if error is None else error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2)) / (span or 1.0)) if known.size else None


def worst_error(errors: Accuracy, sample: str = "") -> str:
    """Return the largest error and its sample; an error that rounds to zero is only 0.0%."""
    return f"{errors.worst:+.1%}{sample}" if abs(errors.worst) >= 0.0005 else "0.0%"


def curve_table(curves: Sequence[CurveAccuracy]) -> _CurveTable:
    """Return headings, rows and title of a table of errors on each curve or group.

    Of more than ten curves, these are the ten with the largest errors, the largest first. The last
    column is the error of a fit without the curve or its group, where there is one.
    """
    shown, columns = list(curves), len(_CURVE_COLUMNS)
    if all(one.left_out is None for one in curves):
        columns -= 1
    which = "by curve"
    if len(curves) > _MOST_CURVES:
        shown.sort(key=lambda one: -one.accuracy.nrmse)
        which = f"the {_MOST_CURVES} largest of {len(curves)} curves"
    rows = [_curve_row(one)[:columns] for one in shown[:_MOST_CURVES]]
    return _CURVE_COLUMNS[:columns], rows, f"errors over the range of the record, {which}"


def _curve_row(curve: CurveAccuracy) -> tuple[str, ...]:
    errors = curve.accuracy
    return (
        curve.name,
        f"{errors.samples}",
        percent(errors.nrmse),
        percent(errors.relative_rms),
        worst_error(errors),
        "-" if errors.loop_area is None else percent(errors.loop_area),
        "-" if curve.left_out is None else percent(curve.left_out),
    )

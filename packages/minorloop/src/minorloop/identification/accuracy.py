"""How near a model is to measured outputs, in the figures that different fields compare by."""

from dataclasses import dataclass, replace

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.identification.curves import Curves
from minorloop.identification.loops import closed_loops, loop_areas


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
    """`rmse` over the root-mean-square of the output, which depends on the zero of the output; its
    square is the relative square error."""
    worst: float
    """The largest error, model less measured, over the range of the output."""
    worst_sample: int
    """Its sample."""
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
    """Its first row."""
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

    Parameters
    ----------
    u, y, predicted : (T,) arrays
        Inputs, measured and predicted outputs.
    scored : (T,) array of bool
        Samples that are scored, at least one; others may be NaN.
    curves : Curves
        Parts of the record.
    span : float, optional
        Range of the output; that of the scored samples if not given.
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

    Parameters
    ----------
    u, y, predicted, scored, curves
        As of `accuracy`.
    left_out : (T,) array, optional
        Outputs predicted without the group of each row; NaN where there are none.
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


def scores_of(fitted: Accuracy, held_out: Accuracy | None) -> dict[str, float | None]:
    """Return the errors by name, as model files and ``--json`` have them.

    All errors on held-out samples are None if none were held out.
    """
    return {
        f"{name}_{part}": None if errors is None else getattr(errors, name)
        for name in ("nrmse", "relative_rms", "worst", "loop_area")
        for part, errors in (("train", fitted), ("holdout", held_out))
    }


def _rms(error: FloatArray | None, span: float) -> float | None:
    """Root-mean-square of the errors that are known, over a range; None if there are none."""
    known = np.zeros(0) if error is None else error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2)) / (span or 1.0)) if known.size else None

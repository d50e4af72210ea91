"""Scores of an identification as text for tables."""

from collections.abc import Sequence
from math import isfinite
from typing import TypeAlias

from minorloop.errors import counted
from minorloop.identification.accuracy import Accuracy, CurveAccuracy
from minorloop.identification.baseline import percent
from minorloop.identification.fitted import Fit

MOST_CURVES = 10
"""Curves up to which each has a row; of more, those with the largest errors."""
_CURVE_COLUMNS = ("curve", "samples", "error", "of its rms", "worst", "loop area", "left out")
CurveTable: TypeAlias = tuple[tuple[str, ...], list[tuple[str, ...]], str]
"""Headings, rows and title of a table of curves."""

OF_OPERATOR = (
    *("samples fitted", "samples held out", "rows skipped", "unknowns", "free parameters"),
    *("effective parameters", "rank", "cells excited", "optimality (KKT)"),
)
"""Rows about the operator that are shown beside dynamics."""


def score_rows(found: Fit, *, rank: str = "") -> list[tuple[str, str]]:
    """Return the scores as rows of a table, label and value.

    Parameters
    ----------
    found : Fit
        The identification.
    rank : str
        Text of the row ``rank``, which takes minutes to compute for large models; no row if empty.
    """
    held = int(found.held_out.sum())
    share = found.holdout_nrmse
    return [
        ("error on fitted data", f"{percent(found.nrmse)} of range"),
        ("error on held-out data", "-" if share is None else f"{percent(share)} of range"),
        *_group_row(found),
        ("best delayed polynomial", f"{percent(found.baseline_nrmse)} of range"),
        *accuracy_rows(found.accuracy, found.holdout_accuracy),
        ("lag", counted(found.lag, "sample")),
        ("samples fitted", f"{found.samples}"),
        *([("samples held out", f"{held}")] if held else []),
        *([("rows skipped", f"{found.skipped}")] if found.skipped else []),
        *([("jumps at", ", ".join(map(str, found.jumps)))] if found.jumps else []),
        *([("mean of the prior", f"{found.ridge.kind} ridge")] if found.ridge else []),
        ("unknowns", f"{found.unknowns}"),
        ("free parameters", f"{found.free_parameters}"),
        *_effective_row(found),
        *([("rank", rank)] if rank else []),
        ("cells excited", f"{found.excited_fraction:.0%}"),
        ("optimality (KKT)", f"{found.kkt:.1e}{'' if found.converged else ', not converged'}"),
        *_residual_rows(found),
    ]


def _effective_row(found: Fit) -> list[tuple[str, str]]:
    number = found.effective_parameters
    return [] if number is None else [("effective parameters", f"{number:.1f}")]


def accuracy_rows(fitted: Accuracy, held_out: Accuracy | None) -> list[tuple[str, str]]:
    """Return the errors on fitted and on held-out samples but for nrmse, as rows of a table."""
    errors = {"": fitted, ", held out": held_out}
    rows = [
        (f"relative rms{where}", f"{percent(one.relative_rms)} of rms")
        for where, one in errors.items()
        if one is not None
    ]
    rows += [
        (f"loop area{where}", f"{percent(one.loop_area)} off, {counted(one.loops, 'loop')}")
        for where, one in errors.items()
        if one is not None and one.loop_area is not None
    ]
    return rows + [
        (f"worst error{where}", worst_error(one, f", sample {one.worst_sample}"))
        for where, one in errors.items()
        if one is not None
    ]


def worst_error(errors: Accuracy, sample: str = "") -> str:
    """Return the largest error and its sample; what rounds to zero has no sign and no sample."""
    return f"{errors.worst:+.1%}{sample}" if abs(errors.worst) >= 0.0005 else "0.0%"


def curve_table(curves: Sequence[CurveAccuracy]) -> CurveTable:
    """Return headings, rows and title of a table of errors on each curve or group.

    Of more than ten curves, these are the ten with the largest errors, the largest first. The last
    column is the error of a fit without the curve or its group, where there is one.
    """
    shown, columns = list(curves), len(_CURVE_COLUMNS)
    if all(one.left_out is None for one in curves):
        columns -= 1
    which = "by curve"
    if len(curves) > MOST_CURVES:
        shown.sort(key=lambda one: -one.accuracy.nrmse)
        which = f"the {MOST_CURVES} largest of {len(curves)} curves"
    rows = [_curve_row(one)[:columns] for one in shown[:MOST_CURVES]]
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


def _group_row(found: Fit) -> list[tuple[str, str]]:
    if found.groups_nrmse is None:
        return []
    return [("error on left-out groups", f"{percent(found.groups_nrmse)} of range")]


def _residual_rows(found: Fit) -> list[tuple[str, str]]:
    residual, rows = found.residual, []
    if residual.startup is not None:
        rows.append(("start-up", counted(residual.startup.rows, "row")))
    if isfinite(residual.autocorrelation):
        rows.append(("residual autocorrelation", f"{residual.autocorrelation:.2f}"))
    return rows

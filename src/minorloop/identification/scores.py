"""Scores of an identification as text for tables."""

from __future__ import annotations

from math import isfinite

from minorloop.errors import counted
from minorloop.identification.baseline import percent
from minorloop.identification.fitted import Fit


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
        ("lag", counted(found.lag, "sample")),
        ("samples fitted", f"{found.samples}"),
        *([("samples held out", f"{held}")] if held else []),
        *([("rows skipped", f"{found.skipped}")] if found.skipped else []),
        ("unknowns", f"{found.unknowns}"),
        *([("rank", rank)] if rank else []),
        ("cells excited", f"{found.excited_fraction:.0%}"),
        ("optimality (KKT)", f"{found.kkt:.1e}{'' if found.converged else ', not converged'}"),
        *_residual_rows(found),
    ]


def _group_row(found: Fit) -> list[tuple[str, str]]:
    if found.groups_nrmse is None:
        return []
    return [("error on left-out groups", f"{percent(found.groups_nrmse)} of range")]


def _residual_rows(found: Fit) -> list[tuple[str, str]]:
    residual = found.residual
    rows = [("worst error", f"{residual.worst:+.1%}, sample {residual.worst_sample}")]
    if residual.startup is not None:
        rows.append(("start-up", counted(residual.startup.rows, "row")))
    if isfinite(residual.autocorrelation):
        rows.append(("residual autocorrelation", f"{residual.autocorrelation:.2f}"))
    return rows

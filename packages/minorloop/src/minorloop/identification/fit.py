"""Identify a Preisach model from a record."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from minorloop.arrays import IntArray, Levels, check_option
from minorloop.errors import ParameterError, counted
from minorloop.identification import record_checks as checks
from minorloop.identification.choosing import LEVELS, Chosen, choose
from minorloop.identification.curves import StartOfCurve, as_curves, as_groups, check_group_sizes
from minorloop.identification.design_matrix import MOST_DENSE, PlaneSpec
from minorloop.identification.fitting import (
    FitOptions,
    FitRecord,
    Mean,
    Regularisation,
    fit_plane,
)
from minorloop.identification.jumps import (
    Jump,
    find_jumps,
    in_narrow_bands,
    narrow_bands,
    with_jumps,
)
from minorloop.identification.leave_out import check_several_groups, validate
from minorloop.identification.preparation import identify_log
from minorloop.identification.result import Identification
from minorloop.lab.logs import Log
from minorloop.lab.records import Record
from minorloop.operators.memory import Start
from minorloop.operators.plane import RELAYS, Relay
from minorloop.operators.preisach import Diagonal
from minorloop.threads import one_thread


@one_thread()
def identify(
    u: npt.ArrayLike | Log | Record,
    y: npt.ArrayLike | None = None,
    *,
    levels: int | npt.ArrayLike | Literal["auto"] = "auto",
    spacing: Literal["uniform", "adaptive"] = "uniform",
    relay: Relay | Literal["auto"] = "bipolar",
    diagonal: Diagonal | Literal["auto"] = "auto",
    slope: bool | Literal["auto"] = "auto",
    signed: bool = False,
    smoothness: float | Literal["auto"] = "auto",
    prior: Regularisation = "auto",
    noise: float | npt.ArrayLike | None = None,
    mean: Mean = "zero",
    lag: int | str = "auto",
    start: Start = "negative",
    offset: bool = True,
    holdout: float = 0.0,
    curves: npt.ArrayLike | None = None,
    start_of_curve: StartOfCurve | None = None,
    groups: npt.ArrayLike | None = None,
    skip: int = 0,
    interval: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Identification:
    """Identify a Preisach model from inputs and measured outputs.

    Constrained least squares on exact areas, partly covered cells included. Weights are not
    negative unless ``signed``, so that the model is monotone and can be inverted.

    Parameters
    ----------
    u : (T,) array_like, Log or Record
        Inputs applied, in order; or a record with inputs and outputs, as `minorloop.read` returns
        it, whose times, curves, groups and standard deviations are used.
    y : (T,) array_like
        Outputs, not with a record; NaN where an input was applied and nothing was measured.
        Overload codes and sentinels such as 9.9e37 and -9999, far from all other outputs, count as
        not measured; they are listed in ``codes`` and in the advice.
    levels : int, (L + 1,) array_like or "auto"
        Number of bands, over the range of ``u``, or the thresholds themselves. ``"auto"`` compares
        25 and 50 bands, where there are samples for so many. Unless ``prior`` is ``"gaussian"``, a
        threshold at which the output jumps gets a narrow band of its own; thresholds that are given
        are used as they are, with the jumps that are in narrow bands of them.
    spacing : {"uniform", "adaptive"}
        Even thresholds, or thresholds that are denser where the output is steep.
    relay, diagonal
        As in `Preisach`, or ``"auto"``.
    slope : bool or "auto"
        Whether to fit a memoryless linear part. Options that are ``"auto"`` are compared by the
        error on left-out groups, or on contiguous parts of a record without groups. The results
        are in ``choices``. The prior is not compared so: parts within a record say little about
        inputs beyond it.
    signed : bool
        Whether weights and slope may be negative, for example for butterfly loops.
    smoothness : float or "auto"
        Strength of the penalty on differences between neighbouring cells, defined in
        `minorloop.identification.least_squares`; 0.0 for none. ``"auto"`` chooses by prediction
        of contiguous segments held out of the fitted samples.
    prior : {"auto", "gaussian", "none"}
        Whether to fit with the prior of `minorloop.identification.prior`. ``"auto"`` does, except
        where a smoothness is given, where the output jumps, where the samples determine a plane
        that reproduces them to rounding, for more than 300 bands, or where the input reverses so
        often that a plane of more than 64 levels would need large dense matrices; for 51 to 64
        levels and such an input, only for fewer than three samples per unknown or where more than a
        tenth of the cells is not excited.
    noise : float or (T,) array_like, optional
        Standard deviation of the measured outputs, in their unit, where it is known. One number is
        used by the prior only. Of an array, one for each output, NaN where it is not known and
        then the greatest, each output has the weight 1 / (sd^2 + m^2), where m is the error of the
        model itself, from its residual.
    mean : {"zero", "ridge"}
        Mean of the prior. ``"ridge"``: a parametric ridge fitted to the record, of the kind of
        greatest marginal likelihood, or zero if none is more likely; about it the weights vary. It
        helps where the record leaves much of the plane open, such as one major loop; the record is
        then fitted with the prior.
    lag : int, str or "auto"
        Whole samples by which y follows u; ``"auto"`` tries 0 to 20 on the fitted samples, and
        keeps the best if it reduces the error on left-out parts by a fifth; 0 otherwise. A record
        with times may have a lag in seconds, such as ``"3 ms"``.
    start : {"negative", "positive", "demagnetised"} or Memory
        Memory before the first sample.
    offset : bool
        Whether to fit an offset.
    holdout : float
        Share of the measured samples, at the end of the record, that is not fitted but scored;
        from 0 to 0.9.
    curves : (T,) array_like, optional
        Label of the curve of each row, such as its number. Where the label changes, the memory is
        reset. Curves are also groups, unless ``groups`` are given.
    start_of_curve : {"negative", "positive", "demagnetised", "as-left"} or Memory, optional
        Memory before each curve, the first included; ``start`` if not given. ``"as-left"``: the
        memory that the previous curve left.
    groups : (T,) array_like, optional
        Label of the group of each row, such as its specimen. Each group is predicted by a fit to
        the others, and bands include the scatter of three or more groups.
    skip : int
        Rows at the start of the record, and of each curve, that set the memory and are not fitted.
    interval : float, optional
        Sampling interval in seconds, so that the lag is known in seconds too.
    progress : callable, optional
        Called with what is done next, as text.

    Raises
    ------
    SignalError
        If lengths differ, fewer than three outputs are finite, or the input or the output
        never changes.
    ParameterError
        If an option is out of its range.

    References
    ----------
    Tan and Baras, Automatica 40, 2004: weights of a discretised plane by constrained least
    squares.
    """
    if isinstance(u, Log | Record):
        options = {name: value for name, value in locals().items() if name not in ("u", "y")}
        if y is not None:
            raise ParameterError(
                "y is given beside a record, which has its own outputs; leave it out"
            )
        log = u if isinstance(u, Log) else Log.of(u)
        identification: Identification = identify_log(log, identify, options)
        return identification
    if y is None:
        raise ParameterError("y is missing; give the outputs, or a record of minorloop.read")
    inputs, outputs, coded = checks.checked_record(u, y)
    check_option("spacing", spacing, ("uniform", "adaptive"))
    check_option("relay", relay, (*RELAYS, "auto"))
    check_option("diagonal", diagonal, ("uniform", "reversible", "auto"))
    checks.check_flags(slope=False if slope == "auto" else slope, signed=signed, offset=offset)
    check_option("mean", mean, get_args(Mean))
    checks.check_prior(prior, smoothness, mean)
    if mean == "ridge":
        prior = "gaussian"
    parts = as_curves(curves, inputs.size, start, start_of_curve)
    group = _as_groups(curves, groups, inputs.size)
    skipped = checks.as_skip(skip, parts.positions(inputs.size))
    checks.check_interval(interval)
    fitted, held_out = checks.split(outputs, holdout, len(coded), skipped)
    if group is not None:
        check_several_groups(group[fitted])
    sensor, sd = checks.as_noise(noise, fitted)
    record = FitRecord(inputs, outputs, fitted, parts, bool(signed), sd, noise=sensor)
    grids = _grids(record, levels, spacing)
    specs = _structures(grids[0], relay, diagonal, slope, bool(offset))
    automatic = len(specs) > 1 or len(grids) > 1
    delay = None if lag == "auto" else checks.as_lag(lag, inputs.size)
    say = progress or (lambda stage: None)
    chosen = Chosen(specs[0], delay or 0, ())
    if automatic or delay is None:
        chosen = choose(specs, record, delay, group, grids[1] if len(grids) > 1 else None, say)
    spec, delay = chosen.spec, chosen.lag
    jumps: tuple[Jump, ...] = ()
    if prior != "gaussian":
        fixed = not (isinstance(levels, str) or np.isscalar(levels))
        jumps, thresholds = _jumps(record, delay, spec.levels, fixed)
        if jumps and thresholds.size - 1 <= MOST_DENSE:
            spec, prior = replace(spec, levels=thresholds), "none"
    say(f"fitting {counted(spec.cells, 'cell')} to {counted(int(fitted.sum()), 'sample')}")
    how = FitOptions(smoothness, prior, sensor, mean, grouped=group is not None)
    found = fit_plane(spec, record, delay, how, group, say)
    left_out = None if group is None else validate(record, found, delay, group, say)
    return Identification(
        model=spec.model(found.x),
        lag=delay,
        curves=parts,
        smoothness=found.smoothness,
        kkt=found.kkt,
        converged=found.converged,
        u=inputs,
        y=outputs,
        fitted=found.fitted,
        held_out=held_out,
        regression=found.regression,
        posterior=found.posterior,
        suspects=found.suspects,
        codes=coded,
        searched=lag == "auto",
        left_out=left_out,
        groups=group,
        interval=interval,
        skipped=int(np.count_nonzero(skipped)),
        choices=chosen.choices,
        jumps=jumps,
        ridge=found.ridge,
    )


def _grids(
    record: FitRecord, levels: int | npt.ArrayLike | Literal["auto"], spacing: str
) -> list[Levels]:
    """Thresholds, or those to compare."""
    known = np.where(record.fitted, record.y, np.nan)
    counts = [LEVELS, 2 * LEVELS] if isinstance(levels, str) and levels == "auto" else [levels]
    return [checks.grid(record.u, known, count, spacing) for count in counts]


def _structures(
    levels: Levels,
    relay: Relay | Literal["auto"],
    diagonal: Diagonal | Literal["auto"],
    slope: bool | Literal["auto"],
    offset: bool,
) -> list[PlaneSpec]:
    """Structures to compare, the simplest first.

    With an offset, both kinds of relays predict the same. A reversible diagonal contains the slope
    within the levels.
    """
    relays: list[Any] = [relay] if relay != "auto" else ["bipolar"] if offset else list(RELAYS)
    diagonals: list[Any] = ["uniform", "reversible"] if diagonal == "auto" else [diagonal]
    slopes = [False, True] if slope == "auto" else [bool(slope)]
    return [
        PlaneSpec(levels, relay=kind, diagonal=shape, offset=offset, slope=linear)
        for kind, shape, linear in product(relays, diagonals, slopes)
        if not (linear and slope == "auto" and shape == "reversible")
    ]


def _jumps(
    record: FitRecord, lag: int, levels: Levels, given: bool
) -> tuple[tuple[Jump, ...], Levels]:
    """Jumps of the output, and levels with narrow bands around them; given levels stay."""
    if given and not narrow_bands(levels).size:
        return (), levels
    u, parts = record.curves.delayed(record.u, lag), record.curves
    jumps = find_jumps(u, record.y, record.fitted, parts, levels)
    if given:
        return in_narrow_bands(jumps, levels), levels
    return jumps, with_jumps(levels, jumps) if jumps else levels


def _as_groups(
    curves: npt.ArrayLike | None, groups: npt.ArrayLike | None, samples: int
) -> IntArray | None:
    """Number of the group of each row; curves are groups if there are no others."""
    labels, name = (curves, "curves") if groups is None else (groups, "groups")
    if labels is None:
        return None
    number = as_groups(name, labels, samples)
    check_group_sizes(name, number, np.unique(np.asarray(labels)).tolist())
    return number

"""Identify a Preisach model from a record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    BoolArray,
    FloatArray,
    Levels,
    as_finite,
    as_levels,
    as_samples,
    check_option,
)
from minorloop.errors import ParameterError, SignalError
from minorloop.identification.active_set import ACCEPTABLE
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec, check_bands
from minorloop.identification.least_squares import FittedUnknowns, Problem, reproduces
from minorloop.identification.levels import levels_for
from minorloop.identification.prior import (
    MOST_CORRELATED,
    Posterior,
    PriorFit,
    coarse_rows,
    fit_dense,
    fit_prior,
    regressors,
)
from minorloop.identification.result import Identification
from minorloop.identification.screening import OVERLOAD, Code, codes
from minorloop.operators.memory import Start
from minorloop.operators.plane import Relay
from minorloop.operators.preisach import Diagonal

Regularisation: TypeAlias = Literal["auto", "gaussian", "none"]

LONGEST_LAG = 20
"""Samples up to which ``lag="auto"`` searches."""
_LAG_BANDS = 15
_FEWEST = 3
_LARGEST = 1e150
"""Largest magnitude of a signal: its square must not overflow."""
_SAMPLES_EACH = 3
"""Samples for each unknown above which the data need no prior."""
_MOST_CELLS = 2100
"""Cells up to which the prior is used, 64 levels: its covariance is dense."""
_SUSPICIOUS, _OUTLIER = 2.2, 6.0
"""Standard deviations from which a sample is fitted without, and from which it is left out."""
_FEWEST_EACH_SUSPECT = 8
"""Samples for each outlier: more outliers than that are no outliers."""


def identify(
    u: npt.ArrayLike,
    y: npt.ArrayLike,
    *,
    levels: int | npt.ArrayLike = 25,
    spacing: Literal["uniform", "adaptive"] = "uniform",
    relay: Relay = "bipolar",
    diagonal: Diagonal = "uniform",
    slope: bool = False,
    signed: bool = False,
    smoothness: float | Literal["auto"] = "auto",
    prior: Regularisation = "auto",
    noise: float | None = None,
    lag: int | Literal["auto"] = 0,
    start: Start = "negative",
    offset: bool = True,
    holdout: float = 0.0,
) -> Identification:
    """Identify a Preisach model from inputs and measured outputs.

    Constrained least squares on exact areas, partly covered cells included. Weights are not
    negative unless ``signed``, so that the model is monotone and can be inverted.

    Parameters
    ----------
    u : (T,) array_like
        Inputs applied, in order.
    y : (T,) array_like
        Outputs; NaN where an input was applied and nothing was measured. Overload codes and
        sentinels such as 9.9e37 and -9999, far from all other outputs, count as not measured; they
        are listed in ``codes`` and in the advice.
    levels : int or (L + 1,) array_like
        Number of bands, over the range of ``u``, or the thresholds themselves.
    spacing : {"uniform", "adaptive"}
        Even thresholds, or thresholds that are denser where the output is steep.
    relay, diagonal
        As in `Preisach`.
    slope : bool
        Whether to fit a memoryless linear part.
    signed : bool
        Whether weights and slope may be negative, for example for butterfly loops.
    smoothness : float or "auto"
        Strength of the penalty on differences between neighbouring cells, defined in
        `minorloop.identification.least_squares`; 0.0 for none. ``"auto"`` chooses by prediction
        of contiguous segments held out of the fitted samples.
    prior : {"auto", "gaussian", "none"}
        Whether to fit with the prior of `minorloop.identification.prior`, which also gives
        predictive bands. ``"auto"`` uses it for fewer than three samples per unknown, except
        where a smoothness is given, where the samples determine a plane that reproduces them to
        rounding, or where there are more than 2,100 cells.
    noise : float, optional
        Standard deviation of a measured output, in its unit, where it is known; used by the
        prior only.
    lag : int or "auto"
        Whole samples by which y follows u; ``"auto"`` tries 0 to 20 on the fitted samples.
    start : {"negative", "positive", "demagnetised"} or Memory
        Memory before the first sample.
    offset : bool
        Whether to fit an offset.
    holdout : float
        Share of the measured samples, at the end of the record, that is not fitted but scored;
        from 0 to 0.9.

    Returns
    -------
    Identification

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
    inputs, outputs, coded = _checked_record(u, y)
    check_option("spacing", spacing, ("uniform", "adaptive"))
    for name, flag in (("slope", slope), ("signed", signed), ("offset", offset)):
        if not isinstance(flag, bool | np.bool_):
            raise ParameterError(f"{name} is {flag!r}; give True or False")
    fitted, held_out = _split(outputs, holdout, len(coded))
    grid = _grid(inputs, np.where(fitted, outputs, np.nan), levels, spacing)
    options: dict[str, Any] = {"relay": relay, "diagonal": diagonal}
    spec = PlaneSpec(grid, offset=bool(offset), slope=bool(slope), **options)
    record = (inputs, outputs, fitted, start, bool(signed))
    delay = _best_lag(spec, record) if lag == "auto" else _as_lag(lag, inputs.size)
    check_option("prior", prior, ("auto", "gaussian", "none"))
    sensor = _as_noise(noise)
    if prior == "gaussian" and smoothness != "auto":
        raise ParameterError(
            f'smoothness is {smoothness!r} and prior is "gaussian"; give one of them'
        )
    found = _fitted(spec, record, delay, smoothness, prior, sensor)
    return Identification(
        model=spec.model(found.x),
        lag=delay,
        start=start,
        smoothness=found.smoothness,
        kkt=found.kkt,
        converged=found.converged,
        u=inputs,
        y=outputs,
        fitted=found.fitted,
        held_out=held_out,
        matrix=found.matrix,
        posterior=found.posterior,
        suspects=found.suspects,
        codes=coded,
        sought=lag == "auto",
    )


_Record = tuple[FloatArray, FloatArray, BoolArray, Start, bool]


@dataclass(frozen=True, eq=False)
class _Result:
    """Unknowns, the samples that they were fitted to, and the outliers."""

    x: FloatArray
    kkt: float
    matrix: DesignMatrix
    fitted: BoolArray
    smoothness: float = 0.0
    posterior: Posterior | None = None
    suspects: tuple[int, ...] = ()
    converged: bool = True


def _fitted(
    spec: PlaneSpec,
    record: _Record,
    lag: int,
    smoothness: float | Literal["auto"],
    prior: Regularisation,
    noise: float | None,
) -> _Result:
    """Fit with the prior, or with smoothness."""
    fitted = record[2]
    samples = int(np.count_nonzero(fitted[lag:]))
    if prior == "gaussian" and spec.cells > _MOST_CELLS:
        raise ParameterError(
            f'prior is "gaussian" and the plane has {spec.cells} cells; give at most 64 levels, '
            'or leave it "auto", which smooths such planes'
        )
    few = samples < _SAMPLES_EACH * spec.unknowns and spec.cells <= _MOST_CELLS
    if prior == "gaussian" or (prior == "auto" and smoothness == "auto" and few):
        if prior == "auto" and samples >= spec.unknowns:
            matrix, fit = _fit(spec, record, lag, 0.0)
            if reproduces(matrix, fit.x, record[1][lag:][fitted[lag:]]):
                return _Result(fit.x, fit.kkt, matrix, fitted, converged=fit.converged)
        return _fitted_with_prior(spec, record, lag, noise)
    matrix, fit = _fit(spec, record, lag, smoothness)
    return _Result(fit.x, fit.kkt, matrix, fitted, fit.smoothness, converged=fit.converged)


def _fitted_with_prior(spec: PlaneSpec, record: _Record, lag: int, noise: float | None) -> _Result:
    """Fit, and leave out one outlier after the other."""
    inputs, outputs, fitted, start, signed = record
    applied = inputs[: inputs.size - lag]
    suspects: list[int] = []
    guess = None
    while True:
        measured = fitted[lag:]
        count = int(np.count_nonzero(measured))
        if count < _FEWEST:
            raise SignalError(
                f"a lag of {lag} leaves {count} measured samples; give a shorter lag or a longer "
                "record"
            )
        matrix = DesignMatrix(spec, applied, measured, start)
        dense = regressors(spec, applied, measured, start) if count <= MOST_CORRELATED else None
        y = outputs[lag:][measured]
        coarse = None if dense is None else coarse_rows(matrix, applied, measured, start)
        found = fit_prior(matrix, y, dense, signed=signed, noise=noise, guess=guess, coarse=coarse)
        guess = found.learnt
        suspect = _suspect(found, dense, coarse, y, signed, noise)
        if suspect is None or len(suspects) >= count // _FEWEST_EACH_SUSPECT:
            break
        place = int(np.flatnonzero(measured)[suspect]) + lag
        suspects.append(place)
        fitted = fitted.copy()
        fitted[place] = False
    return _Result(
        found.x,
        found.kkt,
        matrix,
        fitted,
        posterior=found.posterior,
        suspects=tuple(suspects),
        converged=found.kkt <= ACCEPTABLE,
    )


def _suspect(
    found: PriorFit,
    dense: tuple[FloatArray, FloatArray] | None,
    coarse: tuple[PlaneSpec, FloatArray] | None,
    y: FloatArray,
    signed: bool,
    noise: float | None,
) -> int | None:
    """Sample that lies far outside the band of a fit without it; None if there is none."""
    if found.leave_one_out is None or dense is None or y.size < _FEWEST_EACH_SUSPECT:
        return None
    worst = int(np.argmax(np.abs(found.leave_one_out)))
    if abs(found.leave_one_out[worst]) < _SUSPICIOUS:
        return None
    others = np.arange(y.size) != worst
    without = fit_dense(
        found.posterior.spec,
        y[others],
        (dense[0][others], dense[1][others]),
        signed=signed,
        noise=noise,
        guess=found.learnt,
        coarse=None if coarse is None else (coarse[0], coarse[1][others]),
    )
    row = dense[0][worst : worst + 1]
    h, unit = without.posterior.hyperparameters, without.posterior.unit
    allowed = np.hypot(without.posterior.row_deviation(row)[0], h.noise * unit)
    return worst if abs(float((row @ without.x)[0]) - y[worst]) > _OUTLIER * allowed else None


def _fit(
    spec: PlaneSpec, record: _Record, lag: int, smoothness: float | Literal["auto"]
) -> tuple[DesignMatrix, FittedUnknowns]:
    inputs, outputs, fitted, start, signed = record
    applied = inputs.size - lag
    measured = fitted[lag:]
    if np.count_nonzero(measured) < _FEWEST:
        raise SignalError(
            f"a lag of {lag} leaves {np.count_nonzero(measured)} measured samples; give a "
            "shorter lag or a longer record"
        )
    matrix = DesignMatrix(spec, inputs[:applied], measured, start)
    return matrix, Problem(matrix, outputs[lag:][measured], signed).fit(smoothness)


def _as_noise(noise: float | None) -> float | None:
    if noise is None:
        return None
    if isinstance(noise, bool | np.bool_):
        raise ParameterError(f"noise is {noise}; give a standard deviation in the output's unit")
    number = as_finite("noise", noise)
    if not 0 <= number <= _LARGEST:
        raise ParameterError(
            f"noise is {noise}; give a standard deviation >= 0 and up to {_LARGEST:g}"
        )
    return number


def _best_lag(spec: PlaneSpec, record: _Record) -> int:
    """Lag with the least error of a coarse fit, on the samples that all lags share."""
    inputs, outputs, fitted, start, signed = record
    bands = min(spec.bands, _LAG_BANDS)
    coarse = PlaneSpec(
        as_levels(
            np.interp(np.linspace(0, spec.bands, bands + 1), np.arange(spec.bands + 1), spec.levels)
        ),
        spec.relay,
        spec.diagonal,
        spec.offset,
        spec.slope,
    )
    longest = min(LONGEST_LAG, inputs.size // 4)
    shared = fitted.copy()
    shared[:longest] = False
    if np.count_nonzero(shared) < _FEWEST:
        return 0
    errors = []
    for lag in range(longest + 1):
        matrix, fit = _fit(coarse, (inputs, outputs, shared, start, signed), lag, 0.0)
        errors.append(float(np.sum((matrix.forward(fit.x) - outputs[shared]) ** 2)))
    return int(np.argmin(errors))


def _checked_record(
    u: npt.ArrayLike, y: npt.ArrayLike
) -> tuple[FloatArray, FloatArray, tuple[Code, ...]]:
    """Checked inputs, outputs with NaN instead of codes, and these codes."""
    inputs, outputs = as_samples(u, name="u"), as_samples(y, name="y", gaps=True)
    for name, values in (("u", inputs), ("y", outputs)):
        if values.ndim != 1:
            raise SignalError(f"{name} has shape {values.shape}; give one record, (T,)")
    if inputs.size != outputs.size:
        raise SignalError(
            f"u has {inputs.size} samples and y has {outputs.size}; give one output for every "
            "input, NaN where nothing was measured"
        )
    outputs, coded = _without_codes(inputs, outputs)
    finite = outputs[np.isfinite(outputs)]
    if finite.size < _FEWEST:
        raise SignalError(f"{finite.size} outputs are finite; at least {_FEWEST} are needed")
    for name, values in (("input", inputs), ("output", finite)):
        largest = np.abs(values).max()
        if largest > _LARGEST:
            raise SignalError(f"the {name} reaches {largest:g}; scale it to below {_LARGEST:g}")
        if 0 < np.ptp(values) < 1 / _LARGEST:
            raise SignalError(
                f"the {name} changes by {np.ptp(values):g} only; scale it to above {1 / _LARGEST:g}"
            )
        if np.ptp(values) == 0:
            raise SignalError(
                f"the {name} is {values[0]:g} throughout; a constant identifies nothing"
            )
    return inputs, outputs, coded


def _without_codes(u: FloatArray, y: FloatArray) -> tuple[FloatArray, tuple[Code, ...]]:
    for code in codes(u):
        if abs(code.value) >= OVERLOAD:
            raise SignalError(
                f"u is {code.value:g} at index {code.sample}, which is an overload code and no "
                "input; give what was applied, or cut these rows"
            )
    finite = y[np.isfinite(y)]
    sound = int(np.count_nonzero(np.abs(finite) < OVERLOAD))
    if sound < min(finite.size, _FEWEST) and np.abs(finite).max() <= _LARGEST:
        raise SignalError(
            f"{f'{finite.size - sound} of' if sound else 'all'} {finite.size} outputs are overload "
            f"codes, as {finite[np.abs(finite) >= OVERLOAD][0]:g} is, and no measurement; check "
            "the range of the instrument and repeat"
        )
    coded = codes(y)
    if not coded:
        return y, ()
    measured = y.copy()
    measured[[code.sample for code in coded]] = np.nan
    return measured, coded


def _split(y: FloatArray, holdout: float, coded: int) -> tuple[BoolArray, BoolArray]:
    number = isinstance(holdout, float | int | np.floating | np.integer)
    if not number or isinstance(holdout, bool) or not 0 <= holdout <= 0.9:
        raise ParameterError(f"holdout is {holdout!r}; give a share from 0 to 0.9")
    measured = np.isfinite(y)
    places = np.flatnonzero(measured)
    kept = places.size - round(float(holdout) * places.size)
    if kept < _FEWEST:
        without = f", {coded} codes of the instrument left out" if coded else ""
        raise ParameterError(
            f"holdout {holdout} leaves {kept} of {places.size} measured samples to fit{without}; "
            f"at least {_FEWEST} are needed"
        )
    fitted = measured.copy()
    fitted[places[kept:]] = False
    if np.ptp(y[fitted]) == 0:
        raise SignalError(
            "the output does not change in the part to be fitted; give a smaller holdout or "
            "other rows"
        )
    return fitted, measured & ~fitted


def _grid(u: FloatArray, y: FloatArray, levels: int | npt.ArrayLike, spacing: str) -> Levels:
    if not np.isscalar(levels):
        return as_levels(levels)
    count = levels
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
        raise ParameterError(
            f"levels is {levels!r}; give a whole number of bands of at least 1, or thresholds"
        )
    check_bands(int(count))
    return levels_for(u, y, int(count), spacing)


def _as_lag(lag: int | str, samples: int) -> int:
    whole = isinstance(lag, int | np.integer) and not isinstance(lag, bool)
    if not whole or not 0 <= int(lag) < samples:
        raise ParameterError(
            f'lag is {lag!r}; give "auto" or whole samples from 0 to {samples - 1}'
        )
    return int(lag)

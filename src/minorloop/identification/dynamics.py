"""Identify a hysteresis operator together with dead time, linear dynamics and creep.

Two steps alternate. With the dynamics fixed, the operator is identified from a record without
them. Where the dynamics come first, its inputs are filtered. Otherwise its outputs are those of the
present operator plus the residual through the inverse of the dynamics, which a filter limits to the
frequencies where the noise stays small. With the operator fixed, the dynamics that come nearest
to the measured outputs are found by nonlinear least squares.

The dynamics are a dead time and up to three poles without zeros, so that their inverse is stable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, check_option
from minorloop.dynamics.cascade import Cascade, First, filtered_inverse
from minorloop.dynamics.creep import Creep, fit_creep
from minorloop.dynamics.linear import Linear
from minorloop.errors import ParameterError, SignalError
from minorloop.identification import record_checks as checks
from minorloop.identification.dynamic_result import DynamicIdentification, TriedDynamics
from minorloop.identification.fit import identify
from minorloop.identification.result import Identification
from minorloop.identification.steps import as_sampled
from minorloop.lab.codes import Code
from minorloop.operators.preisach import Preisach
from minorloop.threads import one_thread

Static: TypeAlias = Callable[[FloatArray, FloatArray], Identification]

MOST_POLES = 3
_FEWEST = 100
"""Measured outputs below which dynamics are not identified."""
_MOST_ROWS = 40_000
"""Samples, the first ones, that dynamics are compared on."""
_BANDS = 25
"""Most bands with which dynamics are compared."""
_BETTER = 0.95
"""Ratio of the errors below which another parameter is worth it. Among thousands of samples chance
gains much less by one parameter."""
_BETTER_WITH_CREEP = 0.8
"""The same for creep, which has several parameters and follows other slow errors too."""
_NO_DELAY, _LEAST_DELAY = 0.5, 1e-3
"""Dead time in samples that counts as none where there are no poles, and with poles."""
_DELAYS = 12
"""Delays that a search begins with, from 0 to a tenth of the record."""
_ROUNDS, _SETTLED = 25, 2e-3
"""Most alternations; they end when one with either filter gains less than this share."""
_DEPTH = 4
"""Alternations that the next one is extrapolated from."""
_EVALUATIONS, _STEP, _SMALLEST_GAIN = 8, 1e-4, 1e-4
"""Most steps of the search for the dynamics, their finite difference, and the gain of the last."""
_FASTEST = 0.3
"""Shortest time constant, in sampling intervals."""
_NEXT_POLE = 0.3
"""Time constant with which another pole is tried, over that of the fastest so far."""
_INTERVALS, _AMPLIFIED = 1.0, 10.0
"""The filter of the inverse: its shortest time constant in sampling intervals, and the factor by
which F / G amplifies noise at most."""
_FILTERS = (5.0, 1.0)
"""Factors of the time constant of that filter: a slow one, which converges from any begin, and then
a fast one, which converges further."""
_SLOWER, _LONGEST = 5.0, 3.0
"""Creep times: from so many times the slowest time constant to this part of the record."""
_MOST_NOISE = 0.5
_OF_THE_RECORD = ("holdout", "skip")
_REFUSED = ("lag", "curves", "start_of_curve", "groups")


def identify_dynamics(
    t: npt.ArrayLike,
    u: npt.ArrayLike,
    y: npt.ArrayLike,
    *,
    first: Literal["auto", "operator", "linear"] = "auto",
    poles: int | Literal["auto"] = "auto",
    creep: bool | Literal["auto"] = "auto",
    **options: Any,
) -> DynamicIdentification:
    """Identify a hysteresis operator, dead time, linear dynamics and creep from one record.

    What is ``"auto"`` is chosen by the error of the whole model: another parameter must reduce it
    by 5 %.

    Parameters
    ----------
    t : (T,) array_like
        Evenly spaced times in seconds. At the first, the output is at rest, and the memory is that
        of ``start``: move the actuator over its whole range and back before.
    u : (T,) array_like
        Inputs; u[k] is applied from the sample before.
    y : (T,) array_like
        Outputs; NaN where nothing was measured.
    first : {"auto", "operator", "linear"}
        Which of operator and linear dynamics receives the input.
    poles : int or "auto"
        Number of poles of the linear dynamics, 0 to 3. A dead time is fitted with any number.
    creep : bool or "auto"
        Whether to fit creep of the output.
    **options
        Options of `identify` for the operator; not ``lag``, ``curves`` and ``groups``. Diagonal
        and slope are ``"auto"`` if not given.

    Returns
    -------
    DynamicIdentification

    Raises
    ------
    SignalError
        As `identify`; if the times are not even, or fewer than 100 outputs are fitted.
    ParameterError
        If an option is out of its range.

    References
    ----------
    Fixed operator, free dynamics: Ljung, System Identification, 2nd edition, 1999, section 7.4,
    output error. Alternation for a static map and dynamics in series: section 10.1 there.
    """
    check_option("first", first, ("auto", "operator", "linear"))
    if creep != "auto":
        checks.check_flags(creep=creep)
    if poles != "auto" and (isinstance(poles, bool) or poles not in range(MOST_POLES + 1)):
        raise ParameterError(f'poles is {poles!r}; give "auto" or 0 to {MOST_POLES}')
    refused = next((name for name in _REFUSED if name in options), None)
    if refused is not None:
        raise ParameterError(
            f"{refused} cannot be combined with dynamics; leave it out, or reduce the record to "
            "settled points and identify the operator from them"
        )
    record = _Record.of(t, u, y, options)
    fields = {"diagonal": "auto", "slope": "auto"}
    fields |= {name: value for name, value in options.items() if name not in _OF_THE_RECORD}
    static = _fitter(_coarse(fields))
    short = record.part(_MOST_ROWS)
    most = MOST_POLES if poles == "auto" else int(poles)
    orders: tuple[First, ...] = ("operator", "linear") if first == "auto" else (first,)
    with one_thread():
        tried = [found for one in orders for found in _each_order(short, one, most, static)]
        if poles == "auto":
            tried = [one for one in tried if one.dynamics.plausible]
        else:
            tried = [one for one in tried if one.dynamics.poles == poles]
        if first == "auto":  # without poles the order makes no difference
            tried = [one for one in tried if one.dynamics.poles or one.dynamics.first == "operator"]
        best = _simplest(tried)
        if creep:
            crept = _creeping(short, best, static)
            if crept and (creep is True or crept.error < _BETTER_WITH_CREEP * best.error):
                more = best.dynamics.poles + 1
                others = [
                    _creeping(short, one, static)
                    for one in tried
                    if one is not best and 0 < one.dynamics.poles <= more
                ]
                with_creep = [crept, *(one for one in others if one)]
                tried, best = [*tried, *with_creep], _simplest(with_creep)
        found, operator = _refined(record, best, fields)
    return DynamicIdentification(
        model=replace(found.model, noise=min(found.error, _MOST_NOISE)),
        static=operator,
        t=record.t,
        u=record.u,
        y=record.y,
        fitted=record.fitted,
        held_out=record.held_out,
        tried=tuple(one.summary(one is best) for one in tried),
    )


@dataclass(frozen=True, eq=False)
class _Record:
    """A checked record; y is NaN where nothing was measured.

    ``fitted`` and ``held_out`` (T,) are the samples that are fitted and scored; ``start`` is the
    memory before the first; ``codes`` are readings that are no measurements.
    """

    t: FloatArray
    u: FloatArray
    y: FloatArray
    interval: float
    fitted: BoolArray
    held_out: BoolArray
    start: Any
    codes: tuple[Code, ...]

    @classmethod
    def of(
        cls, t: npt.ArrayLike, u: npt.ArrayLike, y: npt.ArrayLike, options: dict[str, Any]
    ) -> _Record:
        inputs, outputs, coded = checks.checked_record(u, y)
        interval = as_sampled((t, inputs, np.zeros(inputs.size)), "end").interval
        skipped = checks.as_skip(options.get("skip", 0), np.arange(inputs.size))
        share = options.get("holdout", 0.0)
        fitted, held_out = checks.split(outputs, share, len(coded), skipped)
        if np.count_nonzero(fitted) < _FEWEST:
            raise SignalError(
                f"{np.count_nonzero(fitted)} outputs are fitted, and dynamics need {_FEWEST}; "
                "record the transients too, or identify without dynamics"
            )
        even = interval * np.arange(inputs.size, dtype=np.float64)
        start = options.get("start", "negative")
        return cls(even, inputs, outputs, interval, fitted, held_out, start, coded)

    def part(self, rows: int) -> _Record:
        """Return the rows up to so many fitted ones."""
        used = np.flatnonzero(self.fitted)[:rows]
        size = int(used[-1]) + 1
        return replace(
            self,
            t=self.t[:size],
            u=self.u[:size],
            y=self.y[:size],
            fitted=self.fitted[:size],
            held_out=self.held_out[:size],
        )

    def error(self, prediction: FloatArray, rows: BoolArray) -> float:
        """Root-mean-square error on these rows, over the range of the output."""
        off = (prediction - self.y)[rows]
        return float(np.sqrt(np.mean(off**2)) / (np.nanmax(self.y) - np.nanmin(self.y)))


@dataclass(frozen=True)
class _Dynamics:
    """Dead time, poles and creep: exp(-dead_time s) / ((1 + a s + b s^2) (1 + c s)), then creep.

    ``logarithms`` are log a, log b and log c, as many as there are poles; ``delay`` is the
    dead time in sampling intervals.
    """

    interval: float
    first: First
    delay: float
    logarithms: tuple[float, ...] = ()
    creep: Creep | None = None

    @property
    def poles(self) -> int:
        return len(self.logarithms)

    @property
    def plausible(self) -> bool:
        """Whether the samples are close enough to know the fastest pole."""
        return not self.poles or bool(self.linear.time_constants[-1] >= _FASTEST * self.interval)

    @property
    def parameters(self) -> int:
        """Number of poles, and one more for dead time and for creep."""
        return self.poles + (self.delay > 0) + (self.creep is not None)

    @property
    def linear(self) -> Linear:
        """Continuous system with DC gain 1."""
        a = np.exp(self.logarithms).tolist()
        denominator = np.convolve([*a[1::-1], 1.0], [*a[2:], 1.0])
        return Linear(np.ones(1), denominator, delay=self.delay * self.interval)

    @property
    def filter_time(self) -> float:
        """Time constant of the filter of the inverse."""
        product = 1 / float(self.linear.denominator[-1])  # of the time constants
        usual = float((product / _AMPLIFIED) ** (1 / max(self.poles, 1)))
        return max(usual, _INTERVALS * self.interval)

    def filtered(self, x: FloatArray) -> FloatArray:
        """Return a signal (T,) that is held between samples, after dead time and poles."""
        samples = np.arange(x.size)
        late: FloatArray = np.interp(samples - self.delay, samples, x)
        if not self.poles:
            return late
        sampled = replace(self.linear, delay=0.0).discretise(self.interval)
        return sampled.simulate(self.interval * samples, late, before=float(x[0]))

    def prompt(self, record: _Record, operator: Preisach) -> FloatArray:
        """Return the outputs before creep."""
        if self.first == "linear":
            return operator.simulate(self.filtered(record.u), record.start)
        return self.filtered(operator.simulate(record.u, record.start))

    def outputs(self, record: _Record, operator: Preisach) -> FloatArray:
        """Return the outputs."""
        return self.crept(record, self.prompt(record, operator))

    def crept(self, record: _Record, y: FloatArray) -> FloatArray:
        """Return the outputs, given those before creep."""
        return y if self.creep is None else self.creep.simulate(record.t, y, before=float(y[0]))

    @property
    def vector(self) -> FloatArray:
        """Logarithms, dead time and strengths of the creep."""
        strengths = () if self.creep is None else self.creep.strengths
        return np.array([*self.logarithms, self.delay, *strengths])

    def at(self, vector: FloatArray) -> _Dynamics:
        """Return the dynamics with other parameters; the last ones are kept where not given."""
        known = np.append(vector, self.vector[vector.size :])
        logarithms, delay = known[: self.poles], max(float(known[self.poles]), 0.0)
        creep, strengths = self.creep, np.maximum(known[self.poles + 1 :], 0.0)
        if creep is not None and strengths.sum() < 1:
            creep = Creep(creep.times, strengths, 1 - float(strengths.sum()))
        return replace(self, logarithms=tuple(logarithms.tolist()), delay=delay, creep=creep)

    def with_another_pole(self) -> _Dynamics:
        """Return the begin of a search with one pole more, faster than all others."""
        if not self.poles:
            slow = np.log(self.interval * max(self.delay, 1.0))
            return replace(self, logarithms=(float(slow),), delay=0.5)
        fast = _NEXT_POLE * float(self.linear.time_constants[-1])
        a = np.exp(self.logarithms)
        more = [a[0] + fast, a[0] * fast] if self.poles == 1 else [*a, fast]
        delay = max(self.delay - fast / self.interval, 0.0)
        return replace(self, logarithms=tuple(np.log(more).tolist()), delay=delay)

    def with_equal_poles(self) -> _Dynamics:
        """Return the begin of a search with one pole more, all equal and without dead time."""
        late = self.delay * self.interval + float(self.linear.time_constants.sum())
        time = max(late, self.interval) / (self.poles + 1)
        logs = np.log([2 * time, time**2, time] if self.poles else [time])
        return replace(self, logarithms=tuple(logs[: self.poles + 1].tolist()), delay=0.0)

    def bounds(self, seconds: float) -> tuple[FloatArray, FloatArray]:
        """Return the least and greatest logarithms and dead time, for a record so long."""
        powers = np.array([1.0, 2.0, 1.0])[: self.poles]
        low = np.append(powers * np.log(_FASTEST * self.interval), 0.0)
        return low, np.append(powers * np.log(seconds), seconds / self.interval / 4)


@dataclass(frozen=True, eq=False)
class _Found:
    """A fit of operator and dynamics, and its error over the range of the output."""

    result: Identification
    dynamics: _Dynamics
    error: float

    @property
    def operator(self) -> Preisach:
        return self.result.model

    @property
    def model(self) -> Cascade:
        """The cascade."""
        return Cascade(
            self.operator, self.dynamics.linear, self.dynamics.first, self.dynamics.creep
        )

    def summary(self, chosen: bool) -> TriedDynamics:
        """Return what is kept of a fit that was tried."""
        one = self.dynamics
        return TriedDynamics(
            one.first, one.poles, round(one.delay, 3) * one.interval, one.creep is not None,
            self.error, chosen,
        )  # fmt: skip


def _coarse(options: dict[str, Any]) -> dict[str, Any]:
    """Return options of a quick fit of the operator, with which dynamics are compared.

    Where they are not given, the diagonal is reversible, which has the smallest errors.
    """
    levels = options.get("levels", "auto")
    bands = np.size(levels) - 1 if np.ndim(levels) else levels
    given = {
        name: value
        for name in ("signed", "offset", "start", "relay", "diagonal", "slope")
        if (value := options.get(name, "auto")) != "auto"
    }
    return (
        {"diagonal": "reversible"}
        | given
        | {
            "levels": _BANDS if bands == "auto" or bands > _BANDS else levels,
            "smoothness": 0.0,
            "prior": "none",
        }
    )


def _fitter(options: dict[str, Any]) -> Static:
    """Return the identification of an operator with these options."""
    return lambda u, y: identify(u, y, **options)


def _each_order(record: _Record, first: First, most: int, static: Static) -> list[_Found]:
    """Return a fit with each number of poles; each search begins from that with one pole less."""
    dynamics = _Dynamics(record.interval, first, float(_delay(record, static)))
    found = [_alternate(record, dynamics, static)]
    for _ in range(most):
        last = found[-1]
        begins = last.dynamics.with_another_pole(), last.dynamics.with_equal_poles()
        more = [_alternate(record, begin, static, last.operator) for begin in begins]
        found.append(min(more, key=lambda one: one.error))
    return found


def _creeping(record: _Record, found: _Found, static: Static) -> _Found | None:
    """Return a fit with creep that begins from one without; None if there is no creep."""
    crept = _alternate(record, found.dynamics, static, found.operator, creeping=True)
    return crept if crept.dynamics.creep is not None and crept.dynamics.plausible else None


def _delay(record: _Record, static: Static) -> int:
    """Return the delay in samples with which the operator alone comes nearest to the outputs."""
    delays = np.geomspace(1, max(record.u.size // 10, 1), _DELAYS).astype(int)
    y = np.where(record.fitted, record.y, np.nan)
    errors = {int(k): static(record.u, _earlier(y, int(k))).nrmse for k in (0, *delays)}
    return min(errors, key=lambda delay: errors[delay])


def _earlier(y: FloatArray, samples: int) -> FloatArray:
    return np.append(y, np.full(samples, np.nan))[samples:]


def _alternate(
    record: _Record,
    dynamics: _Dynamics,
    static: Static,
    operator: Preisach | None = None,
    *,
    creeping: bool = False,
) -> _Found:
    """Alternate between operator and dynamics until the error no longer falls.

    Creep is fitted if ``creeping``. The parameters are extrapolated from the last rounds (Anderson,
    J. ACM 12, 1965), because operator and dynamics explain part of the record alike, and plain
    alternation would be slow.
    """
    best, waited = None, 0
    begun: list[FloatArray] = []
    reached: list[FloatArray] = []
    for _ in range(_ROUNDS):
        result = static(*_without(dynamics, record, operator, _FILTERS[waited]))
        operator, began = result.model, dynamics.vector
        dynamics = _fitted_poles(record, dynamics, operator)
        if creeping:
            dynamics = replace(dynamics, creep=_fitted_creep(record, dynamics, operator))
        if dynamics.vector.size != began.size:  # creep has come or gone
            begun, reached = [], []
        else:
            begun.append(began)
            reached.append(dynamics.vector)
        error = record.error(dynamics.outputs(record, operator), record.fitted)
        waited = 0 if best is None or error < (1 - _SETTLED) * best.error else waited + 1
        if waited == len(_FILTERS):
            break
        if best is None or error <= best.error:
            best = _Found(result, dynamics, error)
            if begun:
                ahead = _extrapolated(begun[-_DEPTH:], reached[-_DEPTH:])
                low, high = dynamics.bounds(float(record.t[-1]))
                ahead[: low.size] = np.clip(ahead[: low.size], low, high)
                dynamics = dynamics.at(ahead)
        else:  # back to where plain alternation does not make the error larger
            operator, dynamics = best.operator, best.dynamics
            begun, reached = [], []
    assert best is not None
    return best


def _extrapolated(begun: list[FloatArray], reached: list[FloatArray]) -> FloatArray:
    """Return where rounds that began and ended at these vectors seem to converge."""
    steps = np.array(reached) - np.array(begun)
    if len(steps) < 2 or not np.diff(steps, axis=0).any():
        return reached[-1].copy()
    share = np.linalg.lstsq(np.diff(steps, axis=0).T, steps[-1], rcond=1e-6)[0]
    return np.asarray(reached[-1] - share @ np.diff(np.array(reached), axis=0))


def _without(
    dynamics: _Dynamics, record: _Record, operator: Preisach | None, slower: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Return the record that the operator alone would have given, NaN where nothing is fitted.

    The time constant of the filter of the inverse is ``slower`` times as long as usual.
    """
    known = record.fitted
    y = np.where(known, record.y, np.nan)
    if operator is None:
        if dynamics.first == "linear":
            return dynamics.filtered(record.u), y
        slow = float(dynamics.linear.time_constants.sum()) / record.interval
        return record.u, _earlier(y, round(dynamics.delay + slow))
    prompt = dynamics.prompt(record, operator)
    if dynamics.creep is not None:
        whole = np.where(known, y, dynamics.crept(record, prompt))
        y = dynamics.creep.compensate(record.t, whole, before=float(prompt[0]))
    if dynamics.first == "linear":
        return dynamics.filtered(record.u), np.where(known, y, np.nan)
    inverse, late = filtered_inverse(dynamics.linear, slower * dynamics.filter_time)
    left = np.interp(record.t + late, record.t[known], (y - prompt)[known])
    w = operator.simulate(record.u, record.start) + inverse.simulate(record.t, left)
    return record.u, np.where(known, w, np.nan)


def _fitted_poles(record: _Record, dynamics: _Dynamics, operator: Preisach) -> _Dynamics:
    """Return the poles and the dead time that come nearest to the outputs."""
    from scipy.optimize import least_squares

    if not dynamics.poles and dynamics.delay < _NO_DELAY:
        return replace(dynamics, delay=0.0)
    free = dynamics.poles + 1
    # The output of an operator that comes first does not depend on the dynamics.
    w = None if dynamics.first == "linear" else operator.simulate(record.u, record.start)

    def errors(x: FloatArray) -> FloatArray:
        now = dynamics.at(x)
        prompt = now.prompt(record, operator) if w is None else now.filtered(w)
        return (now.crept(record, prompt) - record.y)[record.fitted]

    low, high = (bound[:free] for bound in dynamics.bounds(float(record.t[-1])))
    begin = dynamics.vector[:free]
    margin = np.minimum(1e-3, 0.1 * (high - low))
    answer = least_squares(
        errors,
        np.clip(begin, low + margin, high - margin),
        bounds=(low, high),
        diff_step=np.full(free, _STEP),
        max_nfev=_EVALUATIONS,
        ftol=_SMALLEST_GAIN,
    )
    return dynamics.at(answer.x)


def _fitted_creep(record: _Record, dynamics: _Dynamics, operator: Preisach) -> Creep | None:
    """Return the creep that comes nearest to the outputs; None if there is none."""
    prompt = dynamics.prompt(record, operator)
    slowest = float(dynamics.linear.time_constants.max(initial=record.interval))
    shortest, longest = _SLOWER * slowest, float(record.t[-1]) / _LONGEST
    times = None if dynamics.creep is None else dynamics.creep.times
    if times is None and shortest > longest:
        return None
    y = np.where(record.fitted, record.y, np.nan)
    creep = fit_creep(record.t, prompt, y, shortest=shortest, longest=longest, times=times).model
    return creep.normalised() if creep.gain > 0 and creep.strengths.any() else None


def _simplest(tried: list[_Found]) -> _Found:
    """Return the fit with the fewest parameters among those that are about as good as the best."""
    best, *others = sorted(tried, key=lambda found: found.dynamics.parameters)
    for one in others:
        same = one.dynamics.parameters == best.dynamics.parameters
        if one.error < (1.0 if same else _BETTER) * best.error:
            best = one
    return best


def _refined(
    record: _Record, best: _Found, options: dict[str, Any]
) -> tuple[_Found, Identification]:
    """Fit the whole record with the operator that the options ask for.

    Options that are "auto" are chosen once. Returns the fit, and the operator with what it alone
    would have given plus the residual.
    """
    chosen = identify(*_without(best.dynamics, record, best.operator), **options)
    spec, banded = chosen.matrix.spec, chosen.posterior is not None
    plane = options | {
        "levels": spec.levels,
        "spacing": "uniform",
        "relay": spec.relay,
        "diagonal": spec.diagonal,
        "slope": spec.slope,
    }
    smoothness = 0.0 if banded else chosen.smoothness
    static = _fitter(plane | {"prior": "none", "smoothness": smoothness})
    creeping = best.dynamics.creep is not None
    found = _alternate(record, best.dynamics, static, best.operator, creeping=creeping)
    if banded:
        known = _without(found.dynamics, record, found.operator)
        result = identify(*known, **plane | {"prior": "gaussian"})
        y = found.dynamics.outputs(record, result.model)
        found = replace(found, result=result, error=record.error(y, record.fitted))
    if found.dynamics.delay < _LEAST_DELAY:
        found = replace(found, dynamics=replace(found.dynamics, delay=0.0))
    dynamics, finite = found.dynamics, np.isfinite(record.y)
    u = dynamics.filtered(record.u) if dynamics.first == "linear" else record.u
    residual = record.y - dynamics.outputs(record, found.operator)
    operator = replace(
        found.result,
        u=u,
        y=found.operator.simulate(u, record.start) + residual,
        fitted=record.fitted,
        held_out=record.held_out,
        skipped=int(np.count_nonzero(finite & ~record.fitted & ~record.held_out)),
        choices=chosen.choices,
        codes=record.codes,
        searched=True,
        measured=record.y,
    )
    return found, operator

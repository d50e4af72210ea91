"""Identify an operator with after-effect, creep or viscous relays from a record with times.

Laws are compared by the error on left-out parts of the record. A search finds the few constants of
each law; for given constants the weights are a least-squares problem with bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_times,
    as_whole,
    check_option,
    writable,
)
from minorloop.errors import ParameterError, SignalError
from minorloop.identification import _after_effect_kernels as _kernels
from minorloop.identification import dense_solver
from minorloop.identification import record_checks as checks
from minorloop.identification.after_effect_result import (
    AfterEffectIdentification,
    TriedLaw,
    along,
    held,
    longest_hold,
)
from minorloop.identification.curves import Curves, as_curves, as_groups
from minorloop.identification.design_matrix import PlaneSpec, unpack
from minorloop.identification.fit import Say, silent
from minorloop.identification.least_squares import held_out_segments, neighbour_differences
from minorloop.identification.preparation import samples_in_time
from minorloop.identification.prior import Gaussian, Prior, Smooth
from minorloop.lab.records import Record
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.preisach import Diagonal, Preisach
from minorloop.threads import one_thread

Law: TypeAlias = Literal["none", "thermal", "wide", "viscous", "spectrum"]
"""No effect of time; a fluctuation field that is the same everywhere, or that falls towards the
ends of the levels; viscous relays; creep with a spectrum of time constants."""
CREEP: dict[str, tuple[Law, ...]] = {
    "auto": ("none", "thermal", "wide", "spectrum"),
    "none": ("none",),
    "thermal": ("none", "thermal", "wide"),
    "spectrum": ("none", "spectrum"),
}
"""Laws that each kind of creep compares."""

PER_DECADE = 2
"""Time constants per decade of a spectrum. Responses of lags that are closer than a factor of 3 are
almost collinear, so that a record cannot separate more."""
_MOST_UNKNOWNS = 6000
"""Unknowns of the dense normal equations: 300 MB."""
_BLOCK = 512
"""Rows of the design matrix in memory at a time: with 6000 unknowns 25 MB."""
_FOLDS = 5
"""One of this number of curves is left out."""
_STRENGTHS = (1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
"""Strengths of smoothing that are compared, as in `minorloop.identification.least_squares`; zero is
not among them, because neighbouring time constants are almost collinear."""
_FIRST_SETTLINGS = (0.1, 1.0, 10.0, 100.0)
"""Settling times with which a search may begin, over the longest hold. The error may have several
minima, because a long settling time looks like a smaller field."""
_TRIALS = 25
"""Fits of the search for each constant; the error then changes in the fourth digit."""
_FACTOR = 10**0.5
"""Ratio of the settling times that are compared with the best one."""
_FARTHEST = 1e3
"""Greatest settling time over the longest hold: the law is then the logarithm of time for all
predictions up to a hundred times as long as the holds of the record."""
_APART = 0.6
_REFITS = 8
"""Distance within which the logarithm of the field is searched for another settling time, and
number of fits, after which the field is known to a few percent."""
_SEGMENTS = 10
"""Least number of parts of a record whose scatter judges the difference between two fits."""
_NOISELESS = 1e-12
"""Least error over the range; smaller errors are rounding and count as this."""
_HELD = 4.0
_SHORT = 0.1
"""Shortest hold that shows creep, in units of a short interval, and the quantile of the intervals
that is short: in a pause without samples, the output may be read only at its two ends."""


@dataclass(frozen=True, eq=False)
class Viscosity:
    """The law of a Preisach model whose output changes with time: after-effect, creep, viscosity.

    Every law is fitted without a part of the record and scored on it; a law with more constants
    must reduce the error by 2 %. The sums of the weights of plane and creep up to each time
    constant are not negative, so that the model is monotone and can be inverted.

    The record needs times; u[k] is applied since t[k - 1], and the first input of a curve has been
    applied for the shortest interval of the record. Groups are runs: bands are then those of
    another run, and include the scatter of the few runs by Student's distribution. The specimen has
    settled with the initial memory before the first row.

    References
    ----------
    Neel, Annales de Geophysique 5, 1949: fluctuation field. Krejci and Kuhnen, IEE Proceedings D
    148, 2001: creep with a spectrum of time constants. Both in ``docs/theory/time.md``.

    Examples
    --------
    >>> t = 0.1 * np.arange(300)
    >>> u = np.sin(t) * np.linspace(1.0, 0.2, 300)
    >>> law = ml.Viscosity(4, creep="none", rate=False)
    >>> ml.identify(ml.Record(u, u, t), law).law
    'none'
    """

    levels: int | npt.ArrayLike = 25
    """Number of bands over the range of the input, or the (L + 1,) thresholds themselves."""
    creep: Literal["auto", "none", "thermal", "spectrum"] = "auto"
    """Laws to compare with no effect of time: a fluctuation field by which thresholds relax with
    the logarithm of time; or weights that creep with a spectrum of time constants."""
    rate: bool | Literal["auto"] = "auto"
    """Whether to compare viscous relays too: thresholds that depend on the rate of the input.
    ``"auto"``: if the record has more than one rate."""
    diagonal: Diagonal = "reversible"
    """As in `Preisach`. The reversible part follows the input without after-effect."""
    spacing: Literal["uniform", "adaptive"] = "uniform"
    """As in `Plane`."""
    times: npt.ArrayLike | None = None
    """(n,) time constants of the spectrum in seconds; by default two per decade, from twice the
    shortest interval to the longest hold."""

    def identify(
        self, record: Record, prior: Prior = "auto", holdout: float = 0.0, say: Say = silent
    ) -> AfterEffectIdentification:
        """Identify the weights and the law of their change, as `minorloop.identify`.

        Raises a `SignalError` if times do not increase, too few outputs are finite, or input or
        output never change; if ``rate`` is true and the record has one rate only, or ``creep`` is a
        spectrum and the record has no hold; a `ParameterError` if an option is out of its range.
        """
        used, told = samples_in_time(record)
        if isinstance(prior, Gaussian):
            raise ParameterError(
                "a law of time has no Gaussian prior; give Smooth, or leave it out"
            )
        if holdout:
            raise ParameterError(
                f"holdout is {holdout}, and laws of time are scored on parts left out; omit holdout"
            )
        inputs, outputs, coded = used.checked
        clock = as_times(used.t)
        check_option("creep", self.creep, tuple(CREEP))
        check_option("diagonal", self.diagonal, ("uniform", "reversible"))
        check_option("spacing", self.spacing, ("uniform", "adaptive"))
        if self.rate != "auto":
            checks.check_flags(rate=self.rate)
        parts = as_curves(used.curves, inputs.size, used.start, used.start_of_curve)
        skipped = checks.as_skip(used.skip, parts.positions(inputs.size))
        runs = None if used.groups is None else as_groups("groups", used.groups, inputs.size)
        fitted, _ = checks.split(outputs, 0.0, coded, skipped)
        known = np.where(fitted, outputs, np.nan)
        grid = checks.grid(inputs, known, self.levels, self.spacing)
        spec = PlaneSpec(grid, "unipolar", self.diagonal)
        timed = TimedRecord(clock, writable(inputs), outputs, fitted, parts, runs)
        laws = [*CREEP[self.creep]]
        if _wants_rate(timed, self.rate):
            laws.insert(1, "viscous")
        spectrum = None
        if "spectrum" in laws:
            spectrum = _spectrum(timed, self.times, self.creep == "spectrum")
            if spectrum is None:
                laws.remove("spectrum")
        smoothness = prior.strength if isinstance(prior, Smooth) else "auto"
        search = _Search(timed, spec, spectrum, smoothness)
        with one_thread():
            tried: list[TriedLaw] = []
            for law in laws:
                tried.append(search.tried(law, say, search.guess(law, tried)))
            best = tried[0]
            for one in tried[1:]:
                # Ratio of the left-out errors below which a law with more constants is better, as
                # in `minorloop.identification.dynamics`
                if one.error < 0.98 * best.error:
                    best = one
            say(f"fitting all rows with the law {best.law!r}")
            return replace(search.result(best, tried), told=told, record=record)


@dataclass(frozen=True, eq=False)
class TimedRecord:
    """A record with times to be fitted: ``t``, ``u``, ``y``, ``fitted`` (T,), curves, and runs."""

    t: FloatArray
    u: FloatArray
    y: FloatArray
    fitted: BoolArray
    curves: Curves
    groups: IntArray | None = None

    @cached_property
    def intervals(self) -> FloatArray:
        """(T,) seconds for which each input is held."""
        return held(self.t, self.curves)

    @cached_property
    def begins(self) -> BoolArray:
        """(T,) first rows of curves."""
        begins = np.zeros(self.t.size, dtype=np.bool_)
        begins[self.curves.begins] = True
        return begins

    @cached_property
    def left_out(self) -> BoolArray:
        """(T,) fitted rows that are left out to compare laws: curves, or contiguous segments."""
        if self.curves.begins.size >= _FOLDS:
            number = np.cumsum(self.begins) - 1
            return np.asarray(self.fitted & (number % _FOLDS == _FOLDS // 2))
        rows = np.flatnonzero(self.fitted)
        out = np.zeros(self.t.size, dtype=np.bool_)
        out[rows[held_out_segments(rows.size)]] = True
        return out


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations of some rows: Gram matrix, right side, sum of squares, number of rows."""

    gram: FloatArray
    right: FloatArray
    square: float
    rows: int

    def __add__(self, other: Normal) -> Normal:
        return Normal(
            self.gram + other.gram,
            self.right + other.right,
            self.square + other.square,
            self.rows + other.rows,
        )

    def error(self, x: FloatArray) -> float:
        """Root-mean-square residual."""
        total = self.square - 2 * float(x @ self.right) + float(x @ self.gram @ x)
        return float(np.sqrt(max(total, 0.0) / max(self.rows, 1)))


@dataclass(frozen=True, eq=False)
class Constants:
    """Constants of a law: field of each band and settling time, or time constants of the creep."""

    field: FloatArray
    settling: float
    times: FloatArray


class Design:
    """Design matrix of a record, for the unknowns of all planes and the offset."""

    def __init__(self, spec: PlaneSpec, record: TimedRecord, constants: Constants) -> None:
        self.spec, self.record, self.constants = spec, record, constants
        blank = Preisach(spec.levels, np.zeros((spec.bands, spec.bands)))
        reset = np.array(blank.memory(record.curves.start).extrema)
        self._marks, self._reset = spec.levels, reset
        self._x = record.u
        if constants.settling > 0:
            steps = np.diff(spec.levels) / constants.field
            self._marks = np.concatenate([[0.0], np.cumsum(steps)])
            self._reset = np.interp(reset, spec.levels, self._marks)
            self._x = np.interp(record.u, spec.levels, self._marks)
            lost = -np.expm1(-record.intervals / constants.settling)
            start = float(self._reset[-1])
            _kernels.follow(self._marks, lost, record.begins, start, self._x)

    def blocks(self) -> Iterator[tuple[slice, FloatArray]]:
        """Yield blocks of rows, each with its slice of the record."""
        record, constants, cells = self.record, self.constants, self.spec.cells
        planes = 1 + constants.times.size
        extrema, count = np.empty(self._reset.size + record.u.size + 2), 0
        late = np.zeros((planes, cells))
        tables = writable(self.spec.levels), writable(self._marks), self.spec.diagonal == "uniform"
        times = writable(constants.times)
        for first in range(0, record.u.size, _BLOCK):
            part = slice(first, min(first + _BLOCK, record.u.size))
            out = np.empty((part.stop - first, planes * cells + 1))
            inputs = self._x[part], record.u[part], record.intervals[part]
            memory = record.begins[part], self._reset, extrema, count, late
            count = _kernels.fill(*tables, *inputs, times, *memory, out)
            out[:, -1] = 1.0
            yield part, out


@dataclass(frozen=True, eq=False)
class Weights:
    """Uncertainty of the weights of a fit.

    ``free`` (n,) are the unknowns that are not at their bound, ``root`` (m, m) a root of their
    covariance.
    """

    spec: PlaneSpec
    constants: Constants
    free: BoolArray
    root: FloatArray

    def variance(self, t: FloatArray, u: FloatArray, curves: Curves) -> FloatArray:
        """Variance (T,) of the output along an input."""
        everywhere = np.ones(t.size, dtype=np.bool_)
        record = TimedRecord(t, writable(u), u, everywhere, curves)
        blocks = Design(self.spec, record, self.constants).blocks()
        parts = [((rows[:, self.free] @ self.root.T) ** 2).sum(axis=1) for _, rows in blocks]
        return np.concatenate(parts)


class _Search:
    """Fits of a record by several laws."""

    def __init__(
        self,
        record: TimedRecord,
        spec: PlaneSpec,
        spectrum: FloatArray | None,
        smoothness: float | Literal["auto"],
    ) -> None:
        self.record, self.spec, self.spectrum = record, spec, spectrum
        planes = 1 + (0 if spectrum is None else spectrum.size)
        if planes * spec.cells > _MOST_UNKNOWNS:
            raise ParameterError(
                f"{spec.bands} bands and {planes - 1} time constants are {planes * spec.cells} "
                f"unknowns, at most {_MOST_UNKNOWNS} can be fitted; give fewer levels"
            )
        used = record.y[record.fitted]
        self.centre, self.unit = float(used.mean()), float(np.ptp(used))
        self.span = float(spec.levels[-1] - spec.levels[0])
        self.kept = record.fitted & ~record.left_out
        self.smoothness = smoothness
        self.strength = (0.0 if smoothness == "auto" else float(smoothness)) or _STRENGTHS[0]
        apart = spec.bands * neighbour_differences(spec)[:, : spec.cells].toarray()
        self.penalty = apart.T @ apart

    def constants(self, law: str, numbers: FloatArray) -> Constants:
        """Constants of a law from logarithms of its numbers."""
        none = np.empty(0)
        if law == "spectrum" and self.spectrum is not None:
            return Constants(none, 0.0, self.spectrum)
        if law == "none":
            return Constants(none, 0.0, none)
        settling, bands = float(np.exp(numbers[0])), self.spec.bands
        if law == "viscous":
            # Fluctuation field of viscous relays over the range of the input: sinh is then linear
            # to 0.2 %
            return Constants(np.full(bands, 10.0 * self.span), settling, none)
        field = np.full(bands, float(np.exp(numbers[1])))
        if law == "wide":
            levels = self.spec.levels
            middle = (levels[:-1] + levels[1:] - levels[0] - levels[-1]) / 2
            field /= np.hypot(1.0, middle / np.exp(numbers[2]))
        return Constants(field, settling, none)

    def guess(self, law: str, tried: Sequence[TriedLaw]) -> FloatArray:
        """First guess of the logarithms of the numbers of a law, from the laws already tried."""
        if law == "viscous":
            return np.log([float(np.median(self.record.intervals))])
        if law == "wide":
            even = next(one.numbers for one in tried if one.law == "thermal")
            return np.append(even, np.log(self.span / 3))
        if law != "thermal":
            return np.empty(0)
        longest = longest_hold(self.record.t, self.record.u, self.record.curves)
        # Fluctuation fields with which a search may begin, over the range of the input: loops widen
        # by one to several percent per decade of rate
        begins = [
            np.log([settling * longest, field * self.span])
            for settling in _FIRST_SETTLINGS
            for field in (0.0025, 0.005, 0.01, 0.02)
        ]
        cost = self.cost(law)
        return min(begins, key=cost)

    def normal(self, constants: Constants) -> tuple[Normal, Normal]:
        """Normal equations of the kept rows, and of the left-out rows."""
        from scipy.linalg.blas import dsyrk

        record = self.record
        size = (1 + constants.times.size) * self.spec.cells + 1
        masks = self.kept, record.left_out
        grams = [np.zeros((size, size), order="F") for _ in masks]
        rights = [np.zeros(size) for _ in masks]
        y = (record.y - self.centre) / self.unit
        for part, block in Design(self.spec, record, constants).blocks():
            for used, gram, right in zip(masks, grams, rights, strict=True):
                picked = used[part]
                a = block[picked]
                dsyrk(1.0, a.T, beta=1.0, c=gram, overwrite_c=1)
                right += a.T @ y[part][picked]
        kept, left_out = (
            Normal(gram.T + np.tril(gram.T, -1).T, right, float(y[used] @ y[used]), int(used.sum()))
            for used, gram, right in zip(masks, grams, rights, strict=True)
        )
        return kept, left_out

    def solve(self, normal: Normal, strength: float, guess: FloatArray | None = None) -> FloatArray:
        """Unknowns of least squares; all but the offset are not negative."""
        gram, cells = normal.gram.copy(), self.spec.cells
        for first in range(0, len(gram) - 1, cells):
            plane = slice(first, first + cells)
            gram[plane, plane] += strength * normal.rows * self.penalty
        diagonal = gram.diagonal()
        scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        gram *= scale
        gram *= scale[:, None]
        bounded = np.ones(scale.size, dtype=np.bool_)
        bounded[-1] = False
        found = dense_solver.solve(
            dense_solver.Quadratic(dense_solver.GramRows.of(gram), normal.right * scale),
            bounded,
            float(np.sqrt(normal.square)) or 1.0,
            guess=None if guess is None else guess / scale,
        )
        return np.asarray(found.z * scale)

    def cost(self, law: str) -> Callable[[FloatArray], float]:
        """Return the function from the numbers of a law to the log of the error on kept rows."""
        last: list[FloatArray] = []

        def cost(numbers: FloatArray) -> float:
            kept, _ = self.normal(self.constants(law, numbers))
            last[:] = [self.solve(kept, self.strength, last[0] if last else None)]
            return float(np.log(max(kept.error(last[0]), _NOISELESS)))

        return cost

    def tried(self, law: str, say: Callable[[str], None], numbers: FloatArray) -> TriedLaw:
        """Search the constants of a law on the kept rows; score it on the left-out rows.

        The search begins at ``numbers``.
        """
        from scipy.optimize import minimize

        say(f"comparing the law {law!r}")
        if numbers.size:
            # First step of the search in the logarithm of a constant: a factor of two
            simplex = np.vstack([numbers, numbers + 0.7 * np.eye(numbers.size)])
            found = minimize(
                self.cost(law),
                numbers,
                method="Nelder-Mead",
                options={
                    "maxfev": _TRIALS * numbers.size,
                    "xatol": 0.02,
                    "fatol": 1e-4,
                    "initial_simplex": simplex,
                },
            )
            numbers = np.asarray(found.x)
        kept, left_out = self.normal(self.constants(law, numbers))
        strengths = _STRENGTHS if self.smoothness == "auto" else (self.strength,)
        guess, errors = None, []
        for one in strengths:
            x = self.solve(kept, one, guess)
            errors.append(left_out.error(x))
            guess = x
        best = int(np.argmin(errors))
        return TriedLaw(law, numbers, errors[best], strengths[best])

    def result(self, best: TriedLaw, tried: Sequence[TriedLaw]) -> AfterEffectIdentification:
        """Fit all rows by a law."""
        kept, left_out = self.normal(self.constants(best.law, best.numbers))
        whole = kept + left_out
        x = self.solve(whole, best.smoothness)
        return AfterEffectIdentification(
            model=self.model(best, best.numbers, x),
            law=best.law,
            tried=tuple(tried),
            t=self.record.t,
            u=self.record.u,
            y=self.record.y,
            fitted=self.record.fitted,
            held_out=np.zeros_like(self.record.fitted),
            left_out=self.record.left_out,
            curves=self.record.curves,
            groups=self.record.groups,
            weights=self.weights(best, whole, x),
            without=self.model(best, best.numbers, self.solve(kept, best.smoothness, x)),
            settlings=self.settlings(best, x),
        )

    def refit(
        self, best: TriedLaw, numbers: FloatArray, guess: FloatArray
    ) -> tuple[float, FloatArray]:
        """Error and unknowns of a fit of all rows with other constants of a law."""
        kept, left_out = self.normal(self.constants(best.law, numbers))
        whole = kept + left_out
        found = self.solve(whole, best.smoothness, guess)
        return whole.error(found), found

    def weights(self, best: TriedLaw, whole: Normal, x: FloatArray) -> Weights:
        """Uncertainty of the unknowns that are not at their bound."""
        free = x > 0
        free[-1] = True
        gram = whole.gram[np.ix_(free, free)]
        # Ridge of the covariance of the weights, over the largest diagonal: unknowns that no row
        # determines keep a finite variance
        gram[np.diag_indices_from(gram)] += 1e-9 * gram.diagonal().max()
        variance = (whole.error(x) * self.unit) ** 2
        root = np.linalg.inv(np.linalg.cholesky(gram)) * np.sqrt(variance)
        return Weights(self.spec, self.constants(best.law, best.numbers), free, root)

    def model(self, tried: TriedLaw, numbers: FloatArray, x: FloatArray) -> AfterEffect:
        """Operator of the unknowns of a fit."""
        constants, spec = self.constants(tried.law, numbers), self.spec
        found = np.array([unpack(one) for one in (x[:-1] * self.unit).reshape(-1, spec.cells)])
        plane = Preisach(
            spec.levels,
            found[0],
            offset=float(x[-1] * self.unit + self.centre),
            relay=spec.relay,
            diagonal=spec.diagonal,
        )
        creep = np.diff(found, axis=0)
        return AfterEffect(plane, constants.field, constants.settling, constants.times, creep)

    def settlings(self, best: TriedLaw, x: FloatArray) -> tuple[tuple[AfterEffect, float], ...]:
        """Models with other settling times of thresholds, and their likelihood over the best.

        The difference of the squared errors of two fits is compared with its scatter from part to
        part of the record (Vuong, Econometrica 57, 1989). The likelihood of single rows would
        exclude models that are as good, because errors within a curve are alike, and no model is
        exact.
        """
        from scipy.optimize import minimize_scalar

        if best.law not in ("thermal", "wide"):
            return ()
        record, found = self.record, []
        longest = _FARTHEST * longest_hold(record.t, record.u, record.curves)
        least = float(record.intervals.min())
        squares = self.squares(self.model(best, best.numbers, x))
        last, field = [x], np.eye(best.numbers.size)[1]

        def error(numbers: FloatArray) -> float:
            size, last[0] = self.refit(best, numbers, last[0])
            return size

        for factor in (1 / _FACTOR, _FACTOR):
            numbers, likely = best.numbers.copy(), 1.0
            # Likelihood over that of the best below which the search for more extreme settling
            # times ends
            while likely > 0.01:
                numbers[0] += np.log(factor)
                if not least < np.exp(numbers[0]) < longest:
                    break
                nearest = minimize_scalar(
                    lambda shift, numbers=numbers: error(numbers + shift * field),
                    bounds=(-_APART, _APART),
                    method="bounded",
                    options={"maxiter": _REFITS},
                )
                numbers += nearest.x * field
                error(numbers)
                model = self.model(best, numbers, last[0])
                worse = self.squares(model) - squares
                scatter = float(np.std(worse, ddof=1)) * np.sqrt(worse.size) or _NOISELESS
                likely = float(np.exp(-0.5 * max(float(worse.sum()) / scatter, 0.0) ** 2))
                found.append((model, likely))
        return tuple(found)

    def squares(self, model: AfterEffect) -> FloatArray:
        """Sums of the squared errors of a model in each curve, or in contiguous segments."""
        record = self.record
        error = (along(model, record.t, record.u, record.curves) - record.y) / self.unit
        squares = np.where(record.fitted, error, 0.0) ** 2
        begins = record.curves.begins
        if begins.size < _SEGMENTS:
            begins = np.linspace(0, squares.size, _SEGMENTS, endpoint=False).astype(np.intp)
        return np.asarray(np.add.reduceat(squares, begins))


def _wants_rate(record: TimedRecord, rate: bool | Literal["auto"]) -> bool:
    """Whether to compare viscous relays; an error if ``rate`` is true and all rates are alike."""
    if rate is False:
        return False
    speeds, durations = _branches(record)
    several = all(
        # Ratio of the 90th to the 10th percentile of the speeds of branches, and of their
        # durations, below which a record has one rate
        most >= 4.0 * least
        for least, most in (np.quantile(one, [0.1, 0.9]) for one in (speeds, durations))
    )
    if rate is True and not several:
        raise SignalError(
            f"branches last {durations.min():.3g} to {durations.max():.3g} s, at "
            f"{speeds.min():.3g} to {speeds.max():.3g} per second, which is one rate; also record "
            "the same loops ten times as fast, or omit rate"
        )
    return several


def _branches(record: TimedRecord) -> tuple[FloatArray, FloatArray]:
    """Mean speed of the input on each branch between reversals, and seconds for which it moves."""
    moves, steps = np.diff(record.u), record.intervals[1:]
    moving = (moves != 0) & ~record.begins[1:]
    moves, steps = moves[moving], steps[moving]
    if not moves.size:
        return np.ones(1), np.ones(1)
    firsts = np.flatnonzero(np.append(True, np.diff(np.sign(moves)) != 0))
    travels, durations = np.add.reduceat(np.abs(moves), firsts), np.add.reduceat(steps, firsts)
    return travels / durations, durations


def _spectrum(record: TimedRecord, times: npt.ArrayLike | None, wanted: bool) -> FloatArray | None:
    """Return the time constants of a spectrum; None, or an error, where there are no holds."""
    if times is not None:
        found = np.atleast_1d(np.asarray(times, dtype=np.float64))
        if found.ndim != 1 or not (np.isfinite(found) & (found > 0)).all():
            raise ParameterError(f"times are {found}; give positive seconds")
        return np.unique(found)
    steps = record.intervals
    longest = longest_hold(record.t, record.u, record.curves)
    shortest = 2 * float(steps.min())
    if longest < _HELD * float(np.quantile(steps, _SHORT)):
        if wanted:
            raise SignalError(
                f"no input is held for longer than {longest:.3g} s, too short to observe creep; "
                f"record holds of at least {_HELD:.0f} samples"
            )
        return None
    longest = max(longest, shortest)
    count = int(np.ceil(PER_DECADE * np.log10(longest / shortest))) + 1
    return np.geomspace(shortest, longest, as_whole("times", count, 1))

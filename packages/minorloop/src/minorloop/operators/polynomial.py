"""A polynomial without memory: the baseline for models with hysteresis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from numpy.polynomial import polynomial

from minorloop.arrays import (
    ByValue,
    FloatArray,
    Samples,
    as_finite,
    as_pair,
    as_samples,
    as_whole,
    frozen,
)
from minorloop.errors import NotInvertibleError, ParameterError, SignalError
from minorloop.figures import Drawn
from minorloop.operators.inversion import Inversion, Unreachable, as_targets
from minorloop.operators.tracker import StepTracker

_LARGEST = 1e300
"""Largest sum of the terms of an output, as for `Preisach`."""


@dataclass(frozen=True, eq=False)
class Polynomial(ByValue, Drawn):
    """A curve without memory, ``y = sum of coefficients[k] * u**k`` on [low, high].

    Inputs beyond [low, high] are clamped. The methods ignore ``start`` and ``memory``; they exist
    because operators have them.

    Raises a `ParameterError` if there is no coefficient, a number is not finite, or ``low`` is not
    below ``high``.

    References
    ----------
    Chen, Tan and Shahinpoor, Proc. IEEE/ASME AIM 2005, section IV: a quadratic curve as the
    single-valued model of an ionic polymer-metal composite, inverted on its rising branch.

    Examples
    --------
    >>> curve = ml.Polynomial.fit([0.0, 1.0, 2.0], [0.0, 1.0, 4.0], 2)
    >>> curve.invert([1.0]).u.round(6).tolist()
    [1.0]
    """

    coefficients: FloatArray
    """Shape (degree + 1,). Constant first, in the unit of the output over powers of the unit of the
    input."""
    low: float
    high: float
    """Range of inputs in which the curve is valid."""

    def __post_init__(self) -> None:
        try:
            coefficients = frozen(self.coefficients)
        except (TypeError, ValueError) as error:
            raise ParameterError(f"coefficients are not numbers: {error}") from None
        if coefficients.ndim != 1 or coefficients.size == 0 or not np.isfinite(coefficients).all():
            raise ParameterError(
                f"coefficients are {self.coefficients!r}; give finite numbers, constant first"
            )
        object.__setattr__(self, "coefficients", coefficients)
        for name in ("low", "high"):
            object.__setattr__(self, name, as_finite(name, getattr(self, name)))
        if not self.low < self.high:
            raise ParameterError(f"inputs from {self.low:g} to {self.high:g}; give low < high")
        reach = max(abs(self.low), abs(self.high))
        with np.errstate(over="ignore", invalid="ignore"):
            largest = polynomial.polyval(reach, np.abs(coefficients))
        if not largest <= _LARGEST:
            raise ParameterError(
                f"outputs reach beyond {_LARGEST:g} at inputs of {reach:g}; give inputs or outputs "
                "in a larger unit"
            )

    @classmethod
    def fit(
        cls,
        u: npt.ArrayLike,
        y: npt.ArrayLike,
        degree: int = 2,
        *,
        low: float | None = None,
        high: float | None = None,
    ) -> Polynomial:
        """Fit a polynomial to a record, by least squares.

        Raises a `ParameterError` if the degree is not a whole number of at least 1; a `SignalError`
        if lengths differ, or there are too few different inputs for the degree.

        Parameters
        ----------
        u, y : (T,) array_like
            Inputs, and outputs with NaN if not measured.
        degree : int
            Degree of the polynomial, at least 1.
        low, high : float, optional
            Range of inputs; by default that of the record.
        """
        degree = as_whole("degree", degree, 1)
        inputs, outputs = as_pair(u, y)
        known = ~np.isnan(outputs)
        places = np.unique(inputs[known]).size
        if places <= degree:
            raise SignalError(
                f"{places} different inputs with a measured output; degree {degree} needs "
                f"at least {degree + 1}"
            )
        scaled = np.polynomial.Polynomial.fit(inputs[known], outputs[known], degree)
        coefficients = np.zeros(degree + 1)
        raw = scaled.convert().coef
        coefficients[: raw.size] = raw
        return cls(
            coefficients,
            float(inputs.min()) if low is None else low,
            float(inputs.max()) if high is None else high,
        )

    @cached_property
    def range(self) -> tuple[float, float]:
        """Least and greatest output over [low, high]."""
        outputs = self._at(self._turns)
        return float(outputs.min()), float(outputs.max())

    @cached_property
    def monotone_stretch(self) -> tuple[float, float]:
        """Interval of a monotone curve with the widest range of output."""
        turns = self._turns
        outputs = self._at(turns)
        # Smaller changes, as a share of the output range, are rounding and have no direction
        flat = 1e-12 * (outputs.max() - outputs.min())
        best, begin, direction = (self.low, self.low), 0, 0.0
        span = 0.0
        for k in range(1, turns.size):
            change = float(outputs[k] - outputs[k - 1])
            if abs(change) > flat:
                if change * direction < 0:
                    begin = k - 1
                direction = change
            if abs(outputs[k] - outputs[begin]) > span:
                span = abs(float(outputs[k] - outputs[begin]))
                best = (float(turns[begin]), float(turns[k]))
        return best

    @property
    def invertible(self) -> bool:
        """Whether the curve is monotone in [low, high]."""
        return self.monotone_stretch == (self.low, self.high)

    def simulate(self, u: npt.ArrayLike, start: object = None) -> Samples:
        """Return the outputs for input signals; the start is ignored."""
        return self._at(np.clip(as_samples(u, name="u"), self.low, self.high))

    def invert(
        self, targets: npt.ArrayLike, start: object = None, unreachable: Unreachable = "raise"
    ) -> Inversion:
        """Return inputs in [low, high] that bring the output to each target; the start is ignored.

        There is no inverse if the curve is not monotone; `monotone_stretch` gives an interval.
        """
        self._require_monotone()
        wanted, reachable = as_targets(targets, *self.range, unreachable)
        u = self._solve(np.clip(wanted, *self.range))
        y = self._at(u)
        return Inversion(u, y, y - wanted, reachable)

    def step(self, memory: object, u: float) -> tuple[float, object]:
        """Return the output for one input, and the memory, which is ignored and unchanged."""
        return float(self.simulate([as_finite("u", u)])[0]), memory

    def aim(self, memory: object, y: float, unreachable: Unreachable = "raise") -> float:
        """Return the input that brings the output to y; the memory is ignored."""
        return float(self.invert([as_finite("target", y)], unreachable=unreachable).u[0])

    def track(self, start: object = None) -> StepTracker[object]:
        """Return a tracker that follows a live input sample by sample; the start is ignored."""
        return StepTracker(self, start)

    @cached_property
    def _turns(self) -> FloatArray:
        """Ends of the range, and the candidates for extrema of the curve between them."""
        slope = polynomial.polyder(self.coefficients)
        # A leading term that is negligible on the range would give roots near infinity.
        terms = np.abs(slope) * max(abs(self.low), abs(self.high)) ** np.arange(slope.size)
        # A term of the slope below this share of the largest is less than its rounding error
        slope = slope[: np.max(np.nonzero(terms > 1e-17 * terms.max())[0], initial=0) + 1]
        # Rounding can make a double root complex, so real parts of complex roots are used too. If
        # the curve has no extremum there, an interval is only split into two.
        places = np.real(polynomial.polyroots(slope)) if slope.size > 1 else np.empty(0)
        inside = places[(places > self.low) & (places < self.high)]
        return np.concatenate([[self.low], np.unique(inside), [self.high]])

    def _at(self, u: FloatArray) -> FloatArray:
        return np.asarray(polynomial.polyval(u, self.coefficients), dtype=np.float64)

    def _solve(self, targets: FloatArray) -> FloatArray:
        """Return the nearest floats to the inputs of the targets, by bisection."""
        rising = self._at(np.array(self.high)) > self._at(np.array(self.low))
        low, high = np.full(targets.shape, self.low), np.full(targets.shape, self.high)
        # Bisections: more than the 53 bits of a float
        for _ in range(64):
            middle = low + (high - low) / 2
            beyond = (self._at(middle) > targets) == rising
            high = np.where(beyond, middle, high)
            low = np.where(beyond, low, middle)
        nearer = np.abs(self._at(low) - targets) <= np.abs(self._at(high) - targets)
        return np.where(nearer, low, high)

    def _require_monotone(self) -> None:
        low, high = self.monotone_stretch
        if low == high:
            raise NotInvertibleError("the polynomial is constant; fit a higher degree")
        if not self.invertible:
            raise NotInvertibleError(
                f"the polynomial is not monotone in [{self.low:g}, {self.high:g}], only in "
                f"[{low:g}, {high:g}]; use Polynomial(coefficients, *model.monotone_stretch), or a "
                "lower degree"
            )

"""Operators of differential type: the slope of the output depends on the output itself.

A law ``dz/du`` for rising and another for falling inputs gives loops without relays or plays. Its
memory is one number, so minor loops need not close, unlike those of a Preisach operator. The law of
Bouc and Wen is one of these operators. It is used as a force in a vibrating structure
(`dynamics.oscillator`).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    ByValue,
    FloatArray,
    Samples,
    as_finite,
    as_levels,
    check_option,
    frozen,
)
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.operators import _differential_kernels
from minorloop.operators._parallel import filled
from minorloop.operators.inversion import (
    Inversion,
    Unreachable,
    as_signal,
    check_unreachable_option,
    refuse_unreachable,
)
from minorloop.operators.tracker import StepTracker

DifferentialStart: TypeAlias = (
    "npt.ArrayLike | Literal['negative', 'positive', 'demagnetised', 'relaxed']"
)
"""Input and output before the first sample, or the name of a start state."""

_LEAST_EXPONENT = 0.5
"""Least exponent: below it, the slope changes too abruptly at z = 0 for an integration."""


class Differential(ABC):
    """Base of operators with ``dz/du = rising(z)`` for rising and ``falling(z)`` for falling u.

    A start state is one of

    - a (2,) array, the input and the output before the first sample,
    - ``"demagnetised"`` or ``"relaxed"``: both are zero,
    - ``"negative"`` or ``"positive"``: the input came from far below, or from far above, so that
      the output is at its limit.
    """

    @property
    @abstractmethod
    def law(self) -> tuple[FloatArray, FloatArray]:
        """Levels and values of the law, for the compiled loops."""

    @property
    @abstractmethod
    def range(self) -> tuple[float, float]:
        """Limits of the output for falling and for rising inputs; infinite where there is none."""

    def slopes(self, z: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the slopes (n,) for rising and for falling inputs, in output over input.

        ``z`` (n,): outputs.
        """
        outputs, law = as_signal(z, name="z"), self.law
        found = np.empty((2, outputs.size))
        for row, side in enumerate((1.0, -1.0)):
            for k, value in enumerate(outputs):
                index = _differential_kernels.piece(value, True, law[0])
                found[row, k] = _differential_kernels.slope(value, side, index, *law)[0]
        return found[0], found[1]

    def state(self, start: DifferentialStart) -> tuple[float, float]:
        """Return input and output of a start state; the input is infinite at a limit.

        Raises a `ParameterError` if the name is unknown, the operator has no such limit, or the
        numbers are not two.
        """
        if not isinstance(start, str):
            values = np.asarray(start, dtype=np.float64)
            if values.shape != (2,) or not np.isfinite(values).all():
                raise ParameterError(
                    f"start has shape {values.shape}; give two finite numbers, input and output"
                )
            return float(values[0]), float(values[1])
        check_option("start", start, ("negative", "positive", "demagnetised", "relaxed"))
        if start in ("demagnetised", "relaxed"):
            return 0.0, 0.0
        limit = self.range[1 if start == "negative" else 0]
        if not np.isfinite(limit):
            raise ParameterError(
                f"start is {start!r}, but the output has no limit; give 'demagnetised' or the "
                "input and the output before the first sample"
            )
        return (-np.inf if start == "negative" else np.inf), limit

    def simulate(self, u: npt.ArrayLike, start: DifferentialStart = "demagnetised") -> Samples:
        """Return the outputs for input signals that are monotone between samples."""
        before, z = self.state(start)

        def run(u: FloatArray, y: FloatArray) -> None:
            first = before if np.isfinite(before) else float(u[0]) if u.size else 0.0
            _differential_kernels.simulate(u, first, z, *self.law, y)

        return filled(u, run)

    def invert(
        self,
        targets: npt.ArrayLike,
        start: DifferentialStart = "demagnetised",
        unreachable: Unreachable = "raise",
    ) -> Inversion:
        """Return inputs that bring the output to each target in turn, by the shortest way.

        Targets at or beyond a limit are out of reach; ``"clip"`` goes 99.9 % of the way to the
        limit. There is no inverse if the output falls while the input rises at some output within
        the limits.
        """
        check_unreachable_option(unreachable)
        wanted = as_signal(targets, name="targets")
        before, z = self.state(start)
        if not np.isfinite(before):
            raise ParameterError(
                f"start is {start!r}, whose input is not known; give the input and the output "
                "before the first target"
            )
        low, high = self.range
        u, reachable = np.empty_like(wanted), np.empty(wanted.shape, dtype=np.bool_)
        # A clipped target goes 99.9 % of the way to a limit, which itself needs an infinite input
        _differential_kernels.invert(wanted, before, z, low, high, 0.999, *self.law, u, reachable)
        if not np.isfinite(u).all():
            raise NotInvertibleError(
                "the output falls while the input rises, so no input leads to the target; "
                "slopes must be positive between the limits"
            )
        if unreachable == "raise":
            refuse_unreachable(wanted, low, high, reachable)
        y = self.simulate(u, start)
        return Inversion(u, y, y - wanted, reachable)

    def step(self, memory: DifferentialStart, u: float) -> tuple[float, FloatArray]:
        """Return output and memory, (2,) of input and output, after one input."""
        given = as_finite("u", u)
        z = float(self.simulate([given], memory)[0])
        return z, frozen([given, z])

    def aim(self, memory: DifferentialStart, y: float, unreachable: Unreachable = "raise") -> float:
        """Return the input that brings the output to y from a start state, as `Operator.aim`."""
        return float(self.invert([as_finite("target", y)], memory, unreachable).u[0])

    def track(self, start: DifferentialStart = "demagnetised") -> StepTracker[DifferentialStart]:
        """Return a tracker that follows a live input sample by sample."""
        memory = start if isinstance(start, str) else frozen(self.state(start))
        self.state(memory)
        return StepTracker(self, memory)


@dataclass(frozen=True)
class BoucWen(Differential):
    """The law ``dz/du = alpha - (gamma sign(du z) + delta) |z|^exponent`` of Bouc and Wen.

    With the usual ``beta``, give the products, because a loop shows only these. Steps are exact for
    an exponent of 1, and integrated to about seven digits for others.

    Raises a `ParameterError` if a number is not finite or out of its range.

    References
    ----------
    Wen, Method for random vibration of hysteretic systems, ASCE J. Engineering Mechanics 102
    (1976) 249.

    Examples
    --------
    >>> ml.BoucWen(1.0, 0.5, 0.5).simulate([0.5, 0.0]).round(3).tolist()
    [0.393, -0.101]
    """

    alpha: float
    """Slope at z = 0, positive."""
    gamma: float
    delta: float
    """Restoring terms of z; ``gamma + delta > 0`` limits the output."""
    exponent: float = 1.0
    """Exponent nu, at least 0.5, in most texts 1 or more."""

    def __post_init__(self) -> None:
        for name in ("alpha", "gamma", "delta", "exponent"):
            object.__setattr__(self, name, as_finite(name, getattr(self, name)))
        if self.alpha <= 0:
            raise ParameterError(f"alpha is {self.alpha:g}; give a positive slope")
        if self.exponent < _LEAST_EXPONENT:
            raise ParameterError(
                f"exponent is {self.exponent:g}; give at least {_LEAST_EXPONENT:g}"
            )

    @cached_property
    def law(self) -> tuple[FloatArray, FloatArray]:
        """Levels and values of the law, as the compiled loops take them."""
        return frozen([]), frozen([self.alpha, self.gamma, self.delta, self.exponent])

    @property
    def range(self) -> tuple[float, float]:
        """Limits of the output for falling and for rising inputs; infinite where there is none."""
        pull = self.gamma + self.delta
        high = (self.alpha / pull) ** (1 / self.exponent) if pull > 0 else np.inf
        return -high, high


@dataclass(frozen=True, eq=False)
class Duhem(ByValue, Differential):
    """Slopes that are any piecewise linear functions of the output, one for each direction.

    Steps are exact: on each piece the output is an exponential of the input.

    Raises a `ParameterError` if levels do not increase, lengths differ, or a number is not finite.

    References
    ----------
    Duhem, Zeitschrift für physikalische Chemie 22 (1897) 545. Visintin, Differential Models of
    Hysteresis, 1994, chapter 5.
    """

    levels: FloatArray
    """Shape (n,). Outputs at which the slopes are given, strictly increasing."""
    rising: FloatArray
    falling: FloatArray
    """Shape (n,). Slopes ``dz/du`` at the levels for rising and for falling inputs; constant beyond
    them."""

    def __post_init__(self) -> None:
        levels = as_levels(self.levels)
        object.__setattr__(self, "levels", levels)
        for name in ("rising", "falling"):
            values = frozen(getattr(self, name))
            if values.shape != levels.shape or not np.isfinite(values).all():
                raise ParameterError(
                    f"{name} has shape {values.shape}; give {levels.size} finite slopes, one for "
                    "each level"
                )
            object.__setattr__(self, name, values)

    @cached_property
    def law(self) -> tuple[FloatArray, FloatArray]:
        """Levels and values of the law, as the compiled loops take them."""
        return self.levels, frozen(np.concatenate([self.rising, self.falling]))

    @property
    def range(self) -> tuple[float, float]:
        """Limits of the output for falling and for rising inputs; infinite where there is none.

        They are the first zeros of the slopes on the way from the middle of the levels.
        """
        middle = (self.levels[0] + self.levels[-1]) / 2
        high = _first_zero(self.levels, self.rising, middle)
        low = -_first_zero(-self.levels[::-1], self.falling[::-1], -middle)
        return low, high


def _first_zero(levels: FloatArray, slopes: FloatArray, begin: float) -> float:
    """Return the first place from ``begin`` on at which the slopes are not positive."""
    there = np.concatenate([[begin], levels[levels > begin]])
    values = np.interp(there, levels, slopes)
    if (values > 0).all():
        return np.inf
    i = int(np.argmax(values <= 0))
    if i == 0:
        return begin
    share = values[i - 1] / (values[i - 1] - values[i])
    return float(there[i - 1] + share * (there[i] - there[i - 1]))

"""A hysteresis operator in series with linear dynamics, in either order.

In an ionic polymer strip the hysteresis comes first and the linear part follows. In a shape-memory
wire the linear heating comes first and the hysteresis follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, as_finite, as_waveform, check_option
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.propagation import Between
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.figures import NotebookView, figure_of
from minorloop.operators.inversion import Unreachable
from minorloop.operators.operator import Operator

First: TypeAlias = Literal["operator", "linear"]

_FILTER_SHARE = 0.2
_INTERVALS = 5.0
"""Default time constant of the filter of an inverse: this share of the fastest time constant, and
at least this many sampling intervals. A choice: the filter adds little lag to that of the system,
and the input stays smooth from sample to sample."""


@dataclass(frozen=True, eq=False)
class CascadeState:
    """State of a cascade: the memory of the operator and the state of the linear part."""

    memory: Any
    linear: FloatArray


@dataclass(frozen=True, eq=False)
class CascadeInversion(NotebookView):
    """An input that makes a cascade follow a target trajectory.

    Parameters
    ----------
    t : (T,) array
        Times in seconds.
    u : (T,) array
        Inputs.
    y : (T,) array
        Outputs of the cascade for these inputs, linear between samples.
    targets : (T,) array
        Wanted outputs.
    reachable : (T,) array of bool
        Whether the operator can reach the output that it needs at each sample.
    filter_time : float
        Time constant of the filter in seconds; 0 if none is needed.
    """

    t: FloatArray
    u: FloatArray
    y: FloatArray
    targets: FloatArray
    reachable: BoolArray
    filter_time: float

    @property
    def residual(self) -> FloatArray:
        """(T,) outputs minus targets, mostly from the lag of the filter and the dead time."""
        return self.y - self.targets

    @property
    def rms(self) -> float:
        """Root-mean-square of the residual."""
        return float(np.sqrt(np.mean(self.residual**2)))

    def __str__(self) -> str:
        missed = int(np.count_nonzero(~self.reachable))
        rows = [
            ("samples", f"{self.t.size} over {np.ptp(self.t):g} s"),
            ("input", f"{self.u.min():.6g} to {self.u.max():.6g}"),
            ("filter time [s]", f"{self.filter_time:g}"),
            ("error, rms", f"{self.rms:.3g}"),
            ("error, largest", f"{np.abs(self.residual).max():.3g}"),
            ("out of reach", f"{missed} samples"),
        ]
        return "\n".join(f"{name:<24} {value}" for name, value in rows)

    def plot(self) -> Any:
        """Draw targets with outputs, and the input below, in a matplotlib figure."""
        return figure_of(self)


@dataclass(frozen=True, eq=False)
class Cascade:
    """A hysteresis operator and a linear system in series.

    Parameters
    ----------
    operator : Operator
        The hysteresis.
    linear : Linear
        The dynamics. With DC gain 1 the cascade equals the operator for slow inputs.
    first : {"operator", "linear"}
        Which of the two receives the input.

    Raises
    ------
    ParameterError
        If ``first`` is neither.

    References
    ----------
    Chen, Tan and Shahinpoor, Proc. IEEE/ASME AIM 2005, section V: operator first.
    """

    operator: Operator
    linear: Linear
    first: First = "operator"

    def __post_init__(self) -> None:
        check_option("first", self.first, ("operator", "linear"))

    def simulate(
        self,
        t: npt.ArrayLike,
        u: npt.ArrayLike,
        start: Any = "negative",
        *,
        before: float | None = None,
        between: Between = "held",
    ) -> FloatArray:
        """Return the outputs for a sampled input.

        Parameters
        ----------
        t : (T,) array_like
            Strictly increasing times in seconds.
        u : (T,) array_like
            Inputs.
        start : start state of the operator
            Memory before ``before`` was applied.
        before : float, optional
            Input at which the cascade had settled before; the first of ``u`` if not given.
        between : {"held", "straight"}
            As in `Linear.simulate`, for the signal between the two parts too.

        Returns
        -------
        (T,) array

        Raises
        ------
        SignalError
            If the shapes differ or times do not increase.
        """
        times, inputs = as_waveform(t, u)
        held = float(inputs[0]) if before is None else as_finite("before", before)
        if self.first == "linear":
            filtered = self.linear.simulate(times, inputs, before=held, between=between)
            settled = held * self.linear.dc_gain
            return self.operator.simulate(np.append(settled, filtered), start)[1:]
        w = self.operator.simulate(np.append(held, inputs), start)
        return self.linear.simulate(times, w[1:], before=float(w[0]), between=between)

    def begin(self, before: float, start: Any = "negative") -> CascadeState:
        """Return the state of a sampled cascade that has settled at an input.

        Parameters
        ----------
        before : float
            The input.
        start : start state of the operator
            Memory before it was applied.

        Raises
        ------
        ParameterError
            If the linear part is continuous; discretise it first.
        """
        if self.first == "linear":
            w = as_finite("before", before) * self.linear.dc_gain
            return CascadeState(self.operator.step(start, w)[1], self.linear.settled(before))
        w, memory = self.operator.step(start, before)
        return CascadeState(memory, self.linear.settled(w))

    def step(self, state: CascadeState, u: float) -> tuple[float, CascadeState]:
        """Return output and state after one interval with a constant input.

        The given state is not changed.

        Parameters
        ----------
        state : CascadeState
            Memory of the operator and state of the linear part.
        u : float
            Input held over the interval.

        Raises
        ------
        ParameterError
            If the linear part is continuous; discretise it first.
        """
        if self.first == "linear":
            w, x = self.linear.step(state.linear, u)
            y, memory = self.operator.step(state.memory, w)
            return y, CascadeState(memory, x)
        w, memory = self.operator.step(state.memory, u)
        y, x = self.linear.step(state.linear, w)
        return y, CascadeState(memory, x)

    def invert(
        self,
        t: npt.ArrayLike,
        targets: npt.ArrayLike,
        start: Any = "negative",
        *,
        before: float,
        filter_time: float | None = None,
        unreachable: Unreachable = "raise",
    ) -> CascadeInversion:
        """Return the input with which the output follows a trajectory.

        The inverse of the linear part G differentiates. It is therefore combined with a filter
        F(s) = 1 / (1 + filter_time s)^r, where r is the relative degree of G, so that F / G is
        proper. The output follows the filtered targets; with the linear part first, the input of
        the operator follows the filtered signal that the targets need. Dead time is not
        compensated.

        Parameters
        ----------
        t : (T,) array_like
            Strictly increasing times in seconds; signals are linear between them.
        targets : (T,) array_like
            Wanted outputs.
        start : start state of the operator
            Memory before ``before`` was applied.
        before : float
            Input at which the cascade had settled before.
        filter_time : float, optional
            Seconds; a longer filter gives a smoother input and more lag. If not given, a fifth of
            the fastest time constant of G, or five intervals of ``t`` if that is longer.
        unreachable : {"raise", "clip"}
            What to do about targets out of reach of the operator.

        Returns
        -------
        CascadeInversion

        Raises
        ------
        NotInvertibleError
            If the linear part is unstable or has zeros with a real part >= 0, or the operator is
            not monotone.
        UnreachableError
            If a target is out of reach of the operator and ``unreachable="raise"``.
        """
        times, wanted = as_waveform(t, targets, name="targets")
        linear = self.linear if self.linear.interval is None else self.linear.continuous()
        seconds = _filter_time(linear, times, filter_time)
        inverse = _filtered_inverse(linear, seconds)
        gain = linear.dc_gain
        if self.first == "operator":
            w, memory = self.operator.step(start, before)
            needed = inverse.simulate(times, wanted, before=w * gain, between="straight")
            found = self.operator.invert(needed, memory, unreachable)
            u = found.u
        else:
            memory = self.operator.step(start, before * gain)[1]
            found = self.operator.invert(wanted, memory, unreachable)
            u = inverse.simulate(times, found.u, before=before * gain, between="straight")
        model = Cascade(self.operator, linear, self.first)
        y = model.simulate(times, u, start, before=before, between="straight")
        return CascadeInversion(times, u, y, wanted, found.reachable, seconds)


def _filter_time(linear: Linear, t: FloatArray, wanted: float | None) -> float:
    if linear.relative_degree == 0:
        return 0.0
    if wanted is None:
        fastest = float(linear.time_constants[-1])
        return max(_FILTER_SHARE * fastest, _INTERVALS * float(np.median(np.diff(t))))
    seconds = as_finite("filter_time", wanted)
    if seconds <= 0:
        raise ParameterError(
            f"filter_time is {wanted:g} s; a system with more poles than zeros cannot be inverted "
            "without a filter, so give a positive time"
        )
    return seconds


def _filtered_inverse(linear: Linear, seconds: float) -> Linear:
    if not linear.stable:
        raise NotInvertibleError("the linear part is unstable; give one whose poles all decay")
    if linear.dc_gain == 0 or (linear.zeros.real >= 0).any():
        worst = linear.zeros[np.argmax(linear.zeros.real)] if linear.zeros.size else 0.0
        raise NotInvertibleError(
            f"the linear part has a zero at {worst:.4g} 1/s; with zeros in the right half plane "
            "or on the imaginary axis the inverse grows without bound, so identify with fewer zeros"
        )
    numerator = linear.numerator[linear.relative_degree :]
    smooth = np.array([1.0])
    for _ in range(linear.relative_degree):
        smooth = np.convolve(smooth, [seconds, 1.0])
    return Linear(linear.denominator, np.convolve(numerator, smooth))

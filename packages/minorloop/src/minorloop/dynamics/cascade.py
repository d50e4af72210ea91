"""A hysteresis operator in series with linear dynamics, and creep of the output.

In an ionic polymer strip the hysteresis comes first and the linear part follows. In a shape-memory
wire the linear heating comes first and the hysteresis follows. A piezo has dynamics on both sides:
its amplifier before, mechanics and sensor behind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, as_finite, as_seconds, as_waveform, check_option
from minorloop.dynamics.creep import Creep
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.state_space import Between
from minorloop.errors import NotInvertibleError, ParameterError, UnreachableError
from minorloop.figures import Drawn
from minorloop.operators.inversion import Inversion, Unreachable, refuse_unreachable, within_reach
from minorloop.operators.operator import Operator

First: TypeAlias = Literal["operator", "linear"]


@dataclass(frozen=True, eq=False)
class CascadeState:
    """State of a cascade: memory of the operator, states of linear parts and of the creep."""

    memory: Any
    linear: FloatArray
    creep: FloatArray | None = None
    ahead: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class CascadeInversion(Drawn):
    """An input that makes a cascade follow a target trajectory."""

    t: FloatArray
    """Shape (T,). Times in seconds."""
    u: FloatArray
    """Shape (T,). Inputs."""
    y: FloatArray
    """Shape (T,). Outputs of the cascade for these inputs, linear between samples."""
    targets: FloatArray
    """Shape (T,). Target outputs."""
    reachable: BoolArray
    """Shape (T,). Whether the operator can reach its required output at each sample."""
    filter_time: float
    """Time constant of the filter in seconds; 0 if none is needed."""
    lead: float = 0.0
    """Seconds by which the input is ahead of the targets. The last target is held for this time
    after the end of the trajectory."""

    @property
    def residual(self) -> FloatArray:
        """(T,) outputs minus targets, mostly because the filter rounds corners off."""
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
            ("input ahead by [s]", f"{self.lead:.4g}"),
            ("error, rms", f"{self.rms:.3g}"),
            ("error, largest", f"{np.abs(self.residual).max():.3g}"),
            ("out of reach", f"{missed} samples"),
        ]
        return "\n".join(f"{name:<24} {value}" for name, value in rows)


@dataclass(frozen=True, eq=False)
class Cascade:
    """A hysteresis operator and a linear system in series, and creep of the output.

    Raises a `ParameterError` if ``first`` is neither, ``noise`` is not from 0 to 1, or ``ahead`` is
    given although ``linear`` comes first.

    References
    ----------
    Chen, Tan and Shahinpoor, Proc. IEEE/ASME AIM 2005, section V: operator first.

    Examples
    --------
    >>> plane = ml.Preisach([-1.0, 0.0, 1.0], [[1.0, 0.0], [0.5, 1.0]])
    >>> strip = ml.Cascade(plane, ml.Linear.lags(0.5))
    >>> strip.simulate([0.0, 1.0, 20.0], [-1.0, 1.0, 1.0]).round(2).tolist()
    [-2.5, 1.82, 2.5]
    """

    operator: Operator
    """The hysteresis."""
    linear: Linear
    """The dynamics. With DC gain 1 the cascade equals the operator for slow inputs."""
    first: First = "operator"
    """The part that receives the input."""
    creep: Creep | None = None
    """Creep of the output of both parts."""
    noise: float = 0.0
    """Error of the model over the range of its output, if it is known. `invert` does not follow
    frequencies at which the linear part has a smaller gain."""
    ahead: Linear | None = None
    """Dynamics before the operator, if there are dynamics on both sides; the operator then comes
    before ``linear``."""

    def __post_init__(self) -> None:
        check_option("first", self.first, ("operator", "linear"))
        if self.ahead is not None and self.first == "linear":
            raise ParameterError(
                "first is 'linear' and ahead is given too; give the dynamics before the operator "
                "as ahead and those behind it as linear, with first='operator'"
            )
        if not 0 <= as_finite("noise", self.noise) < 1:
            raise ParameterError(f"noise is {self.noise:g}; give a share of the range, 0 to 1")

    def simulate(
        self,
        t: npt.ArrayLike,
        u: npt.ArrayLike,
        start: Any = "negative",
        *,
        before: float | None = None,
        between: Between = "held",
    ) -> FloatArray:
        """Return the outputs for a sampled input, as `TimedModel.simulate`.

        ``between`` is that of `Linear.simulate`, for the signal between the two parts too.
        """
        times, inputs = as_waveform(t, u)
        held = float(inputs[0]) if before is None else as_finite("before", before)
        if self.ahead is not None:
            inputs = self.ahead.simulate(times, inputs, before=held, between=between)
            held *= self.ahead.dc_gain
        if self.first == "linear":
            filtered = self.linear.simulate(times, inputs, before=held, between=between)
            settled = held * self.linear.dc_gain
            w = self.operator.simulate(np.append(settled, filtered), start)
            rest, y = float(w[0]), w[1:]
        else:
            w = self.operator.simulate(np.append(held, inputs), start)
            y = self.linear.simulate(times, w[1:], before=float(w[0]), between=between)
            rest = float(w[0]) * self.linear.dc_gain
        return y if self.creep is None else self.creep.simulate(times, y, before=rest)

    def sampled(self, interval: float) -> Cascade:
        """Return the cascade with a sampled linear part; dead time becomes whole intervals.

        Raises a `ParameterError` if the linear part is sampled at another interval, or the interval
        is not positive.

        Parameters
        ----------
        interval : float
            Seconds between samples.
        """
        step = as_seconds("interval", interval)
        ahead = None if self.ahead is None else _sampled(self.ahead, step)
        linear = _sampled(self.linear, step)
        same = linear is self.linear and ahead is self.ahead
        return self if same else replace(self, linear=linear, ahead=ahead)

    def begin(self, before: float, start: Any = "negative") -> CascadeState:
        """Return the state of a sampled cascade that has settled; parameters are as of `simulate`.

        Raises a `ParameterError` if the linear part is continuous; discretise it first.
        """
        ahead = None
        if self.ahead is not None:
            ahead = self.ahead.settled(before)
            before *= self.ahead.dc_gain
        if self.first == "linear":
            w = as_finite("before", before) * self.linear.dc_gain
            rest, memory = self.operator.step(start, w)
            settled = self.linear.settled(before)
        else:
            w, memory = self.operator.step(start, before)
            rest, settled = w * self.linear.dc_gain, self.linear.settled(w)
        creep = None if self.creep is None else self.creep.settled(rest)
        return CascadeState(memory, settled, creep, ahead)

    def step(self, state: CascadeState, u: float) -> tuple[float, CascadeState]:
        """Return output and state after one interval with a constant input, as `Operator.step`.

        Raises a `ParameterError` if the linear part is continuous; discretise it first.
        """
        ahead = None
        if self.ahead is not None and state.ahead is not None:
            u, ahead = self.ahead.step(state.ahead, u)
        if self.first == "linear":
            w, x = self.linear.step(state.linear, u)
            y, memory = self.operator.step(state.memory, w)
        else:
            w, memory = self.operator.step(state.memory, u)
            y, x = self.linear.step(state.linear, w)
        if self.creep is None or state.creep is None or self.linear.interval is None:
            return y, CascadeState(memory, x, ahead=ahead)
        y, crept = self.creep.step(state.creep, y, self.linear.interval)
        return y, CascadeState(memory, x, crept, ahead)

    def invert(
        self,
        t: npt.ArrayLike,
        targets: npt.ArrayLike,
        start: Any = "negative",
        *,
        before: float,
        filter_time: float | None = None,
        unreachable: Unreachable = "raise",
        between: Between = "straight",
    ) -> CascadeInversion:
        """Return the input with which the output follows a trajectory, linear between samples.

        The inverse of the linear part G differentiates. It is therefore combined with a filter F, a
        low-pass of Butterworth with the corner at 1 / filter_time. F has as many poles as G has
        more poles than zeros, so that F / G is proper. The targets are known in advance: the input
        is earlier by the dead time and the lag of the filter, so that neither delays the output;
        the last target is held. If the linear part comes first, the input of the operator follows
        the filtered signal for the targets. Zeros of G that are faster than the filter, such as
        those of a sampled system, count as dead time. Other parameters and errors are those of
        `TimedModel.invert`; ``start`` and ``before`` are as of `simulate`.

        Raises a `NotInvertibleError` if the linear part is unstable or has slow zeros with a real
        part >= 0, the creep has no prompt part, or the operator is not monotone.

        Parameters
        ----------
        filter_time : float, optional
            Seconds; a longer filter gives a smoother input and rounder corners. By default the
            longest of: a fifth of the fastest time constant of G, two intervals of ``t``, and the
            reciprocal of the frequency from which the gain of G is below ``noise``.
        between : {"straight", "held"}
            The input between samples, as in `Linear.simulate`.
        """
        times, goals = as_waveform(t, targets, name="targets")
        linear = _invertible(self.linear)
        seconds = _filter_time(linear, times, self.noise, filter_time)
        # A held input is early by half a sample.
        early = float(np.median(np.diff(times))) / 2 if between == "held" else 0.0
        inverse, late = filtered_inverse(linear, seconds, flat=True)
        late -= early
        ahead = None if self.ahead is None else _invertible(self.ahead)
        held = before * (1.0 if ahead is None else ahead.dc_gain)
        needed, gain = goals, linear.dc_gain
        w, memory = self.operator.step(start, held * (gain if self.first == "linear" else 1.0))
        if self.creep is not None:
            rest = w if self.first == "linear" else w * gain
            needed = self.creep.compensate(times, goals, before=rest)
        if self.first == "operator":
            needed = np.interp(times + late, times, needed)
            needed = inverse.simulate(times, needed, before=w * gain, between="straight")
        settled = gain if self.first == "operator" else 1.0
        settled *= 1.0 if self.creep is None else self.creep.dc_gain
        found = _inverted(self.operator, needed, memory, unreachable, goals, (w * gain, settled))
        u, lead = found.u, late
        if self.first == "linear":
            filtered = np.interp(times + late, times, u)
            u = inverse.simulate(times, filtered, before=before * gain, between="straight")
        elif ahead is not None:
            before_seconds = _filter_time(ahead, times, self.noise, filter_time)
            inverse, late = filtered_inverse(ahead, before_seconds, flat=True)
            filtered = np.interp(times + late - early, times, u)
            u = inverse.simulate(times, filtered, before=held, between="straight")
            seconds, lead = max(seconds, before_seconds), lead + late - early
        model = replace(self, linear=linear, ahead=ahead)
        y = model.simulate(times, u, start, before=before, between=between)
        return CascadeInversion(times, u, y, goals, found.reachable, seconds, lead)


def _sampled(linear: Linear, interval: float) -> Linear:
    """Return a sampled system; dead time becomes whole intervals."""
    if linear.interval is None:
        delay = round(linear.delay / interval) * interval
        return replace(linear, delay=delay).discretise(interval)
    if linear.interval != interval:
        raise ParameterError(
            f"interval is {interval:g} s and that of the linear part {linear.interval:g} s"
        )
    return linear


def _invertible(linear: Linear) -> Linear:
    """Return a system in continuous time; refuse an unstable system."""
    found = linear if linear.interval is None else linear.continuous()
    if not found.stable:
        raise NotInvertibleError("the linear part is unstable; give a stable linear part")
    return found


def _inverted(
    operator: Any,
    needed: FloatArray,
    memory: Any,
    unreachable: Unreachable,
    goals: FloatArray,
    rest: tuple[float, float],
) -> Inversion:
    """Invert the required outputs of an operator; errors name the targets that are out of reach.

    ``rest`` are the previous output, and the ratio of output to operator output, both at rest.
    """
    try:
        found: Inversion = operator.invert(needed, memory, unreachable)
        return found
    except UnreachableError as error:
        low, high = np.sort(rest[1] * np.array(operator.range)).tolist()
        refuse_unreachable(goals, low, high, within_reach(goals, low, high))
        reached = operator.invert(needed, memory, "clip").reachable
        index = int(np.flatnonzero(~reached)[0])
        raise UnreachableError(
            f"target {goals[index]:g} at index {index} needs {needed[index]:g} from the operator, "
            f"because of the dynamics; the output rests at {rest[0]:g} before. Begin there, move "
            f'slower, or pass unreachable="clip" ({error})'
        ) from None


def _filter_time(linear: Linear, t: FloatArray, noise: float, given: float | None) -> float:
    if linear.relative_degree == 0:
        return 0.0
    if given is None:
        # For a resonance, it is the period over 2 pi, not the longer decay time.
        fastest = 1 / float(np.abs(linear.poles).max())
        # The default time constant of the filter is at least a fifth of the fastest time constant,
        # and two sampling intervals. A choice: the input stays smooth from sample to sample.
        smooth = 2.0 * float(np.median(np.diff(t)))
        return max(0.2 * fastest, smooth, _time_of_gain(linear, noise))
    seconds = as_finite("filter_time", given)
    if seconds <= 0:
        raise ParameterError(
            f"filter_time is {given:g} s; a system with more poles than zeros cannot be inverted "
            "without a filter, so give a positive time"
        )
    return seconds


def _time_of_gain(linear: Linear, least: float) -> float:
    """Return 1 / omega of the highest frequency with at least this ratio of gain to DC gain."""
    if linear.dc_gain == 0:
        return 0.0
    times = linear.time_constants
    # Frequencies at which the gain is compared with the error of the model: about 2 % apart
    omega = np.geomspace(1e-2 / times[0], 1e3 / times[-1], 400)
    gain = np.abs(linear.response(omega / (2 * np.pi)) / linear.dc_gain)
    above = np.flatnonzero(gain >= least)
    return float(1 / omega[above[-1]]) if above.size else float(times[0])


def filtered_inverse(linear: Linear, seconds: float, *, flat: bool = False) -> tuple[Linear, float]:
    """Return F / G, and the delay in seconds of F and of the parts of G that F / G leaves out.

    F has equal poles, or is ``flat``, a low-pass of Butterworth (Wireless Engineer 7, 1930): it is
    nearer to 1 below its corner, but passes more noise near the corner.
    """
    zeros = linear.zeros
    slow = np.abs(zeros) * seconds < 1.0
    kept, left_out = (zeros[slow], zeros[~slow]) if seconds else (zeros, zeros[:0])
    if linear.dc_gain == 0 or (kept.real >= 0).any():
        worst = kept[np.argmax(kept.real)] if kept.size else 0.0
        raise NotInvertibleError(
            f"the linear part has a zero at {worst:.4g} 1/s; with zeros in the right half plane "
            "or on the imaginary axis the inverse grows without bound, so identify with fewer zeros"
        )
    filtered = linear.order - kept.size
    angles = np.pi * np.arange(1 - filtered, filtered, 2) / (2 * filtered)
    lowpass = -np.exp(1j * angles if flat else 0 * angles) / seconds
    poles = np.concatenate([kept, lowpass])
    inverse = Linear.from_poles(poles, linear.poles, dc_gain=1 / linear.dc_gain)
    # A fast zero at z is a factor 1 - s / z, nearly exp(-s / z); a pole at p is late by -1 / p.
    late = linear.delay + float((1 / left_out).real.sum() - (1 / lowpass).real.sum())
    return inverse, late

"""Linear systems with one input, one output and dead time, continuous or sampled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    ByValue,
    FloatArray,
    as_finite,
    as_samples,
    as_seconds,
    as_times,
    as_waveform,
    check_option,
    frozen,
)
from minorloop.dynamics import _kernels, state_space
from minorloop.dynamics.state_space import Between, StateSpace, propagate
from minorloop.errors import ParameterError, SignalError
from minorloop.figures import Drawn

_WHOLE = 1e-6
"""Share of an interval by which times may differ from whole intervals: recorded times are often
rounded to the microsecond."""


@dataclass(frozen=True, eq=False)
class Linear(ByValue, Drawn):
    """A rational transfer function with dead time, continuous or sampled.

    Raises a `ParameterError` if a number is not finite, the system is not causal, or a time is out
    of its range.

    Examples
    --------
    >>> ml.Linear.lags(0.5, 2.0).time_constants.tolist()
    [2.0, 0.5]
    """

    numerator: FloatArray
    denominator: FloatArray
    """Coefficients in descending powers of s, or of z for a sampled system. The degree of the
    numerator is at most that of the denominator, whose first coefficient is not zero. They are
    stored in equal number, divided by the first coefficient of the denominator."""
    interval: float | None = None
    """Time between samples in seconds; None for a continuous system. The input of a sampled system
    is held over each interval."""
    delay: float = 0.0
    """Dead time in seconds; a whole number of intervals for a sampled system."""

    def __post_init__(self) -> None:
        store = object.__setattr__
        numerator = np.trim_zeros(_coefficients("numerator", self.numerator), "f")
        denominator = _coefficients("denominator", self.denominator)
        if denominator[0] == 0:
            raise ParameterError("the first coefficient of the denominator is 0; leave it out")
        if numerator.size > denominator.size:
            raise ParameterError(
                f"the numerator has degree {numerator.size - 1} and the denominator "
                f"{denominator.size - 1}; a causal system has no more zeros than poles"
            )
        padded = np.concatenate([np.zeros(denominator.size - numerator.size), numerator])
        store(self, "numerator", frozen(padded / denominator[0]))
        store(self, "denominator", frozen(denominator / denominator[0]))
        if self.interval is not None:
            store(self, "interval", as_seconds("interval", self.interval))
        store(self, "delay", as_finite("delay", self.delay))
        if self.delay < 0:
            raise ParameterError(f"delay is {self.delay:g} s; give a dead time >= 0")
        self._check_delay(self.interval)

    @classmethod
    def from_poles(
        cls,
        poles: npt.ArrayLike,
        zeros: npt.ArrayLike = (),
        *,
        dc_gain: float = 1.0,
        delay: float = 0.0,
    ) -> Linear:
        """Return a continuous system with these poles and zeros.

        Parameters
        ----------
        poles : sequence of complex
            Poles in 1/s.
        zeros : sequence of complex
            Zeros in 1/s.
        dc_gain : float
            Settled output per input.
        delay : float
            Dead time, in seconds.
        """
        poles, zeros = np.atleast_1d(poles), np.atleast_1d(zeros)
        numerator, denominator = _polynomial("zeros", zeros), _polynomial("poles", poles)
        unit = cls(numerator, denominator, delay=delay)
        return cls(numerator * dc_gain / unit._finite_dc_gain, denominator, delay=delay)

    @classmethod
    def lags(cls, *times: float, delay: float = 0.0) -> Linear:
        """Return first-order lags in series, with DC gain 1.

        Parameters
        ----------
        *times : float
            Time constants, in seconds.
        delay : float
            Dead time, in seconds.
        """
        each = [-1 / as_seconds("time constant", time) for time in times]
        return cls.from_poles(each, delay=delay)

    @property
    def order(self) -> int:
        """Number of poles."""
        return int(self.denominator.size - 1)

    @property
    def relative_degree(self) -> int:
        """Number of poles minus number of zeros."""
        return self.order - self.zeros.size

    @cached_property
    def poles(self) -> npt.NDArray[np.complex128]:
        """(n,) poles, in 1/s, or in the z-plane."""
        return np.asarray(np.roots(self.denominator), dtype=np.complex128)

    @cached_property
    def zeros(self) -> npt.NDArray[np.complex128]:
        """Zeros, in 1/s, or in the z-plane."""
        return np.asarray(np.roots(self.numerator), dtype=np.complex128)

    @property
    def stable(self) -> bool:
        """Whether every bounded input has a bounded output."""
        if self.interval is None:
            return bool((self.poles.real < 0).all())
        return bool((np.abs(self.poles) < 1).all())

    @property
    def time_constants(self) -> FloatArray:
        """(n,) seconds in which each mode decays to 1/e, slowest first; infinite if it does not."""
        with np.errstate(divide="ignore"):
            if self.interval is None:
                rates = -self.poles.real
            else:
                rates = -np.log(np.abs(self.poles)) / self.interval
            times = np.where(rates > 0, 1 / rates, np.inf)
        return np.asarray(np.sort(times)[::-1])

    @property
    def dc_gain(self) -> float:
        """Settled output per input; infinite for an integrator."""
        top, bottom = self.at_rest(self.numerator), self.at_rest(self.denominator)
        return top / bottom if bottom else np.inf

    def normalised(self) -> Linear:
        """Return the same system with DC gain 1.

        Raises a `ParameterError` if its DC gain is zero or infinite.
        """
        if self._finite_dc_gain == 0:
            raise ParameterError("the DC gain is 0 and cannot be made 1")
        return self._with_dc_gain(1.0)

    def response(self, frequency: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """Return the complex gain at each frequency.

        Parameters
        ----------
        frequency : array_like
            Frequencies, in Hz.
        """
        s = 2j * np.pi * np.asarray(frequency, dtype=np.float64)
        at = s if self.interval is None else np.exp(s * self.interval)
        ratio = np.polyval(self.numerator, at) / np.polyval(self.denominator, at)
        return np.asarray(ratio * np.exp(-s * self.delay))

    def simulate(
        self, t: npt.ArrayLike, u: npt.ArrayLike, *, before: float = 0.0, between: Between = "held"
    ) -> FloatArray:
        """Return the outputs for a sampled input, as `TimedModel.simulate`; exact between samples.

        Raises a `SignalError` also if the times are not those of a sampled system; a
        `ParameterError` if the system integrates and ``before`` is not 0, or ``between`` does not
        suit it.

        Parameters
        ----------
        before : float
            Input at which the system had settled before; 0 by default.
        between : {"held", "straight"}
            ``"held"``: u[k] is the input since the previous sample, and u[0] lasts as long as u[1],
            as actuators record holds. ``"straight"``: the input jumps to u[0] at t[0] and is linear
            between samples; only for continuous systems.

        """
        times, inputs = as_waveform(t, u)
        check_option("between", between, ("held", "straight"))
        x = self._settled(as_finite("before", before))
        if self.interval is None:
            return propagate(
                self.state_space, x, times, inputs, delay=self.delay, before=before, between=between
            )
        if between != "held":
            raise ParameterError(
                "a sampled system holds its input; simulate system.continuous() instead"
            )
        self._check_sampling(times)
        return self._filter(inputs, before)

    def step_response(self, t: npt.ArrayLike) -> FloatArray:
        """Return the outputs (T,) after a unit step at time 0; they are 0 before it.

        Outputs of a sampled system are interpolated linearly between samples.

        Raises a `SignalError` if the times do not increase.

        Parameters
        ----------
        t : (T,) array_like
            Times, in seconds.
        """
        times = as_times(t, fewest=1)
        y = np.zeros(times.size)
        after = times > 0
        if after.any():
            y[after] = self._step_after(times[after])
        if self.delay == 0:
            y[times == 0] = self.numerator[0]
        return y

    def discretise(self, interval: float) -> Linear:
        """Return the sampled system with the same outputs for inputs held over each interval.

        Raises a `ParameterError` if it is sampled already, or the dead time is not a whole number
        of intervals.

        Parameters
        ----------
        interval : float
            Seconds between samples.
        """
        if self.interval is not None:
            raise ParameterError(f"the system is sampled already, every {self.interval:g} s")
        step = as_seconds("interval", interval)
        top, bottom = state_space.sampled(self.numerator, self.denominator, step)
        return Linear(top, bottom, step, self.delay)._with_dc_gain(self.dc_gain)

    def continuous(self) -> Linear:
        """Return the continuous system with the same outputs for inputs held over each interval.

        It is computed by the principal logarithm of the transition matrix.

        Raises a `ParameterError` if it is continuous already, or has a pole at 0 or on the negative
        real axis, where this logarithm does not exist. Such a mode ends within one sample or
        changes its sign at every sample; continuous systems of the same order do not.
        """
        if self.interval is None:
            raise ParameterError("the system is continuous already")
        top, bottom = state_space.continuous(self.numerator, self.denominator, self.interval)
        return Linear(top, bottom, None, self.delay)._with_dc_gain(self.dc_gain)

    def settled(self, u: float) -> FloatArray:
        """Return the state (n + delayed samples,) of a sampled system that has settled.

        Raises a `ParameterError` if the system is continuous, or does not settle.

        Parameters
        ----------
        u : float
            Input at which the system has settled.
        """
        value = as_finite("u", u)
        return np.concatenate([self._settled(value), np.full(self.lag, value)])

    def step(self, state: FloatArray, u: float) -> tuple[float, FloatArray]:
        """Return output and state after an interval; `settled` returns the first state.

        Raises a `ParameterError` if the system is continuous; discretise it first.
        """
        lag, n = self.lag, self.order
        a, b, c, d = self.state_space
        queue = np.append(state[n:], as_finite("u", u))
        x = a @ state[:n] + b * queue[0]
        return float(c @ x + d * queue[0]), np.concatenate([x, queue[queue.size - lag :]])

    def __str__(self) -> str:
        kind = "continuous" if self.interval is None else f"every {self.interval:g} s"
        times = ", ".join(f"{time:.4g}" for time in self.time_constants)
        rows = [
            ("linear system", f"order {self.order}, {kind}"),
            ("time constants [s]", times or "none"),
            ("poles", ", ".join(f"{pole:.4g}" for pole in _plain(self.poles)) or "none"),
            ("zeros", ", ".join(f"{zero:.4g}" for zero in _plain(self.zeros)) or "none"),
            ("DC gain", f"{self.dc_gain:.6g}"),
            ("dead time [s]", f"{self.delay:g}"),
        ]
        return "\n".join(f"{name:<24} {value}" for name, value in rows)

    @cached_property
    def state_space(self) -> StateSpace:
        """Matrices A, B, C, D in controllable canonical form."""
        return state_space.canonical(self.numerator, self.denominator)

    @property
    def _finite_dc_gain(self) -> float:
        if not np.isfinite(self.dc_gain):
            raise ParameterError("the system integrates: its DC gain is infinite")
        return self.dc_gain

    @property
    def lag(self) -> int:
        """Dead time in sampling intervals, of a sampled system."""
        if self.interval is None:
            raise ParameterError("the system is continuous; discretise it to step through it")
        return round(self.delay / self.interval)

    def _with_dc_gain(self, gain: float) -> Linear:
        """Return the same system scaled to this DC gain, if both gains are finite and not 0."""
        own = self.dc_gain
        if not np.isfinite([gain, own]).all() or gain == 0 or own == 0:
            return self
        return Linear(self.numerator * (gain / own), self.denominator, self.interval, self.delay)

    def at_rest(self, coefficients: FloatArray) -> float:
        """Return the value of a polynomial of the system at s = 0, or z = 1 if it is sampled.

        Parameters
        ----------
        coefficients : (n,) array
            Numerator or denominator, highest power first.
        """
        return float(coefficients[-1] if self.interval is None else coefficients.sum())

    def _settled(self, u: float) -> FloatArray:
        x = np.zeros(self.order)
        if u != 0 and self.order:
            rest = self.at_rest(self.denominator)
            if rest == 0:
                raise ParameterError(
                    f"the system integrates and does not settle at {u:g}; give 0 before"
                )
            x[-1 if self.interval is None else slice(None)] = u / rest
        return x

    def _step_after(self, after: FloatArray) -> FloatArray:
        """Return the step response at times after 0."""
        if self.interval is None:
            times = np.concatenate([[0.0], after])
            return self.simulate(times, np.ones(times.size), between="straight")[1:]
        count = int(np.ceil(after[-1] / self.interval)) + 1
        grid = self.interval * np.arange(count + 1)
        begin = self.numerator[0] if self.delay == 0 else 0.0
        rise = np.append(begin, self._filter(np.ones(count), 0.0))
        return np.asarray(np.interp(after, grid, rise))

    def _filter(self, u: FloatArray, before: float) -> FloatArray:
        """Return the outputs of a sampled system at the ends of the intervals of u."""
        a, b, c, d = self.state_space
        delayed = np.concatenate([np.full(self.lag, before), u])[: u.size]
        states = np.empty((u.size, self.order))
        first = np.zeros(u.size, dtype=np.int64)
        x = self._settled(before)
        _kernels.march(a[None], np.zeros((1, b.size)), b[None], first, delayed, delayed, x, states)
        return np.asarray(states @ c + d * delayed)

    def _check_sampling(self, t: FloatArray) -> None:
        step = self.interval or 0.0
        if not np.allclose(np.diff(t), step, rtol=_WHOLE, atol=1e-9 * abs(t[-1])):
            raise SignalError(
                f"t is not in steps of {step:g} s, the interval of the system; resample the "
                "input, or simulate system.continuous()"
            )

    def _check_delay(self, interval: float | None) -> None:
        if interval is None:
            return
        count = self.delay / interval
        if abs(count - round(count)) > _WHOLE:
            raise ParameterError(
                f"delay {self.delay:g} s is {count:.6g} intervals of {interval:g} s; a sampled "
                "system needs a whole number"
            )


def _coefficients(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        numbers = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise ParameterError(f"the {name} is not an array of real numbers: {error}") from None
    if numbers.ndim != 1 or numbers.size == 0 or not np.isfinite(numbers).all():
        raise ParameterError(f"the {name} is {values!r}; give finite coefficients, highest first")
    return numbers


def _polynomial(name: str, roots: npt.NDArray[Any]) -> FloatArray:
    coefficients = np.atleast_1d(np.poly(roots))
    if np.iscomplexobj(coefficients) and np.abs(coefficients.imag).max() > 0:
        raise ParameterError(f"{name} are {roots}; give complex ones in conjugate pairs")
    return np.asarray(as_samples(np.real(coefficients), name=name))


def _plain(roots: npt.NDArray[np.complex128]) -> list[complex]:
    return [root.real if root.imag == 0 else root for root in roots.tolist()]

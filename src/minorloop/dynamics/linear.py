"""Linear systems with one input and one output: thin wrappers on scipy.signal."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_samples, check_option, frozen
from minorloop.dynamics import _kernels, conversion
from minorloop.dynamics.propagation import Between, StateSpace, as_times, as_waveform, propagate
from minorloop.errors import ParameterError, SignalError
from minorloop.figures import figure_of

_WHOLE = 1e-6


@dataclass(frozen=True, eq=False)
class Linear:
    """A rational transfer function with dead time, continuous or sampled.

    Parameters
    ----------
    numerator, denominator : array_like
        Coefficients in descending powers of s, or of z for a sampled system; no more of the
        numerator than of the denominator, whose first is not zero. They are stored with the
        first of the denominator 1 and as many of both.
    interval : float, optional
        Time between samples in seconds; None for a continuous system. The input of a sampled
        system is held over each interval.
    delay : float
        Dead time in seconds; a whole number of intervals for a sampled system.

    Raises
    ------
    ParameterError
        If a number is not finite, the system is not causal, or a time is not possible.
    """

    numerator: FloatArray
    denominator: FloatArray
    interval: float | None = None
    delay: float = 0.0

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
            store(self, "interval", _positive("interval", self.interval))
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
        interval: float | None = None,
        delay: float = 0.0,
    ) -> Linear:
        """System with these poles and zeros, in 1/s, or in the z-plane if it is sampled.

        Parameters
        ----------
        poles : sequence of complex
            In 1/s, or in the z-plane.
        zeros : sequence of complex
            In the same plane.
        dc_gain : float
            Output per input at rest.
        interval : float, optional
            Seconds between samples; continuous without it.
        delay : float
            Dead time, in seconds.
        """
        poles, zeros = np.atleast_1d(poles), np.atleast_1d(zeros)
        numerator, denominator = _polynomial("zeros", zeros), _polynomial("poles", poles)
        unit = cls(numerator, denominator, interval, delay)
        return cls(numerator * dc_gain / unit._finite_dc_gain, denominator, interval, delay)

    @classmethod
    def lags(cls, *times: float, dc_gain: float = 1.0, delay: float = 0.0) -> Linear:
        """First-order lags one after the other, by their time constants in seconds.

        Parameters
        ----------
        *times : float
            Time constants, in seconds.
        dc_gain : float
            Output per input at rest.
        delay : float
            Dead time, in seconds.
        """
        each = [-1 / _positive("time constant", time) for time in times]
        return cls.from_poles(each, dc_gain=dc_gain, delay=delay)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Linear):
            return NotImplemented
        return (
            np.array_equal(self.numerator, other.numerator)
            and np.array_equal(self.denominator, other.denominator)
            and (self.interval, self.delay) == (other.interval, other.delay)
        )

    @property
    def order(self) -> int:
        """Number of poles."""
        return int(self.denominator.size - 1)

    @property
    def relative_degree(self) -> int:
        """Poles less zeros."""
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
        """(n,) seconds in which each mode falls to 1/e, slowest first; infinite if it does not."""
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
        """The same system with DC gain 1.

        Raises
        ------
        ParameterError
            If its DC gain is zero or infinite.
        """
        if self._finite_dc_gain == 0:
            raise ParameterError("the DC gain is 0, which no factor makes 1")
        return self._with_dc_gain(1.0)

    def response(self, frequency: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """Complex gain at frequencies in Hz, of the shape given.

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
        self,
        t: npt.ArrayLike,
        u: npt.ArrayLike,
        *,
        before: float = 0.0,
        between: Between = "held",
    ) -> FloatArray:
        """Outputs for a sampled input, exact between the samples.

        Parameters
        ----------
        t : (T,) array_like
            Strictly increasing times in seconds; every interval of a sampled system.
        u : (T,) array_like
            Inputs.
        before : float
            Input under which the system had settled.
        between : {"held", "straight"}
            ``"held"``: u[k] was on since the sample before, and u[0] for as long as u[1], which
            is how an actuator records a hold. ``"straight"``: the input jumps to u[0] at t[0]
            and runs straight from sample to sample; for continuous systems only.

        Returns
        -------
        (T,) array

        Raises
        ------
        SignalError
            If the shapes differ, times do not increase, or do not fit a sampled system.
        ParameterError
            If the system cannot have settled, or ``between`` does not suit it.
        """
        times, inputs = as_waveform(t, u)
        check_option("between", between, ("held", "straight"))
        x = self._settled(as_finite("before", before))
        if self.interval is None:
            return propagate(
                self.state_space,
                x,
                times,
                inputs,
                delay=self.delay,
                before=before,
                between=between,
            )
        if between != "held":
            raise ParameterError(
                "a sampled system holds its input; simulate system.continuous() instead"
            )
        self._check_clock(times)
        return self._filter(inputs, before)

    def step_response(self, t: npt.ArrayLike) -> FloatArray:
        """Outputs at times t (T,) after a unit step at 0 from rest; 0 until then.

        Between the samples of a sampled system the line from one to the next is given.

        Parameters
        ----------
        t : (T,) array_like
            Times, in seconds.

        Raises
        ------
        SignalError
            If the times do not increase.
        """
        times = as_times(t, fewest=1)
        y = np.zeros(times.size)
        after = times > 0
        if after.any():
            y[after] = self._rise(times[after])
        if self.delay == 0:
            y[times == 0] = self.numerator[0]
        return y

    def discretise(self, interval: float) -> Linear:
        """The sampled system with the same outputs for inputs held over each interval.

        Parameters
        ----------
        interval : float
            Seconds between samples.

        Raises
        ------
        ParameterError
            If it is sampled already, or the dead time is no whole number of intervals.
        """
        if self.interval is not None:
            raise ParameterError(f"the system is sampled already, every {self.interval:g} s")
        step = _positive("interval", interval)
        top, bottom = conversion.sampled(self.numerator, self.denominator, step)
        return Linear(top, bottom, step, self.delay)._with_dc_gain(self.dc_gain)

    def continuous(self) -> Linear:
        """The continuous system which, with its input held over each interval, gives this one.

        By the principal logarithm of the transition matrix.

        Raises
        ------
        ParameterError
            If it is continuous already, or has a pole at 0 or on the negative real axis, where
            the principal logarithm does not exist: the mode turns its sign at every sample, and
            no continuous system of the same order does that.
        """
        if self.interval is None:
            raise ParameterError("the system is continuous already")
        top, bottom = conversion.continuous(self.numerator, self.denominator, self.interval)
        return Linear(top, bottom, None, self.delay)._with_dc_gain(self.dc_gain)

    def settled(self, u: float) -> FloatArray:
        """State (n + delayed samples,) of a sampled system that has settled under an input.

        Parameters
        ----------
        u : float
            The input that was held.

        Raises
        ------
        ParameterError
            If the system is continuous, or does not settle.
        """
        value = as_finite("u", u)
        return np.concatenate([self._settled(value), np.full(self.lag, value)])

    def step(self, state: FloatArray, u: float) -> tuple[float, FloatArray]:
        """Output at the end of one interval with the input held, and the state then.

        Nothing is changed in place.

        Parameters
        ----------
        state : (n + delayed samples,) array
            As ``settled`` gives it.
        u : float
            The input.

        Raises
        ------
        ParameterError
            If the system is continuous; discretise it first.
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

    def plot(self) -> Any:
        """Draw step response, gain and phase; gives the matplotlib figure."""
        return figure_of(self)

    @cached_property
    def state_space(self) -> StateSpace:
        """Matrices A, B, C, D in controllable canonical form."""
        return conversion.canonical(self.numerator, self.denominator)

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
        """The same, with the rounding of the DC gain undone, or its factor changed."""
        own = self.dc_gain
        if not np.isfinite([gain, own]).all() or gain == 0 or own == 0:
            return self
        return Linear(self.numerator * (gain / own), self.denominator, self.interval, self.delay)

    def at_rest(self, coefficients: FloatArray) -> float:
        """A polynomial of the system at s = 0 or z = 1.

        Parameters
        ----------
        coefficients : (n,) array
            Of the numerator or the denominator, highest power first.
        """
        return float(coefficients[-1] if self.interval is None else coefficients.sum())

    def _settled(self, u: float) -> FloatArray:
        x = np.zeros(self.order)
        if u != 0 and self.order:
            rest = self.at_rest(self.denominator)
            if rest == 0:
                raise ParameterError(f"the system integrates, and never settles under {u:g}")
            x[-1 if self.interval is None else slice(None)] = u / rest
        return x

    def _rise(self, after: FloatArray) -> FloatArray:
        """The step response at times after 0."""
        if self.interval is None:
            times = np.concatenate([[0.0], after])
            return self.simulate(times, np.ones(times.size), between="straight")[1:]
        count = int(np.ceil(after[-1] / self.interval)) + 1
        grid = self.interval * np.arange(count + 1)
        begin = self.numerator[0] if self.delay == 0 else 0.0
        rise = np.append(begin, self._filter(np.ones(count), 0.0))
        return np.asarray(np.interp(after, grid, rise))

    def _filter(self, u: FloatArray, before: float) -> FloatArray:
        """Outputs of a sampled system at the ends of the intervals over which u is held."""
        a, b, c, d = self.state_space
        felt = np.concatenate([np.full(self.lag, before), u])[: u.size]
        states = np.empty((u.size, self.order))
        first = np.zeros(u.size, dtype=np.int64)
        x = self._settled(before)
        _kernels.march(a[None], np.zeros((1, b.size)), b[None], first, felt, felt, x, states)
        return np.asarray(states @ c + d * felt)

    def _check_clock(self, t: FloatArray) -> None:
        step = self.interval or 0.0
        if not np.allclose(np.diff(t), step, rtol=_WHOLE, atol=1e-9 * abs(t[-1])):
            raise SignalError(
                f"t does not go in steps of {step:g} s as the system does; resample the input, "
                "or simulate system.continuous()"
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


def _positive(name: str, value: float) -> float:
    number = as_finite(name, value)
    if number <= 0:
        raise ParameterError(f"{name} is {value:g} s; give a positive number of seconds")
    return number


def _polynomial(name: str, roots: npt.NDArray[Any]) -> FloatArray:
    coefficients = np.atleast_1d(np.poly(roots))
    if np.iscomplexobj(coefficients) and np.abs(coefficients.imag).max() > 0:
        raise ParameterError(f"complex {name} come in conjugate pairs; {roots} do not")
    return np.asarray(as_samples(np.real(coefficients), name=name))


def _plain(roots: npt.NDArray[np.complex128]) -> list[complex]:
    return [root.real if root.imag == 0 else root for root in roots.tolist()]

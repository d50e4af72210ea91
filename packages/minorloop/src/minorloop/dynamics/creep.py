"""Creep: slow first-order lags, with which an output changes long after its input has stopped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_samples, as_times, as_waveform, frozen
from minorloop.dynamics import _kernels
from minorloop.errors import NotInvertibleError, ParameterError, SignalError

PER_DECADE = 2
"""Time constants per decade. Responses of lags that are closer than a factor of
3 are almost collinear, so that a record cannot separate more."""


@dataclass(frozen=True, eq=False)
class Creep:
    """A prompt part and a sum of slow lags: y = offset + (gain + sum c_i / (tau_i s + 1)) x.

    Raises a `ParameterError` if a time is not positive, a strength is negative, or the shapes
    differ.
    """

    times: FloatArray
    """Shape (n,). Time constants tau_i in seconds."""
    strengths: FloatArray
    """Shape (n,). Strengths c_i >= 0, in the unit of the output over that of x."""
    gain: float = 1.0
    """Gain of the prompt part."""
    offset: float = 0.0
    """Offset of the output."""

    def __post_init__(self) -> None:
        store = object.__setattr__
        for name in ("times", "strengths"):
            store(self, name, frozen(np.atleast_1d(getattr(self, name))))
        if self.times.ndim != 1 or self.times.shape != self.strengths.shape:
            raise ParameterError(
                f"times have shape {self.times.shape} and strengths {self.strengths.shape}; "
                "give one strength for each time"
            )
        if not (np.isfinite(self.times) & (self.times > 0)).all():
            raise ParameterError(f"creep times are {self.times}; give positive seconds")
        if not (np.isfinite(self.strengths) & (self.strengths >= 0)).all():
            raise ParameterError(f"creep strengths are {self.strengths}; give numbers >= 0")
        for name in ("gain", "offset"):
            store(self, name, as_finite(name, getattr(self, name)))

    @property
    def dc_gain(self) -> float:
        """Settled change of the output per change of x."""
        return self.gain + float(self.strengths.sum())

    def simulate(
        self, t: npt.ArrayLike, x: npt.ArrayLike, *, before: float | None = None
    ) -> FloatArray:
        """Return the outputs for a signal that is held between samples.

        x[k] is the value since the previous sample, and x[0] lasts as long as x[1]. Parameters and
        errors are those of `TimedModel.simulate`.
        """
        times, values = as_waveform(t, x, name="x")
        held = float(values[0]) if before is None else as_finite("before", before)
        lagged = _lagging(times, values, held, self.times)
        return np.asarray(self.offset + self.gain * values + lagged @ self.strengths)

    def settled(self, x: float) -> FloatArray:
        """Return the state (n,) after a signal that was constant for a long time.

        ``x``: value of the signal.
        """
        return np.full(self.times.size, as_finite("x", x))

    def step(self, state: FloatArray, x: float, interval: float) -> tuple[float, FloatArray]:
        """Return output and state after an interval; `settled` gives the first state."""
        after = x + np.exp(-interval / self.times) * (state - x)
        return self.offset + self.gain * x + float(self.strengths @ after), after

    def normalised(self) -> Creep:
        """Return the same creep with DC gain 1 and without offset.

        Raises a `ParameterError` if its DC gain is not positive.
        """
        if self.dc_gain <= 0:
            raise ParameterError(f"the DC gain is {self.dc_gain:g} and cannot be made 1")
        return Creep(self.times, self.strengths / self.dc_gain, self.gain / self.dc_gain)

    def compensate(self, t: npt.ArrayLike, targets: npt.ArrayLike, *, before: float) -> FloatArray:
        """Return the signal (T,) with which the output meets its target at every sample.

        At each sample the remaining creep of the past is subtracted from the target. The rest is
        divided by the gain within one interval. Times, ``before`` and errors are as of `simulate`.

        ``targets`` (T,): target outputs. Raises a `NotInvertibleError` without a prompt part.
        """
        times, goals = as_waveform(t, targets, name="targets")
        if self.gain <= 0:
            raise NotInvertibleError(
                f"the prompt gain is {self.gain:g}; without a positive prompt gain the "
                "compensating signal grows from sample to sample, so identify with a prompt part"
            )
        x = np.empty(times.size)
        crept = np.full(self.times.size, as_finite("before", before))
        decay = _decay(times, self.times)
        _kernels.compensate(decay, self.strengths, self.gain, goals - self.offset, crept, x)
        return x

    def __str__(self) -> str:
        rows = [("prompt gain", f"{self.gain:.6g}"), ("offset", f"{self.offset:.6g}")]
        rows += [
            (f"creep, {time:.3g} s", f"{strength:.4g}")
            for time, strength in zip(self.times, self.strengths, strict=True)
            if strength > 0
        ]
        return "\n".join(f"{name:<24} {value}" for name, value in rows)


def fit_creep(
    t: npt.ArrayLike,
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    *,
    shortest: float | None = None,
    longest: float | None = None,
    times: npt.ArrayLike | None = None,
) -> Creep:
    """Fit creep to a record of holds, by least squares with non-negative strengths.

    Raises a `SignalError` if the shapes differ, or x never changes; a `ParameterError` if the times
    are not in order.

    Parameters
    ----------
    t : (T,) array_like
        Strictly increasing times in seconds.
    x : (T,) array_like
        Output without creep, up to gain and offset, such as that of an operator; held between
        samples. The output had settled at the first sample.
    y : (T,) array_like
        Measured outputs; NaN if not measured.
    shortest, longest : float, optional
        Limits of the time constants in seconds; by default twice the median interval and the
        longest hold.
    times : (n,) array_like, optional
        Given time constants, in seconds.

    References
    ----------
    Lawson and Hanson, Solving Least Squares Problems, 1974, chapter 23: non-negative least
    squares. The unconstrained gain and offset are projected out first.
    """
    from scipy.optimize import nnls

    clock, values = as_waveform(t, x, name="x")
    outputs = as_samples(y, name="y", gaps=True)
    if outputs.shape != clock.shape:
        raise SignalError(
            f"t has shape {clock.shape} and y {outputs.shape}; give one output for each time"
        )
    if np.ptp(values) == 0:
        raise SignalError(
            f"x is {values[0]:g} throughout; record at least one step and the hold after"
        )
    taus = _grid(clock, values, shortest, longest) if times is None else frozen(times)
    slow = _lagging(clock, values, float(values[0]), taus)
    free = np.column_stack([values, np.ones(values.size)])
    known = np.isfinite(outputs)
    slow, free, measured = slow[known], free[known], outputs[known]
    if measured.size <= free.shape[1]:
        raise SignalError(f"{measured.size} outputs are finite; give at least {free.shape[1] + 1}")
    basis = np.linalg.qr(free)[0] if np.ptp(free[:, 0]) else free[:, 1:] / np.sqrt(len(free))
    strengths, _ = nnls(_projected_out(slow, basis), _projected_out(measured, basis))
    rest = measured - slow @ strengths
    gain, offset = np.linalg.lstsq(free, rest, rcond=None)[0]
    return Creep(taus, strengths, float(gain), float(offset))


def _projected_out(columns: FloatArray, basis: FloatArray) -> FloatArray:
    return np.asarray(columns - basis @ (basis.T @ columns))


def _grid(
    t: FloatArray, x: FloatArray, shortest: float | None, longest: float | None
) -> FloatArray:
    begin = (
        2 * float(np.median(np.diff(t))) if shortest is None else as_finite("shortest", shortest)
    )
    changes = np.concatenate([[0], np.flatnonzero(np.diff(x)) + 1, [t.size - 1]])
    end = float(np.diff(t[changes]).max()) if longest is None else as_finite("longest", longest)
    if not 0 < begin <= end:
        raise ParameterError(
            f"creep times from {begin:g} to {end:g} s; give 0 < shortest <= longest, or a record "
            "with longer holds"
        )
    count = np.ceil(PER_DECADE * np.log10(end / begin))
    return np.geomspace(begin, end, int(count) + 1)


def _decay(t: FloatArray, taus: FloatArray) -> FloatArray:
    """(T, n) remaining share of each lag after one interval."""
    steps = np.diff(as_times(t), prepend=2 * t[0] - t[1])
    return np.exp(-steps[:, None] / taus)


def _lagging(t: FloatArray, x: FloatArray, before: float, taus: FloatArray) -> FloatArray:
    """(T, n) outputs of the lags for a signal."""
    lagged = np.empty((t.size, taus.size))
    _kernels.lag(_decay(t, taus), x, before, lagged)
    return lagged

"""Inputs on a finer grid than the samples, and outputs behind the filters of a converter."""

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_whole, check_option
from minorloop.errors import ParameterError, SignalError

Interpolation: TypeAlias = Literal["held", "straight", "band"]
"""Input between samples: each sample is held over the previous interval, the input is linear from
sample to sample, or it has no content above half the sampling rate."""
Stage: TypeAlias = "tuple[int, npt.ArrayLike]"
"""One stage of a decimation: the factor, and the taps of its symmetric filter, an odd number."""

_BETA = 14.0
"""Shape of the window of Kaiser. With its width, errors are below 1e-7 of the amplitude up to 0.8
of half the sampling rate, except for the first and last samples."""


def even_interval(t: FloatArray) -> float:
    """Return the interval of evenly spaced times.

    Raises a `SignalError` if an interval differs from the mean by more than 1 %.
    """
    steps = np.diff(t)
    mean = float(t[-1] - t[0]) / (t.size - 1)
    if np.abs(steps - mean).max() > 0.01 * mean:
        index = int(np.argmax(np.abs(steps - mean)))
        raise SignalError(
            f"the step of t after index {index} is {steps[index]:g} s, the mean {mean:g} s; give "
            "evenly spaced times, or interpolate the record first"
        )
    return mean


def refined(
    u: FloatArray, factor: int, between: Interpolation, *, periodic: bool = False
) -> FloatArray:
    """Return a signal at ``factor`` times the rate.

    ``u`` (T,): samples; ``factor``: values for each interval; ``between`` {"held", "straight",
    "band"}: as `Interpolation`. A held signal is shown at the end of each of its pieces.
    ``periodic``: whether the first sample follows the last one.

    Returns
    -------
    ((T - 1) factor + 1,) array, or (T factor + 1,) if periodic
        The first value is the first sample; the last value is the last sample, or the first again.
    """
    check_option("between", between, ("held", "straight", "band"))
    whole = np.append(u, u[0]) if periodic else u
    if between == "held":
        return np.append(whole[0], np.repeat(whole[1:], factor))
    if between == "straight":
        grid = np.arange((whole.size - 1) * factor + 1) / factor
        return np.interp(grid, np.arange(whole.size), whole)
    if periodic:
        spectrum = np.fft.rfft(u)
        if u.size % 2 == 0:
            spectrum[-1] /= 2  # half of it belongs to the negative frequency
        fine = np.fft.irfft(spectrum, u.size * factor) * factor
        return np.append(fine, fine[0])
    return _windowed_sinc(whole, factor)


def pulses(u: FloatArray, factor: int, between: Interpolation, *, periodic: bool) -> FloatArray:
    """Return beginning, middle and end of a signal in each of ``factor`` steps per interval (K, 3).

    ``u`` (T,): samples; ``factor``: steps for each interval; ``between`` and ``periodic``: as for
    `refined`.
    """
    if between == "held":
        ends = refined(u, factor, between, periodic=periodic)[1:]
        return np.ascontiguousarray(np.column_stack([ends, ends, ends]))
    fine = refined(u, 2 * factor, between, periodic=periodic)
    return np.ascontiguousarray(np.column_stack([fine[:-2:2], fine[1:-1:2], fine[2::2]]))


def checked_stages(stages: Sequence[Stage], substeps: int) -> list[tuple[int, FloatArray]]:
    """Return the stages of a decimation as arrays.

    Raises a `ParameterError` if a filter is not symmetric with an odd number of taps and gain 1, or
    the product of the factors is not the number of steps in an interval.
    """
    found, product = [], 1
    for factor, taps in stages:
        coefficients = np.asarray(taps, dtype=np.float64)
        odd = coefficients.ndim == 1 and coefficients.size % 2 == 1
        if not odd or not np.allclose(coefficients, coefficients[::-1], atol=1e-9):
            raise ParameterError(
                f"a filter of {coefficients.size} taps is not symmetric about a middle one; give "
                "an odd number of symmetric taps"
            )
        found.append((as_whole("factor", factor, 1), coefficients))
        product *= found[-1][0]
    if found and product != substeps:
        raise ParameterError(
            f"the stages reduce the rate by {product}, but there are {substeps} steps in an "
            f"interval; give substeps={product}"
        )
    return found


def sampled(
    y: FloatArray, stages: Sequence[tuple[int, FloatArray]], substeps: int, *, periodic: bool
) -> FloatArray:
    """Return the samples of a motion behind the stages of a decimation, without their delay.

    ``y`` (K + 1,) or (K + 1, P): the motion at the beginning, and after each of K steps;
    ``stages``: from `checked_stages`; ``substeps``: steps in an interval; ``periodic``: whether the
    last value equals the first; otherwise the signal is continued by its mirror image through the
    first and the last point.
    """
    if periodic:
        y = y[:-1]
    if not stages:
        return np.ascontiguousarray(y[::substeps])
    for factor, taps in stages:
        n = taps.size // 2
        if periodic:
            around = np.concatenate([y[-n:], y, y[:n]])
        else:
            around = np.concatenate([2 * y[0] - y[n:0:-1], y, 2 * y[-1] - y[-2 : -n - 2 : -1]])
        windows = np.lib.stride_tricks.sliding_window_view(around, taps.size, axis=0)
        y = np.ascontiguousarray(windows[::factor]) @ taps
    return y


def _windowed_sinc(u: FloatArray, factor: int) -> FloatArray:
    """Return a signal at a higher rate, continued by its mirror image through its end points."""
    n = min(32, u.size - 1)  # an interpolated value depends on this number of samples on each side
    around = np.concatenate([2 * u[0] - u[n:0:-1], u, 2 * u[-1] - u[-2 : -n - 2 : -1]])
    fine = np.empty((u.size - 1, factor))
    fine[:, 0] = u[:-1]
    for k in range(1, factor):
        places = np.arange(-n + 1, n + 1) - k / factor
        window = np.i0(_BETA * np.sqrt(1 - (places / n) ** 2)) / np.i0(_BETA)
        taps = np.sinc(places) * window
        fine[:, k] = np.convolve(around, taps[::-1], mode="valid")[1 : u.size]
    return np.append(fine.ravel(), u[-1])

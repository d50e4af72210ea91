"""The records of the Bouc-Wen benchmark, generated anew from its description.

An oscillator with a hysteretic force is integrated at 15 kHz by the method of Newmark with the
constants (1/2, 1/4). Its displacement is decimated to 750 Hz in stages of 2, 2 and 5, by filters
of order 30. The forces have no content above 150 Hz, so that their samples at 750 Hz determine
them. Estimators do not import this module.
"""

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.lab.records import Record
from papers import _bouc_wen_kernels as _kernels

RATE = 750.0
"""Samples a second of the records."""
_STAGES, _TAPS = (2, 2, 5), 31
"""Factors of the decimation, in order, and taps of each filter: order 30."""
PERIOD = 8192
"""Samples of one period of a multisine."""
NOISE = 8e-6
"""Standard deviation of the noise of the training record in m, white up to 375 Hz."""
SWEEP = (18.0, 52.0, 204.0, 40.0)
"""First and last frequency of the sweep in Hz, its duration in s and its amplitude in N."""
PARAMETERS = {
    "mass": 2.0,  # kg
    "damping": 10.0,  # N s/m
    "stiffness": 5e4,  # N/m
    "alpha": 5e4,  # N/m
    "beta": 1e3,  # 1/m
    "gamma": 0.8,
    "delta": -1.1,
    "exponent": 1.0,
}


def training_record(seed: int) -> Record:
    """Return five periods of the settled response to a multisine by seed, with noise: N and m."""
    rng = np.random.default_rng([seed, 0])
    u, y = _settled(rng, 5)
    return Record(u, y + rng.normal(0, NOISE, y.size), _times(u))


def multisine_test(seed: int) -> Record:
    """Return one period of the settled response to another multisine by seed, without noise."""
    u, y = _settled(np.random.default_rng([seed, 1]), 1)
    return Record(u, y, _times(u))


def sweep_test() -> Record:
    """Return the response to the sweep from rest, without noise."""
    first, last, duration, amplitude = SWEEP
    factor = int(np.prod(_STAGES))
    t = np.arange(round(duration * RATE) * factor + 1) / (RATE * factor)
    force = amplitude * np.sin(2 * np.pi * (first * t + (last - first) / duration * t**2 / 2))
    u = force[::factor].copy()
    return Record(u, decimate(_integrated(force)), _times(u))


def filters() -> list[tuple[int, FloatArray]]:
    """Return factor and taps of each stage of the decimation.

    The filters are those of a Hamming window, with half the gain at the new band edge, as in the
    description of the benchmark.
    """
    from scipy.signal import firwin

    return [(factor, firwin(_TAPS, 1 / factor, window="hamming")) for factor in _STAGES]


def decimate(y: FloatArray) -> FloatArray:
    """Return a signal at 15 kHz behind the filters, without their delay.

    The signal is continued by its mirror image through its first and its last point.
    """
    half = _TAPS // 2
    for factor, taps in filters():
        around = np.concatenate([2 * y[0] - y[half:0:-1], y, 2 * y[-1] - y[-2 : -half - 2 : -1]])
        y = np.convolve(around, taps, mode="valid")[::factor]
    return y


def _settled(rng: np.random.Generator, periods: int) -> tuple[FloatArray, FloatArray]:
    """Return forces and displacements over whole periods, after one in which the motion settles.

    One more is simulated at the end, so that the filters have periods on both sides. Every line
    from 5 to 150 Hz is excited, to a root-mean-square of 50 N.
    """
    frequencies = np.arange(PERIOD // 2 + 1) * RATE / PERIOD
    excited = (frequencies >= 5.0) & (frequencies <= 150.0)
    spectrum = np.zeros(frequencies.size, dtype=complex)
    spectrum[excited] = np.exp(2j * np.pi * rng.random(int(excited.sum())))
    factor = int(np.prod(_STAGES))
    coarse = np.fft.irfft(spectrum, PERIOD)
    scale = 50.0 / float(np.std(coarse))
    fine = scale * factor * np.fft.irfft(spectrum, PERIOD * factor)
    y = decimate(_integrated(np.tile(fine, periods + 2)))
    return np.tile(scale * coarse, periods), y[PERIOD : (periods + 1) * PERIOD]


def _integrated(force: FloatArray) -> FloatArray:
    step = 1 / (RATE * int(np.prod(_STAGES)))
    return np.asarray(_kernels.newmark(force, step, *PARAMETERS.values()))


def _times(u: FloatArray) -> FloatArray:
    return np.arange(u.size) / RATE

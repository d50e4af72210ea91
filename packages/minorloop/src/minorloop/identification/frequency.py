"""Frequency responses of plants with hysteresis, by their fundamental component.

The response of a plant with hysteresis to a sine has harmonics, and its gain depends on the
amplitude. If the plant is a rate-independent operator followed by linear dynamics, the gain from
the output of the operator to the output of the plant does not depend on the amplitude.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError, SignalError
from minorloop.figures import Drawn
from minorloop.identification.rational import ComplexArray, RationalFit, fit_response
from minorloop.lab.records import Quantity
from minorloop.operators.operator import Operator
from minorloop.report import Picture, Report, Table

_SAMPLES = 4096
"""Samples of a period of a describing function; its error decreases with their square."""
_SHOWN = (
    *(("Hz", 9, ".4g"), ("amplitude", 9, ".4g"), ("gain, dB", 9, ".3f"), ("phase, deg", 10, ".2f")),
    *(("THD", 7, ".2%"), ("after, dB", 10, ".3f"), ("phase, deg", 10, ".2f")),
)
"""Headers of tables, their widths, and formats of the columns."""
_NOTHING = 1e-9
"""Share of a signal below which its fundamental is rounding."""


@dataclass(frozen=True, eq=False)
class SinePeriods:
    """The measured whole periods of a sine."""

    frequency: float
    amplitude: float
    offset: float
    """``frequency``, ``amplitude`` and ``offset``: frequency in Hz, amplitude and mean of the input
    in its unit."""
    periods: int
    """Number of periods."""
    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: shape (T,). Inputs and outputs, evenly sampled over the periods."""
    w: FloatArray | None = None
    """Shape (T,). Outputs of the operator; None without an operator."""
    held: bool = False
    """Whether inputs are held until their outputs are read; otherwise they change linearly."""

    @property
    def correction(self) -> complex:
        """Fundamental of a held input over that of its samples at the ends of the holds."""
        if not self.held:
            return 1.0
        turn = 2j * np.pi * self.periods / self.u.size
        return complex((np.exp(turn) - 1) / turn)

    def gains(self) -> tuple[complex, complex]:
        """Return the gains of the fundamental before and after the operator; NaN without one.

        Raises a `SignalError` if input, operator or output does not oscillate.
        """
        if np.isnan(self.y).any():
            raise SignalError(
                f"the sine of {self.frequency:g} Hz and amplitude {self.amplitude:g} has gaps in "
                "its output; measure it again"
            )
        y = fundamental(self.y, self.periods)
        if abs(y) <= _NOTHING * np.abs(self.y).max(initial=0.0):
            raise SignalError(
                f"the output does not oscillate at {self.frequency:g} Hz and amplitude "
                f"{self.amplitude:g}; check the sensor, or increase the amplitude"
            )
        before, after = (
            np.nan if x is None else y / (fundamental_of_sine(x, self.periods) * self.correction)
            for x in (self.u, self.w)
        )
        return before, after

    def unsettled(self) -> float:
        """Return the relative change of the fundamental between the last two periods."""
        each = self.y.size // self.periods
        last, before = (
            fundamental(self.y[self.y.size - k * each : self.y.size - (k - 1) * each], 1)
            for k in (1, 2)
        )
        return abs(last - before) / abs(last) if last else np.inf


@dataclass(frozen=True)
class GainSpread:
    """Largest difference between the gains of several amplitudes, in dB.

    ``before``: from input to output. ``after``: from the operator's output to that of the plant.
    """

    before: float
    after: float

    @property
    def ratio(self) -> float:
        """``after`` over ``before``: the remaining dependence on amplitude."""
        return self.after / self.before if self.before else np.inf

    def __str__(self) -> str:
        return (
            f"gains differ by {self.before:.3g} dB from input to output, and by {self.after:.3g} "
            f"dB from operator to output: {self.ratio:.2f} of it"
        )


@dataclass(frozen=True, eq=False)
class FrequencyResponse(Drawn):
    """Gains of the fundamental component at several amplitudes."""

    frequencies: FloatArray
    """Shape (F,). Frequencies in Hz."""
    amplitudes: FloatArray
    """Shape (A,). Amplitudes of the input, in its unit."""
    bias: float
    """Mean of the input."""
    plant: ComplexArray
    """(A, F) complex array. Gains from input to output."""
    after: ComplexArray | None
    """(A, F) complex array or None. Gains from the output of the operator to that of the plant;
    None without an operator."""
    distortion: FloatArray
    """Shape (A, F). Total harmonic distortion of the output: harmonics 2 to 10 over the
    fundamental."""
    unsettled: FloatArray
    """Shape (A, F). Relative change of the fundamental between the last two periods."""
    names: tuple[str, str] = ("input", "output")
    """Names and units of input and output, such as ``voltage [V]``."""
    notes: tuple[str, ...] = ()
    """Notes on sines that were left out or have faults, one sentence each."""

    def gain_spread(self, low: float = 0.0, high: float = np.inf) -> GainSpread:
        """Largest difference between gains at frequencies from ``low`` to ``high``, in Hz.

        Raises a `ParameterError` if no frequency lies between these, or there was no operator.
        """
        inside = self._between(low, high)
        return GainSpread(
            float(np.ptp(decibels(self.plant[:, inside]), axis=0).max()),
            float(np.ptp(decibels(self._after[:, inside]), axis=0).max()),
        )

    def phase_spread(self, low: float = 0.0, high: float = np.inf) -> tuple[float, float]:
        """Largest differences between phases, before and after the operator, in degrees.

        Raises a `ParameterError` if no frequency lies between these, or there was no operator.
        """
        inside = self._between(low, high)
        before, after = (
            np.degrees(np.angle(gains[:, inside] / gains[:1, inside]))
            for gains in (self.plant, self._after)
        )
        return float(np.ptp(before, axis=0).max()), float(np.ptp(after, axis=0).max())

    def fit(self, **options: Any) -> RationalFit:
        """Fit one transfer function from operator to output for all amplitudes.

        Raises a `ParameterError` if there was no operator.

        ``**options``: ``order`` and ``zeros`` of `fit_response`.
        """
        return fit_response(self.frequencies, self._after, **options)

    def to_dict(self) -> dict[str, Any]:
        """Return gains, phases, their spreads and advice by name."""
        gains = self.gain_spread() if self._several else None
        before, after = self.phase_spread() if self._several else (None, None)
        return {
            "input": self.names[0],
            "output": self.names[1],
            "frequencies_hz": self.frequencies,
            "amplitudes": self.amplitudes,
            "offset": self.bias,
            "gain_db": decibels(self.plant),
            "phase_deg": degrees(self.plant),
            "after_gain_db": None if self.after is None else decibels(self.after),
            "after_phase_deg": None if self.after is None else degrees(self.after),
            "distortion": self.distortion,
            "unsettled": self.unsettled,
            "gain_spread_before_db": gains and gains.before,
            "gain_spread_after_db": gains and gains.after,
            "phase_spread_before_deg": before,
            "phase_spread_after_deg": after,
            "advice": list(self.advice),
        }

    def report(self, source: str) -> Report:
        """Return a report: a Bode plot and a table.

        ``source``: name of the store or log.
        """
        spread = f" {self.gain_spread()}." if self._several else ""
        report = Report(
            f"Frequency response of {self.names[1]} to {self.names[0]}",
            f"{source}: gain and phase of the fundamental component at {self.frequencies.size} "
            f"frequencies and {self.amplitudes.size} amplitudes.{spread}".replace(". g", ". G"),
        )
        caption = "Gain and phase from input to output"
        if self.after is not None:
            caption += ", and from the output of the model to that of the actuator"
        report.add("Bode plot", pictures=[Picture(self.plot(), f"{caption}.")], notes=self.advice)
        rows = [[part.strip() for part in row] for row in self._rows]
        report.add("Gains", table=Table([part.strip() for part in self._head], rows))
        return report

    @property
    def advice(self) -> tuple[str, ...]:
        """Sentences about weaknesses and remedies; empty if there are none."""
        worst = float(self.unsettled.max())
        # Relative change of the fundamental between periods above which it is not settled
        if worst <= 0.01:
            return self.notes
        row, column = np.unravel_index(int(np.argmax(self.unsettled)), self.unsettled.shape)
        return (
            *self.notes,
            f"the fundamental still changes by {worst:.1%} per period at "
            f"{self.frequencies[column]:g} Hz and amplitude {self.amplitudes[row]:g}; increase the "
            "settling time",
        )

    def columns(self) -> dict[str, FloatArray]:
        """Return the columns of a table, with a row for each frequency and amplitude."""
        found = {
            "frequency [Hz]": np.repeat(self.frequencies, self.amplitudes.size),
            str(Quantity("amplitude", Quantity.parse(self.names[0]).unit)): np.tile(
                self.amplitudes, self.frequencies.size
            ),
            "gain [dB]": decibels(self.plant).T.ravel(),
            "phase [deg]": degrees(self.plant).T.ravel(),
            "distortion": self.distortion.T.ravel(),
        }
        if self.after is not None:
            found["gain after operator [dB]"] = decibels(self.after).T.ravel()
            found["phase after operator [deg]"] = degrees(self.after).T.ravel()
        return found

    @property
    def _several(self) -> bool:
        """Whether gains of several amplitudes behind the operator can be compared."""
        return self.after is not None and self.amplitudes.size > 1

    @property
    def _head(self) -> list[str]:
        return [f"{name:>{width}}" for name, width, _ in _SHOWN[: len(self.columns())]]

    @property
    def _rows(self) -> list[list[str]]:
        columns = list(zip(_SHOWN, self.columns().values(), strict=False))
        texts = [[f"{x:>{width}{form}}" for x in values] for (_, width, form), values in columns]
        return [list(row) for row in zip(*texts, strict=True)]

    def __str__(self) -> str:
        lines = [" ".join(row) for row in (self._head, *self._rows)]
        if self._several:
            lines.append(str(self.gain_spread()))
        return "\n".join(lines + [f"advice: {text}" for text in self.advice])

    @property
    def _after(self) -> ComplexArray:
        if self.after is None:
            raise ParameterError("there was no operator; pass one to frequency_response")
        return self.after

    def _between(self, low: float, high: float) -> npt.NDArray[np.bool_]:
        inside = (self.frequencies >= low) & (self.frequencies <= high)
        if not inside.any():
            raise ParameterError(
                f"no frequency lies from {low:g} to {high:g} Hz; give a range within "
                f"{self.frequencies.min():g} to {self.frequencies.max():g} Hz"
            )
        return np.asarray(inside)


def response_of(
    sines: Sequence[Sequence[SinePeriods]],
    frequencies: npt.ArrayLike,
    amplitudes: npt.ArrayLike,
    bias: float,
    notes: Sequence[str] = (),
) -> FrequencyResponse:
    """Return the gains of sines; `FrequencyResponse` has the other parameters.

    Raises a `SignalError` if the input, operator or output of a sine does not oscillate.

    ``sines`` (A, F): one sine for each amplitude and frequency.
    """
    gains = np.array([[sine.gains() for sine in row] for row in sines])
    return FrequencyResponse(
        np.asarray(frequencies),
        np.asarray(amplitudes),
        float(bias),
        gains[:, :, 0],
        gains[:, :, 1] if all(sine.w is not None for row in sines for sine in row) else None,
        np.array([[_harmonic_distortion(sine.y, sine.periods) for sine in row] for row in sines]),
        np.array([[sine.unsettled() for sine in row] for row in sines]),
        notes=tuple(notes),
    )


def describing_function(model: Operator, amplitude: float) -> complex:
    """Gain of the fundamental component of an operator for a periodic sine.

    ``model``: any rate-independent operator; ``amplitude``: amplitude of the input, in its unit;
    the mean of the input is 0. Raises a `ParameterError` if the amplitude is not positive.

    References
    ----------
    Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, section 2.2.
    """
    if as_finite("amplitude", amplitude) <= 0:
        raise ParameterError(f"amplitude is {amplitude:g}; give a positive number")
    phase = 2 * np.pi * np.arange(1, 2 * _SAMPLES + 1) / _SAMPLES
    u = amplitude * np.sin(phase)
    w = model.simulate(u)[-_SAMPLES:]
    return complex(fundamental(w, 1) / fundamental(u[-_SAMPLES:], 1))


def fundamental(x: FloatArray, periods: int, harmonic: int = 1) -> complex:
    """Complex amplitude of a harmonic of a signal (T,) of whole periods."""
    phase = 2 * np.pi * harmonic * periods * np.arange(1, x.size + 1) / x.size
    return complex(2 / x.size * np.sum(x * np.exp(-1j * phase)))


def _harmonic_distortion(x: FloatArray, periods: int) -> float:
    """Root of the sum of squares of harmonics 2 to 10, over the fundamental."""
    # Highest harmonic of the distortion
    parts = [abs(fundamental(x, periods, k)) for k in range(1, 11)]
    return float(np.linalg.norm(parts[1:]) / parts[0]) if parts[0] else np.inf


def decibels(gain: ComplexArray) -> FloatArray:
    """Gain in decibels: 20 log10 of the modulus."""
    return np.asarray(20 * np.log10(np.abs(gain)))


def degrees(gain: ComplexArray) -> FloatArray:
    """Phase in degrees, along the last axis without jumps."""
    return np.asarray(np.degrees(np.unwrap(np.angle(gain))))


def fundamental_of_sine(x: FloatArray, periods: int) -> complex:
    """Fundamental of a signal (T,) of whole periods that must oscillate.

    Raises a `SignalError` if it does not.
    """
    component = fundamental(x, periods)
    if abs(component) <= _NOTHING * np.abs(x).max(initial=0.0):
        raise SignalError(
            "the input or the operator does not oscillate; increase the amplitude beyond the "
            "deadzone"
        )
    return component

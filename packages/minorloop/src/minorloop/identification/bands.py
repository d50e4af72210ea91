"""Predicted outputs with their bands."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError
from minorloop.figures import Drawn

BAND = 0.9
"""Probability of the bands that reports and figures show."""
PER_DEVIATION = 1.6449
"""Half of such a band over the standard deviation."""
_SHOWN = 12
"""Most outputs to print, by trial."""


@dataclass(frozen=True, eq=False)
class Prediction(Drawn):
    """Predicted outputs with their standard deviations."""

    u: FloatArray
    y: FloatArray
    """Shape (T,). Inputs and predicted outputs."""
    sd: FloatArray
    """Shape (T,). Standard deviation of a reading: uncertainty of the weights, discrepancy of any
    Preisach model, and sensor noise. Where the record has groups: of a reading of another group."""
    probability: float
    """Probability that a reading lies within its band."""
    noise: float = 0.0
    """The part of ``sd`` that is sensor noise, given or learnt. With more than about a hundred
    samples the noise is not distinguished from the discrepancy, and is 0 unless it is given."""
    beyond: float = 0.0
    """Share of the outputs that are farther from the record than its parts are from one another, by
    closed travel of the input or in the memory plane."""

    def without_noise(self) -> Prediction:
        """Return the prediction of the true outputs: their bands do not contain the noise."""
        return replace(self, sd=np.sqrt(np.maximum(self.sd**2 - self.noise**2, 0.0)), noise=0.0)

    @property
    def half_width(self) -> FloatArray:
        """(T,) half the width of the bands."""
        from scipy.special import ndtri  # scipy.stats takes a second to import

        return np.asarray(ndtri((1 + self.probability) / 2) * self.sd)

    @property
    def lower(self) -> FloatArray:
        """(T,) lower ends of the bands."""
        return self.y - self.half_width

    @property
    def upper(self) -> FloatArray:
        """(T,) upper ends of the bands."""
        return self.y + self.half_width

    def covers(self, y: FloatArray) -> float:
        """Share of outputs (T,) inside their bands; NaN is ignored.

        ``y`` (T,): outputs that were measured.
        """
        known = np.isfinite(y)
        inside = (y >= self.lower) & (y <= self.upper)
        return float(np.mean(inside[known])) if known.any() else float("nan")

    def __str__(self) -> str:
        lines = [f"{'input':>14} {'output':>14} {'from':>14} {'to':>14}"]
        lower, upper = self.lower, self.upper
        for row in range(min(self.u.size, _SHOWN)):
            lines.append(
                f"{self.u[row]:14.6g} {self.y[row]:14.6g} {lower[row]:14.6g} {upper[row]:14.6g}"
            )
        if self.u.size > _SHOWN:
            lines.append(f"... {self.u.size - _SHOWN} more")
        if not self.u.size:
            return f"no outputs, bands of {self.probability:.0%}"
        mean = float(np.mean(self.sd))
        lines.append(f"bands of {self.probability:.0%}, standard deviation {mean:.3g} on average")
        if self.beyond:
            lines.append(
                f"{self.beyond:.0%} of these inputs are where the record does not show the error "
                "of the model: their bands are assumed, not measured"
            )
        return "\n".join(lines)


def as_probability(bands: float) -> float:
    """Return a number that is a probability between 0 and 1.

    Raises a `ParameterError` if it is not.
    """
    number = as_finite("bands", bands)
    if not 0 < number < 1:
        raise ParameterError(f"bands is {bands}; give a probability between 0 and 1, such as 0.9")
    return number

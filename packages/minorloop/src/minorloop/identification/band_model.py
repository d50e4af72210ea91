"""Uncertainty of a model, which gives its bands: the part of a fit that a model file keeps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop._modelschema import BandsPart, ErrorPart, reason, square
from minorloop.arrays import BoolArray, FloatArray, IntArray, as_levels, frozen
from minorloop.errors import ModelFileError, ParameterError
from minorloop.identification import _prior_kernels as _kernels
from minorloop.identification.bands import BAND
from minorloop.identification.curves import Curves
from minorloop.identification.design_matrix import PlaneSpec
from minorloop.identification.model_error import ModelError, Reach
from minorloop.identification.posterior import DensePosterior, Posterior
from minorloop.identification.prior import Hyperparameters
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Diagonal, Preisach

_PIECES = 8
"""Pieces of a branch of the major loop, whose steepest counts: a jump is not a slope."""
_DIGITS = 6
"""Significant digits of the numbers in a model file."""


@dataclass(frozen=True, eq=False)
class BandModel:
    """Standard deviations of readings predicted by a model."""

    posterior: Posterior
    """Distribution of the unknowns."""
    noise: float
    """Standard deviation of the sensor noise, as far as it is distinguished from other errors."""
    error: ModelError | None
    """Error beyond the posterior; None for few samples."""
    grouped: bool
    """Whether the readings are of another group."""
    shown: float
    """Mean of `within_cells` on the fitted samples, whose errors contain it."""

    def in_file(self) -> dict[str, Any]:
        """Return the entries of a model file."""
        # A posterior in a file has a plane of 12 bands: its deviations are those of 25 bands to a
        # tenth
        posterior, error = self.posterior.coarse(12), self.error
        spec = posterior.spec
        return {
            "levels": spec.levels.tolist(),
            "offset": spec.offset,
            "slope": spec.slope,
            "factor": [_short(row[: i + 1]) for i, row in enumerate(posterior.factor)],
            "unit": posterior.unit,
            "samples": posterior.samples,
            "discrepancy": posterior.hyperparameters.discrepancy,
            "noise": self.noise,
            "shown": self.shown,
            "grouped": self.grouped,
            "error": None if error is None else _error_in_file(error),
        }

    @classmethod
    def of_file(cls, part: BandsPart, model: Preisach) -> BandModel:
        """Return the uncertainty that a model file keeps.

        Raises a `ModelFileError` if the numbers contradict each other.
        """
        try:
            spec = PlaneSpec(
                as_levels(part.levels), model.relay, model.diagonal, part.offset, part.slope
            )
            h = Hyperparameters(discrepancy=part.discrepancy)
            factor = square(part.factor, spec.unknowns, "factors")
            posterior = DensePosterior(spec, h, part.unit, part.samples, 0.0, dense=factor)
            error = None if part.error is None else _error(part.error)
        except ValueError as wrong:
            raise ModelFileError(f"the bands are not valid: {reason(wrong)}") from None
        return cls(posterior, part.noise, error, part.grouped, part.shown)

    def deviation(
        self,
        model: Preisach,
        u: FloatArray,
        curves: Curves,
        samples: IntArray,
        probability: float = BAND,
        lag: int = 0,
    ) -> tuple[FloatArray, BoolArray]:
        """Standard deviations (M,) of readings at some samples of an input.

        Also returns (M,) whether a sample is where the record does not show the error of the model.

        ``model``: the model; ``u`` (T,): inputs; ``curves``: where the memory is reset; ``samples``
        (M,) of int: the samples, increasing; ``probability``: probability of the bands; ``lag``:
        rows by which the output follows the input.
        """
        inputs, places = curves.driven(u, model.levels, lag)
        places = places[samples]
        at_samples = np.zeros(inputs.size, dtype=np.bool_)
        at_samples[places] = True
        sd = np.hypot(self.posterior.deviation(inputs, curves.start, at_samples), self.noise)
        outside = _beyond(model, inputs)[places]
        farther = outside > 0
        if self.error is not None:
            sd, off = self.error.deviation(inputs, at_samples, curves.start, sd, probability)
            farther = farther | off
        if not self.grouped:  # errors on left-out groups include inputs beyond the other groups
            sd = np.hypot(sd, outside)
        within = within_cells(model, inputs, curves.start)
        mean = float(within.mean()) if within.size else 0.0
        left = max(1.0 - self.shown / mean, 0.0) if mean > 0 else 0.0
        return np.asarray(np.hypot(sd, np.sqrt(left * within[places]))), farther


def within_cells(model: Preisach, u: FloatArray, start: Start) -> FloatArray:
    """Variance (T,) from the unknown place of the weight inside the diagonal cells.

    Inputs at the levels do not show it. Both kinds of diagonal agree there, and either may hold
    between the levels.
    """
    other: Diagonal = "reversible" if model.diagonal == "uniform" else "uniform"
    apart = replace(model, diagonal=other).simulate(u, start) - model.simulate(u, start)
    return np.asarray(apart**2)


def _beyond(model: Preisach, u: FloatArray) -> FloatArray:
    """Standard deviation (T,) from the unknown relays beyond the levels.

    The output may continue with the steepest slope of the major loop. Relays that an input beyond
    one end switches are switched back on the way to the other end.
    """
    low, high = float(model.levels[0]), float(model.levels[-1])
    overshoot = np.zeros(u.size)
    if u.size and (u.min() < low or u.max() > high):
        _kernels.overshoot(u, low, high, overshoot)
        loop = np.linspace(low, high, _PIECES + 1)
        branches = model.simulate(np.concatenate([loop, loop[::-1]]))
        steepest = float(np.abs(np.diff(branches)).max()) * _PIECES / (high - low)
        overshoot *= steepest
    return overshoot


def _error_in_file(error: ModelError) -> dict[str, Any]:
    spec = error.reach.spec
    reached = error.reach.distance[:-1] == 0
    rows = np.split(reached, np.cumsum(np.arange(1, spec.bands)))
    return {
        "parts": error.parts,
        "levels": spec.levels.tolist(),
        "reached": ["".join("01"[one] for one in row.astype(int)) for row in rows],
        "factors": _short(error.factors),
        # Quantiles of the errors over their standard deviations that a file keeps: steps of 2 %
        "scores": _short(np.quantile(error.scores, np.linspace(0, 1, 51))),
        "inputs": _short(error.inputs),
        "variance": _short(error.variance),
    }


def _short(values: FloatArray) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values.tolist()]


def _error(part: ErrorPart) -> ModelError:
    spec = PlaneSpec(as_levels(part.levels))
    lengths = [len(row) for row in part.reached]
    if lengths != list(range(1, spec.bands + 1)) or set("".join(part.reached)) - set("01"):
        raise ParameterError("reached must have a text of 0 and 1 for each row up to the diagonal")
    reached = np.flatnonzero([one == "1" for one in "".join(part.reached)])
    numbers = {name: frozen(getattr(part, name)) for name in ("factors", "scores", "variance")}
    if any((values < 0).any() for values in numbers.values()) or (
        len(part.inputs) != len(part.variance) or (np.diff(part.inputs) <= 0).any()
    ):
        raise ParameterError("variances must be >= 0, one for each input, and inputs increase")
    return ModelError(part.parts, Reach.of(spec, reached), inputs=frozen(part.inputs), **numbers)

"""Bands in a model file, and conversion to and from what they follow from.

Apart from `_modelschema`, because most that is done with a model file needs no identification.
"""

from typing import Any

import numpy as np

from minorloop._modelschema import BandsPart, ErrorPart, square
from minorloop.arrays import FloatArray, as_levels, frozen
from minorloop.errors import ParameterError
from minorloop.identification.band_model import COARSE, BandModel
from minorloop.identification.design_matrix import PlaneSpec
from minorloop.identification.model_error import ModelError, Reach
from minorloop.identification.posterior import DensePosterior
from minorloop.identification.prior import Hyperparameters
from minorloop.operators.preisach import Preisach

_QUANTILES = 51
"""Quantiles of the errors over their standard deviations that a file keeps: steps of 2 %."""
_DIGITS = 6
"""Significant digits of what bands follow from."""


def bands_in_file(found: BandModel) -> dict[str, Any]:
    """Return what a file keeps of bands."""
    posterior, error = found.posterior.coarse(COARSE), found.error
    spec, h = posterior.spec, posterior.hyperparameters
    return {
        "levels": spec.levels.tolist(),
        "offset": spec.offset,
        "slope": spec.slope,
        "factor": [_short(row[: i + 1]) for i, row in enumerate(posterior.factor)],
        "unit": posterior.unit,
        "samples": posterior.samples,
        "discrepancy": h.discrepancy,
        "noise": found.noise,
        "shown": found.shown,
        "grouped": found.grouped,
        "error": None if error is None else _error_in_file(error),
    }


def _error_in_file(error: ModelError) -> dict[str, Any]:
    spec = error.reach.spec
    reached = error.reach.distance[:-1] == 0
    rows = np.split(reached, np.cumsum(np.arange(1, spec.bands)))
    return {
        "parts": error.parts,
        "levels": spec.levels.tolist(),
        "reached": ["".join("01"[one] for one in row.astype(int)) for row in rows],
        "factors": _short(error.factors),
        "scores": _short(np.quantile(error.scores, np.linspace(0, 1, _QUANTILES))),
        "inputs": _short(error.inputs),
        "variance": _short(error.variance),
    }


def _short(values: FloatArray) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values.tolist()]


def bands_of(part: BandsPart, model: Preisach) -> BandModel:
    """Return what bands follow from as a file has it.

    Raises a `ParameterError` if the numbers contradict each other.
    """
    levels = as_levels(part.levels)
    spec = PlaneSpec(levels, model.relay, model.diagonal, part.offset, part.slope)
    h = Hyperparameters(discrepancy=part.discrepancy)
    factor = square(part.factor, spec.unknowns, "factors")
    posterior = DensePosterior(spec, h, part.unit, part.samples, 0.0, dense=factor)
    error = None if part.error is None else _error(part.error)
    return BandModel(posterior, part.noise, error, part.grouped, part.shown)


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

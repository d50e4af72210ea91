"""What the bands of a model follow from, beside the model: all that a model file keeps of a fit."""

from dataclasses import dataclass, replace

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.identification import _prior_kernels as _kernels
from minorloop.identification.bands import BAND
from minorloop.identification.curves import Curves
from minorloop.identification.model_error import ModelError
from minorloop.identification.posterior import Posterior
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Diagonal, Preisach

_PIECES = 8
"""Pieces of a branch of the major loop of which the steepest counts: a jump is not a slope."""
COARSE = 12
"""Bands of the plane of a posterior in a file: its deviations are those of 25 bands to a tenth."""


@dataclass(frozen=True, eq=False)
class BandModel:
    """Standard deviations of readings predicted by a model."""

    posterior: Posterior
    """Distribution of the unknowns."""
    noise: float
    """Standard deviation of the sensor, as far as it is told from other errors."""
    error: ModelError | None
    """Error beyond the posterior; None for few samples."""
    grouped: bool
    """Whether the readings are of another group."""
    shown: float
    """Mean of `within_cells` on the fitted samples, whose errors contain it."""

    def deviation(
        self,
        model: Preisach,
        u: FloatArray,
        curves: Curves,
        samples: IntArray,
        probability: float = BAND,
        lag: int = 0,
    ) -> FloatArray:
        """Standard deviation (M,) of readings at some samples of an input, in increasing order.

        Parameters
        ----------
        model : Preisach
            The model.
        u : (T,) array
            Inputs.
        curves : Curves
            Where the memory is reset.
        samples : (M,) array of int
            Which samples.
        probability : float
            Probability of the bands.
        lag : int
            Rows by which the output follows the input.
        """
        inputs, places = curves.driven(u, model.levels, lag)
        places = places[samples]
        wanted = np.zeros(inputs.size, dtype=np.bool_)
        wanted[places] = True
        sd = np.hypot(self.posterior.deviation(inputs, curves.start, wanted), self.noise)
        if self.error is not None:
            sd = self.error.deviation(inputs, wanted, curves.start, sd, probability)
        if not self.grouped:  # a left-out group may reach beyond the others, and errors count this
            sd = np.hypot(sd, beyond(model, inputs)[places])
        within = within_cells(model, inputs, curves.start)
        mean = float(within.mean()) if within.size else 0.0
        left = max(1.0 - self.shown / mean, 0.0) if mean > 0 else 0.0
        return np.asarray(np.sqrt(sd**2 + left * within[places]))


def within_cells(model: Preisach, u: FloatArray, start: Start) -> FloatArray:
    """Variance (T,) from where the weight of the smallest loops is within their cells.

    Inputs at the levels do not show it. Both kinds of diagonal are the same there, and either may
    hold between them.
    """
    other: Diagonal = "reversible" if model.diagonal == "uniform" else "uniform"
    apart = replace(model, diagonal=other).simulate(u, start) - model.simulate(u, start)
    return np.asarray(apart**2)


def beyond(model: Preisach, u: FloatArray) -> FloatArray:
    """Standard deviation (T,) from relays beyond the levels, of which nothing is known.

    The output may go on as steeply as the major loop is where it is steepest. What an input beyond
    one end switched is switched back on the way to the other end.
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

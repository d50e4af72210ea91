"""Result of an identification: the model, its errors and advice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, IntArray, Samples
from minorloop.figures import NotebookView, figure_of
from minorloop.identification import _prior_kernels as _kernels
from minorloop.identification import advising
from minorloop.identification.bands import BAND, Prediction, as_probability
from minorloop.identification.baseline import delayed
from minorloop.identification.curves import Curves, as_curves
from minorloop.identification.fitted import Fit
from minorloop.identification.rough_model import few
from minorloop.identification.scores import score_rows
from minorloop.operators.inversion import Inversion, Unreachable, as_signal
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Diagonal

_PIECES = 8
"""Pieces of a branch of the major loop of which the steepest counts: a jump is not a slope."""


@dataclass(frozen=True, eq=False)
class Identification(Fit, NotebookView):
    """A model identified from a record.

    It has the fields and scores of a `Fit`, predicts, inverts, and gives advice.
    """

    @overload
    def predict(self, u: npt.ArrayLike, bands: None = None) -> Samples: ...

    @overload
    def predict(self, u: npt.ArrayLike, bands: float) -> Prediction: ...

    def predict(
        self, u: npt.ArrayLike, bands: float | None = None, curves: npt.ArrayLike | None = None
    ) -> Samples | Prediction:
        """Predict the outputs for an input that starts in the same state as the record.

        Parameters
        ----------
        u : (T,) array_like
            Inputs, sampled as the record was.
        bands : float, optional
            Probability, such as 0.9, that each output lies within its band: of another group, where
            the record has three groups or more.
        curves : (T,) array_like, optional
            Label of the curve of each input; the memory is reset where it changes.

        Returns
        -------
        (T,) array, or Prediction with bands
            Outputs, lag included. Before the first input, that input is assumed to be applied.

        Raises
        ------
        ParameterError
            If bands are not between 0 and 1.
        """
        if bands is None and curves is None:
            return delayed(self.model.simulate(u, self.start), self.lag)
        inputs = as_signal(u, name="u")
        parts = as_curves(curves, inputs.size, self.start, None)
        y = parts.simulate(self.model, inputs, self.lag)
        if bands is None:
            return y
        probability = as_probability(bands)
        sd = self._deviation(inputs, parts, np.arange(inputs.size), probability)
        return Prediction(inputs, y, sd, probability, self._noise)

    def invert(
        self,
        targets: npt.ArrayLike,
        start: Start | None = None,
        unreachable: Unreachable = "raise",
    ) -> Inversion:
        """Invert targets, and predict the standard deviation of the readings.

        Parameters
        ----------
        targets : (T,) array_like
            Outputs wanted, in order.
        start : start state, optional
            Memory before the first; that of the record if not given.
        unreachable : {"raise", "clip"}
            As in `Preisach.invert`.

        Returns
        -------
        Inversion
            With ``sd``, and with the warnings about this model.
        """
        begin = self.start if start is None else start
        found = replace(self.model.invert(targets, begin, unreachable), warnings=self.warnings)
        samples = np.arange(found.u.size)
        return replace(found, sd=self._deviation(found.u, Curves.whole(begin), samples, lag=0))

    def deviation(self, samples: npt.ArrayLike) -> FloatArray:
        """Standard deviation of predicted readings along the record, sensor noise included.

        Parameters
        ----------
        samples : (M,) array_like of int
            Which samples, in increasing order.

        Returns
        -------
        (M,) array
        """
        return self._deviation(self.u, self.curves, np.asarray(samples, dtype=np.int64))

    @property
    def _noise(self) -> float:
        """Standard deviation of the sensor, as far as it is told from other errors."""
        if self.grouped:
            return 0.0
        return self.uncertainty.hyperparameters.noise * self.uncertainty.unit

    def _deviation(
        self,
        u: FloatArray,
        curves: Curves,
        samples: IntArray,
        probability: float = BAND,
        lag: int | None = None,
    ) -> FloatArray:
        """Standard deviation of readings at some samples of an input, in increasing order."""
        inputs, places = curves.driven(u, self.model.levels, self.lag if lag is None else lag)
        places = places[samples]
        wanted = np.zeros(inputs.size, dtype=np.bool_)
        wanted[places] = True
        sd = np.hypot(self.uncertainty.deviation(inputs, curves.start, wanted), self._noise)
        if self.model_error is not None:
            sd = self.model_error.deviation(inputs, wanted, curves.start, sd, probability)
        if not self.grouped:  # a left-out group may reach beyond the others, and errors count this
            sd = np.hypot(sd, self._beyond(inputs)[places])
        return np.sqrt(sd**2 + self._within_cells(inputs, curves.start)[places])

    def _within_cells(self, u: FloatArray, start: Start) -> FloatArray:
        """Variance from where the weight of the smallest loops is within their cells.

        Inputs at the levels do not show it. Both kinds of diagonal are the same there, and either
        may hold between them. What the fitted rows show of it is in their errors.
        """
        other: Diagonal = "reversible" if self.model.diagonal == "uniform" else "uniform"
        model = replace(self.model, diagonal=other)

        def apart(inputs: FloatArray, begin: Start) -> FloatArray:
            return np.square(self.model.simulate(inputs, begin) - model.simulate(inputs, begin))

        inputs, places = self.curves.driven(self.u, self.model.levels, self.lag)
        shown = float(apart(inputs, self.curves.start)[places[self.fitted]].mean())
        found = apart(u, start)
        mean = float(found.mean()) if found.size else 0.0
        return found * max(1.0 - shown / mean, 0.0) if mean > 0 else found

    def _beyond(self, u: FloatArray) -> FloatArray:
        """Standard deviation from relays beyond the levels, of which nothing is known.

        The output may go on as steeply as the major loop is where it is steepest. What an input
        beyond one end switched is switched back on the way to the other end.
        """
        low, high = float(self.model.levels[0]), float(self.model.levels[-1])
        overshoot = np.zeros(u.size)
        if u.size and (u.min() < low or u.max() > high):
            _kernels.overshoot(u, low, high, overshoot)
            loop = np.linspace(low, high, _PIECES + 1)
            branches = self.model.simulate(np.concatenate([loop, loop[::-1]]))
            steepest = float(np.abs(np.diff(branches)).max()) * _PIECES / (high - low)
            overshoot *= steepest
        return overshoot

    @cached_property
    def band_sd(self) -> float:
        """Mean standard deviation of up to 800 predicted readings."""
        samples = np.flatnonzero(self.fitted) if self.grouped else np.arange(self.u.size)
        return float(self._deviation(self.u, self.curves, few(samples)).mean())

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Reasons not to trust the model, part of the advice; empty where there are none."""
        return (*self.of_record.warnings, *advising.warnings(self))

    @cached_property
    def advice(self) -> tuple[str, ...]:
        """What is weak and what to do about it; empty where nothing is weak."""
        samples = bool(self.findings or self.codes or self.suspects)
        return self.of_record.with_model(self.warnings, [*advising.advice(self)], samples=samples)

    def __str__(self) -> str:
        rows = [("model", repr(self.model)), *score_rows(self)]
        lines = [f"{name:<24} {value}" for name, value in rows]
        lines += [f"chosen {text}" for text in self.chosen]
        return "\n".join(lines + [f"advice: {text}" for text in self.advice])

    def plot(
        self,
        *,
        input_label: str = "input",
        output_label: str = "output",
        time: FloatArray | None = None,
    ) -> Any:
        """Draw the loop, the fit, the residual and the plane; gives the matplotlib figure.

        Parameters
        ----------
        input_label : str
            Name and unit of the input, for the axes.
        output_label : str
            Name and unit of the output.
        time : (T,) array, optional
            Time of each sample in seconds; that of the record if not given. Without it, samples are
            counted.
        """
        clock = self.t if time is None else time
        return figure_of(self, input_label=input_label, output_label=output_label, time=clock)

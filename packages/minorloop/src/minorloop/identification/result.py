"""Result of an identification: the model, its errors and advice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import overload

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, IntArray, Samples
from minorloop.figures import Drawn
from minorloop.identification import advising
from minorloop.identification.band_model import BandModel, within_cells
from minorloop.identification.bands import BAND, Prediction, as_probability
from minorloop.identification.baseline import delayed
from minorloop.identification.curves import Curves, as_curves
from minorloop.identification.fitted import Fit
from minorloop.identification.rough_model import few
from minorloop.identification.scores import score_rows
from minorloop.operators.inversion import Inversion, Unreachable, as_signal
from minorloop.operators.memory import Start


@dataclass(frozen=True, eq=False)
class Identification(Fit, Drawn):
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
        """Predict the outputs, lag included, for an input sampled as the record was.

        Parameters and errors are those of `Result.predict`. Where the record has three groups or
        more, the bands are of another group.
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
        beyond = 0.0
        if self.model_error is not None:
            driven, places = parts.driven(inputs, self.model.levels, self.lag)
            wanted = np.isin(np.arange(driven.size), places)
            beyond = self.model_error.beyond(driven, wanted, self.start)
        return Prediction(inputs, y, sd, probability, self._noise, beyond)

    def invert(
        self,
        targets: npt.ArrayLike,
        start: Start | None = None,
        unreachable: Unreachable = "raise",
    ) -> Inversion:
        """Invert targets, and predict the standard deviation of readings, as `Result.invert`."""
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
        late = self.lag if lag is None else lag
        return self.band_model.deviation(self.model, u, curves, samples, probability, late)

    @cached_property
    def band_model(self) -> BandModel:
        """What the bands follow from, beside the model."""
        inputs, places = self.curves.driven(self.u, self.model.levels, self.lag)
        within = within_cells(self.model, inputs, self.curves.start)[places[self.fitted]]
        shown = float(within.mean())
        return BandModel(self.uncertainty, self._noise, self.model_error, self.grouped, shown)

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

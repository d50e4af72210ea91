"""Result of an identification: the model, its errors and advice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Samples
from minorloop.errors import ParameterError
from minorloop.figures import figure_of
from minorloop.identification import advising
from minorloop.identification.bands import Prediction, as_probability
from minorloop.identification.baseline import delayed, percent
from minorloop.identification.fitted import Fit
from minorloop.identification.prior import Posterior, regressors
from minorloop.operators.inversion import Inversion, Unreachable, as_signal
from minorloop.operators.memory import Start


@dataclass(frozen=True, eq=False)
class Identification(Fit):
    """A model identified from a record.

    It has the fields and scores of a `Fit`, predicts, inverts, and gives advice.
    """

    @overload
    def predict(self, u: npt.ArrayLike, bands: None = None) -> Samples: ...

    @overload
    def predict(self, u: npt.ArrayLike, bands: float) -> Prediction: ...

    def predict(self, u: npt.ArrayLike, bands: float | None = None) -> Samples | Prediction:
        """Predict the outputs for an input that starts in the same state as the record.

        Parameters
        ----------
        u : (T,) array_like
            Inputs, sampled as the record was.
        bands : float, optional
            Probability, such as 0.9, that each output lies within its band.

        Returns
        -------
        (T,) array, or Prediction where bands are asked for
            Outputs, lag included. Before the first input, that input is assumed to be applied.

        Raises
        ------
        ParameterError
            If bands are asked for and the model was identified without the prior, or they are
            not between 0 and 1.
        """
        y = delayed(self.model.simulate(u, self.start), self.lag)
        if bands is None:
            return y
        inputs = as_signal(u, name="u")
        sd = delayed(self._posterior.deviation(inputs, self.start), self.lag)
        return Prediction(inputs, np.asarray(y), sd, as_probability(bands))

    def invert(
        self,
        targets: npt.ArrayLike,
        start: Start | None = None,
        unreachable: Unreachable = "raise",
    ) -> Inversion:
        """Invert targets, and predict the standard deviation of the outputs.

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
            With ``sd`` where the prior was used, and with the warnings about this model.
        """
        begin = self.start if start is None else start
        found = replace(self.model.invert(targets, begin, unreachable), warnings=self.warnings)
        if self.posterior is None:
            return found
        return replace(found, sd=self.posterior.deviation(found.u, begin))

    def deviation(self, samples: npt.ArrayLike) -> FloatArray:
        """Standard deviation of predicted readings along the record, sensor noise included.

        Parameters
        ----------
        samples : (M,) array_like of int
            Which samples, in increasing order.

        Returns
        -------
        (M,) array

        Raises
        ------
        ParameterError
            If the model was identified without the prior.
        """
        posterior = self._posterior
        wanted = np.zeros(self.u.size, dtype=np.bool_)
        places = np.maximum(np.asarray(samples, dtype=np.int64) - self.lag, 0)
        wanted[places] = True
        rows, _ = regressors(posterior.spec, self.u, wanted, self.start)
        known = posterior.row_deviation(rows)[np.searchsorted(np.flatnonzero(wanted), places)]
        return np.hypot(known, posterior.hyperparameters.noise * posterior.unit)

    @property
    def _posterior(self) -> Posterior:
        if self.posterior is None:
            raise ParameterError(
                'this model has no bands; identify with prior="gaussian" (--prior gaussian)'
            )
        return self.posterior

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Reasons not to trust the model, part of the advice; empty where there are none."""
        return tuple(advising.warnings(self))

    @cached_property
    def advice(self) -> tuple[str, ...]:
        """What is weak and what to do about it; empty where nothing is weak."""
        return tuple(advising.advice(self))

    def __str__(self) -> str:
        held = self.holdout_nrmse
        rows = [
            ("model", repr(self.model)),
            ("samples, unknowns", f"{self.samples}, {self.unknowns}"),
            ("cells excited", f"{self.excited_fraction:.0%}"),
            ("lag", f"{self.lag} samples"),
            ("error, fitted", f"{percent(self.nrmse)} of range"),
            ("error, held out", "not asked for" if held is None else f"{percent(held)} of range"),
            ("best delayed polynomial", f"{percent(self.baseline_nrmse)} of range"),
            ("optimality", f"{self.kkt:.1e}" + ("" if self.converged else ", not converged")),
        ]
        lines = [f"{name:<24} {value}" for name, value in rows]
        return "\n".join(lines + [f"advice: {text}" for text in self.advice])

    def plot(self, *, input_label: str = "input", output_label: str = "output") -> Any:
        """Draw the loop, the fit, the residual and the plane; gives the matplotlib figure.

        Parameters
        ----------
        input_label : str
            Name and unit of the input, for the axes.
        output_label : str
            Name and unit of the output.
        """
        return figure_of(self, input_label=input_label, output_label=output_label)

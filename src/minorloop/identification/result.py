"""What an identification gives: the model, how good it is, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, Samples
from minorloop.errors import ParameterError
from minorloop.figures import figure_of
from minorloop.identification import advising, diagnosis
from minorloop.identification.areas import Areas
from minorloop.identification.bands import Prediction, as_probability
from minorloop.identification.baseline import delayed, nrmse, polynomial_nrmse
from minorloop.identification.prior import Belief, regressors
from minorloop.identification.screening import Code, Finding, screened
from minorloop.operators.inversion import Inversion, Unreachable, as_signal
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Preisach


@dataclass(frozen=True, eq=False)
class Identification:
    """A model identified from a record.

    Parameters
    ----------
    model : Preisach
        The operator.
    lag : int
        Samples by which the output follows the input, beyond the hysteresis.
    start : {"negative", "positive", "demagnetised"} or Memory
        Memory before the first sample of the record.
    smoothness : float
        Strength that was used.
    kkt : float
        Largest violation of the optimality conditions, relative to the norm of the output.
    u, y : (T,) arrays
        The record; y is NaN where nothing was measured.
    fitted, held_out : (T,) arrays of bool
        Samples that the model was fitted to, and those that it was not shown.
    areas : Areas
        Regressors of the fitted samples.
    belief : Belief, optional
        How sure the prior is of the unknowns; None where it was not used.
    suspects : tuple of int
        Samples that lie far outside the band that all others give, and were set aside.
    codes : tuple of Code
        Readings that were overload codes or sentinels, and count as not measured.
    sought : bool
        Whether the lag is the best of several.
    converged : bool
        Whether the solver reached the optimum; `advice` says so where it did not.
    """

    model: Preisach
    lag: int
    start: Start
    smoothness: float
    kkt: float
    u: FloatArray
    y: FloatArray
    fitted: BoolArray
    held_out: BoolArray
    areas: Areas
    belief: Belief | None = None
    suspects: tuple[int, ...] = ()
    codes: tuple[Code, ...] = ()
    sought: bool = False
    converged: bool = True

    @overload
    def predict(self, u: npt.ArrayLike, bands: None = None) -> Samples: ...

    @overload
    def predict(self, u: npt.ArrayLike, bands: float) -> Prediction: ...

    def predict(self, u: npt.ArrayLike, bands: float | None = None) -> Samples | Prediction:
        """Outputs for an input that begins where the record began, lag included.

        Parameters
        ----------
        u : (T,) array_like
            Inputs, sampled as the record was.
        bands : float, optional
            Probability, such as 0.9, with which each output should lie within its band.

        Returns
        -------
        (T,) array, or Prediction where bands are asked for
            Outputs. The first ``lag`` of them answer inputs from before the first, which is
            taken to have been there already.

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
        sd = delayed(self._belief.deviation(inputs, self.start), self.lag)
        return Prediction(inputs, np.asarray(y), sd, as_probability(bands))

    def invert(
        self,
        targets: npt.ArrayLike,
        start: Start | None = None,
        unreachable: Unreachable = "raise",
    ) -> Inversion:
        """Inputs for targets, with the standard deviation of what they will achieve.

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
        if self.belief is None:
            return found
        return replace(found, sd=self.belief.deviation(found.u, begin))

    @cached_property
    def prediction(self) -> FloatArray:
        """(T,) outputs of the model along the record."""
        return self.predict(self.u)

    def deviation(self, samples: npt.ArrayLike) -> FloatArray:
        """Standard deviation of what the sensor reads along the record, its noise included.

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
        belief = self._belief
        wanted = np.zeros(self.u.size, dtype=np.bool_)
        places = np.maximum(np.asarray(samples, dtype=np.int64) - self.lag, 0)
        wanted[places] = True
        rows, _ = regressors(belief.form, self.u, wanted, self.start)
        known = belief.row_deviation(rows)[np.searchsorted(np.flatnonzero(wanted), places)]
        return np.hypot(known, belief.hyperparameters.noise * belief.unit)

    @cached_property
    def rmse(self) -> float:
        """Root-mean-square error on the fitted samples, in the unit of the output."""
        residual = (self.prediction - self.y)[self.fitted]
        return float(np.sqrt(np.mean(residual**2)))

    @property
    def nrmse(self) -> float:
        """`rmse` over the range of the fitted output."""
        return self.rmse / (float(np.ptp(self.y[self.fitted])) or 1.0)

    @cached_property
    def holdout_nrmse(self) -> float | None:
        """Error on the samples held out, over their range; None where none were."""
        if not self.held_out.any():
            return None
        return nrmse((self.prediction - self.y)[self.held_out], self.y[self.held_out])

    @cached_property
    def baseline_nrmse(self) -> float:
        """Error of the best delayed polynomial, on the held-out samples where there are any."""
        scored = self.held_out if self.held_out.any() else self.fitted
        return polynomial_nrmse(self.u, self.y, self.fitted, scored)

    @property
    def _belief(self) -> Belief:
        if self.belief is None:
            raise ParameterError(
                'this model has no bands; identify with prior="gaussian" (--prior gaussian)'
            )
        return self.belief

    @property
    def unknowns(self) -> int:
        """Weights, and offset and slope where fitted."""
        return self.areas.form.unknowns

    @property
    def samples(self) -> int:
        """Samples that the model was fitted to."""
        return self.areas.samples

    @property
    def rank(self) -> int:
        """Independent unknowns that the fitted samples determine; worked out when asked."""
        return self._rank_and_condition[0]

    @property
    def condition(self) -> float:
        """Condition of the design with unit columns, over its rank; worked out when asked."""
        return self._rank_and_condition[1]

    @property
    def excited(self) -> BoolArray:
        """(L, L) cells of the plane that the fitted samples look into."""
        return self.areas.excited

    @property
    def excited_fraction(self) -> float:
        """Share of the cells that are excited."""
        return float(np.count_nonzero(self.excited)) / self.areas.form.cells

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Outliers, stuck and clipped stretches and a lag in the record that are in the model."""
        y = self.y.copy()
        y[list(self.suspects)] = np.nan
        return screened(self.u, y, self.start, self.lag, sought=self.sought)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Why the model is not to be trusted; empty where nothing says so. Part of the advice."""
        return tuple(advising.warnings(self))

    @cached_property
    def advice(self) -> tuple[str, ...]:
        """What is weak, and what to do about it; empty where nothing is."""
        return tuple(advising.advice(self))

    def __str__(self) -> str:
        held = self.holdout_nrmse
        rows = [
            ("model", repr(self.model)),
            ("samples, unknowns", f"{self.samples}, {self.unknowns}"),
            ("cells excited", f"{self.excited_fraction:.0%}"),
            ("lag", f"{self.lag} samples"),
            ("error, fitted", f"{self.nrmse:.3%} of range"),
            ("error, held out", "not asked for" if held is None else f"{held:.3%} of range"),
            ("best delayed polynomial", f"{self.baseline_nrmse:.3%} of range"),
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

    @cached_property
    def _rank_and_condition(self) -> tuple[int, float]:
        return diagnosis.rank_and_condition(self.areas)

"""A fit to a record: the model, the record, and how well the one follows the other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.identification import diagnosis
from minorloop.identification.areas import DesignMatrix
from minorloop.identification.baseline import delayed, nrmse, polynomial_nrmse
from minorloop.identification.prior import Posterior
from minorloop.identification.rough_model import RecordFault
from minorloop.identification.screening import Code, screened
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Preisach


@dataclass(frozen=True, eq=False)
class Fit:
    """A model fitted to a record, and how well it follows it.

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
    areas : DesignMatrix
        Regressors of the fitted samples.
    belief : Posterior, optional
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
    areas: DesignMatrix
    belief: Posterior | None = None
    suspects: tuple[int, ...] = ()
    codes: tuple[Code, ...] = ()
    sought: bool = False
    converged: bool = True

    @cached_property
    def prediction(self) -> FloatArray:
        """(T,) outputs of the model along the record."""
        return delayed(self.model.simulate(self.u, self.start), self.lag)

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
    def findings(self) -> tuple[RecordFault, ...]:
        """Outliers, stuck and clipped stretches and a lag in the record that are in the model."""
        y = self.y.copy()
        y[list(self.suspects)] = np.nan
        return screened(self.u, y, self.start, self.lag, sought=self.sought)

    @cached_property
    def _rank_and_condition(self) -> tuple[int, float]:
        return diagnosis.rank_and_condition(self.areas)

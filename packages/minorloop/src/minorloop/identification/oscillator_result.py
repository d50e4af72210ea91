"""An oscillator with hysteresis fitted to a record: its scores and advice."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray
from minorloop.dynamics.oscillator import Oscillator
from minorloop.identification.mean_period import larger_beginning
from minorloop.identification.output_error import correlation_time
from minorloop.identification.result import Fit, Rule, ScoreRow, of_range
from minorloop.identification.simulation_error import (
    Minimum,
    OscillatorRecord,
    parameter_names,
    parameters_of,
)

_SMALL = 1e-3
"""Error over the standard deviation of the displacement below which the beginning is not checked:
an initial motion would cause a larger error."""
_INTEGRATED = 1e-5
"""The same ratio below which the error may be that of the integration, about 4e-6 with five steps.
"""


@dataclass(frozen=True)
class TriedLevels:
    """A number of levels of an unknown law that was compared."""

    levels: int
    """Levels for each direction."""
    error: float
    """Root-mean-square error of the simulation, in m."""
    criterion: float
    """Bayesian information criterion; the least is best."""

    @classmethod
    def of(cls, levels: int, found: Minimum) -> TriedLevels:
        """Return the comparison of a fit."""
        count, parameters = found.jacobian.shape
        square = float(np.mean(found.residuals**2))
        criterion = count * np.log(max(square, 1e-300)) + parameters * np.log(count)
        return cls(levels, float(np.sqrt(square)), float(criterion))


def _search(fit: OscillatorIdentification) -> Iterator[str]:
    if not fit.converged:
        yield (
            f"the search has not converged after {fit.minimum.steps} steps; give a nearer start, "
            "or fix parameters that the record does not determine"
        )


def _beginning(fit: OscillatorIdentification) -> Iterator[str]:
    """Report a beginning of the record that differs from the rest."""
    ratio = larger_beginning(fit.minimum.residuals)
    if left := fit.motion.unsettled:
        first = "first period differs" if left == 1 else f"first {left} periods differ"
        yield (
            f"the {first} from the later ones more than these from each other, as if the motion "
            f"had not settled; {'it is' if left == 1 else 'they are'} not fitted"
        )
    elif not fit.motion.periodic and ratio and fit.share >= _SMALL:
        yield (
            f"the error is {ratio:.2g} times as large at the beginning of the record as later, as "
            "if the structure moved before; begin at rest, give a period if the record "
            "repeats, or exclude the beginning from the error with skip (--record skip=N)"
        )


def _accuracy(fit: OscillatorIdentification) -> Iterator[str]:
    """Report errors of the law, and parameters that the record does not determine."""
    beyond = fit.error / fit.noise if fit.noise and fit.share > _INTEGRATED else 0.0
    # Ratio of error to noise from which the model is incomplete: with 100 samples or more, noise
    # alone exceeds it with a probability below 1 %
    if beyond > 1.1:
        yield (
            f"the error is {beyond:.2g} times the noise of the record, so the "
            'model is incomplete; try rough="unknown", or a stiffness of higher degree'
        )
    share = fit.sd / np.maximum(np.abs(fit.parameters), np.finfo(float).tiny)
    # Ratio of standard deviation to value from which a parameter counts as not determined
    undetermined = [name for name, one in zip(fit.names, share, strict=True) if one > 0.5]
    if undetermined and not fit.tried:
        yield (
            f"the record does not determine {', '.join(undetermined)}; excite larger amplitudes "
            "and more frequencies, or fix them"
        )


def _by_name(attribute: str) -> Callable[[Any], dict[str, float]]:
    """Return a function of a fit: one number for each parameter, by its name."""
    return lambda fit: dict(zip(fit.names, getattr(fit, attribute).tolist(), strict=True))


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OscillatorIdentification(Fit[Oscillator]):
    """An oscillator with hysteresis, identified from a record or, if it is periodic, a mean period.

    Times begin at 0, and displacements are in m.
    """

    HEADLINE: ClassVar[str] = "{output} of an oscillator with hysteresis, driven by {input}"
    CAPTION: ClassVar[str] = "Displacement, error of the model, and its loops."
    SCORES: ClassVar[tuple[ScoreRow, ...]] = (
        ScoreRow("rms_error", "error", "simulation error, rms", "{:.3g} m", kept=True),
        ScoreRow("nrmse", "nrmse", "the same over the range", of_range, kept=True),
        ScoreRow("noise", "noise", "noise of the record", "{:.3g} m", "not known"),
        ScoreRow("", "unknowns", "parameters"),
        ScoreRow("samples", lambda fit: int(fit.fitted.sum()), "samples fitted"),
        ScoreRow("parameters", _by_name("parameters")),
        ScoreRow("standard_deviations", _by_name("sd")),
        ScoreRow("levels", lambda fit: {str(one.levels): one.error for one in fit.tried}),
        ScoreRow("converged", "converged"),
    )
    WARNINGS: ClassVar[tuple[Rule, ...]] = (_search,)
    REMARKS: ClassVar[tuple[Rule, ...]] = (_beginning, _accuracy)

    motion: OscillatorRecord
    """The fitted record."""
    minimum: Minimum
    """End of the search: parameters and error."""
    free: BoolArray
    """Shape (P,). Parameters that were fitted."""
    tried: tuple[TriedLevels, ...] = ()
    """Numbers of levels that were compared for an unknown law."""

    @property
    def unknowns(self) -> int:
        """Parameters that were fitted."""
        return int(self.free.sum())

    @property
    def prediction(self) -> FloatArray:
        """(T,) displacements of the model; NaN where they do not count."""
        y = np.full(self.y.size, np.nan)
        y[self.fitted] = self.y[self.fitted] + self.minimum.residuals
        return y

    def predict(self, t: npt.ArrayLike, u: npt.ArrayLike) -> FloatArray:
        """Predict the displacements for another force from rest, as `Oscillator.simulate`."""
        return self.model.simulate(t, u, between=self.motion.between)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return parameter_names(self.model)

    @property
    def parameters(self) -> FloatArray:
        """(P,) values of the parameters."""
        return parameters_of(self.model)

    @cached_property
    def covariance(self) -> FloatArray:
        """(P, P) covariance of the parameters; zero for those that were fixed.

        The variance of the error is multiplied by the correlation time of its samples.
        """
        jacobian, residuals = self.minimum.jacobian, self.minimum.residuals
        scale = np.linalg.norm(jacobian, axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        inverse = np.linalg.pinv(jacobian / scale) / scale[:, None]
        spare = max(residuals.size - jacobian.shape[1], 1)
        variance = float(residuals @ residuals) / spare * correlation_time([residuals])
        found = np.zeros((self.free.size, self.free.size))
        found[np.ix_(self.free, self.free)] = variance * (inverse @ inverse.T)
        return found

    @property
    def sd(self) -> FloatArray:
        """(P,) standard deviations of the parameters; zero for those that were fixed."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def error(self) -> float:
        """Root-mean-square error of the simulation, in m."""
        return float(np.sqrt(np.mean(self.minimum.residuals**2)))

    @property
    def nrmse(self) -> float:
        """Root-mean-square error over the range of the displacements."""
        return self.error / self.span(self.fitted)

    @property
    def share(self) -> float:
        """Root-mean-square error over the standard deviation of the displacements."""
        return self.error / float(np.std(self.y[self.fitted]))

    @property
    def noise(self) -> float | None:
        """Standard deviation of the mean period; None if the record does not repeat."""
        return self.motion.noise

    @property
    def converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.minimum.converged

    def _further_rows(self) -> list[tuple[str, str]]:
        rows = [(f"{one.levels} levels", f"{one.error:.3g} m") for one in self.tried]
        shown = 2 + self.model.stiffness.size if self.tried else self.free.size
        for name, value, sd in list(zip(self.names, self.parameters, self.sd, strict=True))[:shown]:
            rows.append((name, f"{value:.6g} +- {sd:.2g}" if sd else f"{value:.6g} (fixed)"))
        return rows

    def _summary(self, source: str) -> str:
        return (
            f"Identified from {self.u.size} rows of {source} by the error of the simulation, which "
            f"is {self.error:.3g} m rms, {self.nrmse:.3%} of the range."
        )

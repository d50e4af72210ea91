"""Result of the identification of an oscillator with hysteresis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.dynamics.oscillator import Oscillator
from minorloop.figures import Drawn
from minorloop.identification.levenberg_marquardt import Minimum
from minorloop.identification.mean_period import larger_beginning
from minorloop.identification.output_error import correlation_time
from minorloop.identification.simulation_error import (
    OscillatorRecord,
    parameter_names,
    parameters_of,
)

_BEYOND_NOISE = 1.1
"""Error over noise from which the model misses something: for 100 samples and more, an error that
is only noise is as large with a probability below 1 %."""
_UNCERTAIN = 0.5
"""Standard deviation over the value of a parameter from which it counts as not determined."""
_SMALL = 1e-3
"""Error over the standard deviation of the displacement below which its course is no matter: an
initial motion would leave more."""
_INTEGRATED = 1e-5
"""The same below which it may be the error of the integration, about 4e-6 with five steps."""


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


@dataclass(frozen=True, eq=False)
class OscillatorIdentification(Drawn):
    """An oscillator with hysteresis, identified from a record."""

    model: Oscillator
    """The model."""
    record: OscillatorRecord
    """What was fitted; of a periodic record, its mean period."""
    minimum: Minimum
    """How the search ended."""
    free: BoolArray
    """Shape (P,). Parameters that were fitted."""
    tried: tuple[TriedLevels, ...] = ()
    """Numbers of levels that were compared for an unknown law."""
    lag: int = 0
    lag_seconds: float = 0.0
    """``lag`` and ``lag_seconds``: lag of the output in rows and in seconds, for model files: none.
    """

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

        The variance of the error counts as often as its samples are correlated.
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
    def noise(self) -> float | None:
        """Standard deviation of the mean period; None if the record does not repeat."""
        return self.record.noise

    @property
    def scores(self) -> Mapping[str, float | None]:
        """Scores that a model file keeps; the error over the range, and in m."""
        known = self.record.y[self.record.scored]
        return {"nrmse": self.error / float(np.ptp(known)), "rms_error": self.error}

    @property
    def converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.minimum.converged

    @property
    def warnings(self) -> tuple[str, ...]:
        """Why the model is not to be trusted."""
        if self.converged:
            return ()
        return (
            f"the search has not converged after {self.minimum.steps} steps; give a nearer start, "
            "or fix parameters that the record does not determine",
        )

    @property
    def advice(self) -> tuple[str, ...]:
        """What to know about this model, and what to do."""
        texts = [*self.warnings, *self._of_the_beginning()]
        beyond = self.error / self.noise if self.noise and self._share > _INTEGRATED else 0.0
        if beyond > _BEYOND_NOISE:
            texts.append(
                f"the error is {beyond:.2g} times the noise of the record, so the "
                "model lacks something; try start='unknown', or a stiffness of higher degree"
            )
        share = self.sd / np.maximum(np.abs(self.parameters), np.finfo(float).tiny)
        loose = [name for name, one in zip(self.names, share, strict=True) if one > _UNCERTAIN]
        if loose and not self.tried:
            texts.append(
                f"the record does not determine {', '.join(loose)}; excite larger amplitudes and "
                "more frequencies, or fix them"
            )
        return tuple(texts)

    @property
    def _share(self) -> float:
        """Error over the standard deviation of the displacement."""
        return self.error / float(np.std(self.record.y[self.record.scored]))

    def _of_the_beginning(self) -> list[str]:
        """Return what to know about a record that does not begin as it goes on."""
        if left := self.record.unsettled:
            first = "first period differs" if left == 1 else f"first {left} periods differ"
            return [
                f"the {first} from the later ones more than these from each other, as a motion "
                f"does that has not settled; {'it is' if left == 1 else 'they are'} left out"
            ]
        ratio = larger_beginning(self.minimum.residuals)
        if self.record.periodic or not ratio or self._share < _SMALL:
            return []
        return [
            f"the error is {ratio:.2g} times as large at the beginning of the record as later, as "
            "where the structure moved before; begin at rest, give a period if the record "
            "repeats, or leave the beginning out of the error with skip (--skip)"
        ]

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Rows of a table, label and value."""
        noise = "not known" if self.noise is None else f"{self.noise:.3g} m"
        rows = [
            ("simulation error, rms", f"{self.error:.3g} m"),
            ("noise of the record", noise),
            ("parameters", f"{int(self.free.sum())}"),
        ]
        if self.tried:
            rows += [(f"{one.levels} levels", f"{one.error:.3g} m") for one in self.tried]
            shown = 2 + self.model.stiffness.size
        else:
            shown = self.free.size
        for name, value, sd in list(zip(self.names, self.parameters, self.sd, strict=True))[:shown]:
            rows.append((name, f"{value:.6g} +- {sd:.2g}" if sd else f"{value:.6g} (fixed)"))
        return rows

    def __str__(self) -> str:
        lines = [f"{name:<24} {value}" for name, value in self.rows]
        return "\n".join([*lines, *(f"advice: {text}" for text in self.advice)])

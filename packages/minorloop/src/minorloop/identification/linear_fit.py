"""Results of the identification of linear dynamics."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_times
from minorloop.dynamics.linear import Linear
from minorloop.errors import ParameterError
from minorloop.figures import Drawn
from minorloop.identification.output_error import Coefficients, Stretch, Structure

Kind: TypeAlias = Literal["plain", "oscillatory", "alternating"]

_SHOWN = 6
_COARSE = 0.02
"""Simulation error over the range above which the plant is not linear."""


@dataclass(frozen=True, eq=False)
class TriedEquation:
    """A difference equation that was fitted as a candidate."""

    structure: Structure
    """Numbers of coefficients, and delay."""
    coefficients: Coefficients
    """Fitted coefficients."""
    kind: Kind
    """Kind of the poles: "plain" if all are real and positive, "oscillatory" if some are complex,
    "alternating" if some are negative."""
    bic: float
    """Bayesian information criterion of the simulation error."""
    nrmse: float
    """Simulation error on the record, over the range of its output."""
    free_run: float | None
    """Simulation error on the second record, over its range; None without one."""

    @property
    def score(self) -> float:
        """Simulation error on the second record, or on the first if there is no second."""
        return self.nrmse if self.free_run is None else self.free_run


@dataclass(frozen=True, eq=False)
class LinearFit(Drawn):
    """Linear dynamics identified from a record."""

    model: Linear
    """Sampled model, with DC gain 1."""
    gain: float
    """DC gain of the record."""
    candidate: TriedEquation
    """The chosen equation."""
    candidates: tuple[TriedEquation, ...]
    """All equations that were tried."""
    covariance: FloatArray
    """Shape (na + nb, na + nb). Covariance of the coefficients of A and B, before the gain is
    scaled to 1."""
    stretches: tuple[Stretch, ...]
    second: tuple[Stretch, ...]
    """``stretches`` and ``second``: the fitted record, and the second record, which was scored."""

    @property
    def nrmse(self) -> float:
        """Simulation error on the record, over its range."""
        return self.candidate.nrmse

    @property
    def free_run_nrmse(self) -> float | None:
        """Simulation error on the second record, over its range; None if there is none."""
        return self.candidate.free_run

    @cached_property
    def continuous(self) -> Linear | None:
        """The model in continuous time; None if none of the same order exists."""
        try:
            return self.model.continuous()
        except ParameterError:
            return None

    @cached_property
    def time_constant_deviations(self) -> FloatArray:
        """(na,) standard deviations of the time constants of ``model``, in seconds."""
        found, interval = self.candidate.coefficients, self._interval
        poles = np.asarray(found.poles)
        order = found.a.size
        slope = np.polyval(np.polyder(np.concatenate([[1.0], found.a])), poles)
        with np.errstate(all="ignore"):
            by_a = -np.vander(poles, order) / slope[:, None]
            # d log|z| / da = Re(dz / z)
            rate = np.real(by_a / poles[:, None])
            spread = np.sqrt(np.einsum("pi,ij,pj->p", rate, self.covariance[:order, :order], rate))
            logs = np.log(np.abs(poles))
            deviations = interval * spread / logs**2
        slowest_first = np.argsort(interval / logs)
        return np.asarray(deviations[slowest_first])

    def step_deviation(self, t: npt.ArrayLike) -> FloatArray:
        """Standard deviation of the unit step response at times t (T,), in seconds from the step.

        It is computed to first order in the coefficients, with the DC gain fixed at 1.

        Raises a `SignalError` if the times do not increase.
        """
        times = as_times(t, fewest=1)
        found, count = self.candidate.coefficients, int(max(times[-1] / self._interval, 0)) + 2
        unit = np.ones(count)
        whole = 1 + found.a.sum()
        by_gain = np.concatenate(
            [np.full(found.a.size, -self.gain / whole), np.full(found.b.size, 1 / whole)]
        )
        by_theta = (
            found.sensitivities(unit) - np.outer(found.simulate(unit), by_gain) / self.gain
        ) / self.gain
        variance = np.einsum("ki,ij,kj->k", by_theta, self.covariance, by_theta)
        spread = np.sqrt(np.maximum(variance, 0.0))
        return np.asarray(np.interp(times, self._interval * np.arange(count), spread, left=0.0))

    @cached_property
    def advice(self) -> tuple[str, ...]:
        """Sentences about weaknesses and remedies; empty if there are none."""
        texts = []
        if self.candidate.score > _COARSE:
            texts.append(
                f"the simulation error is {self.candidate.score:.1%} of range; the plant is not "
                "linear over these steps: use smaller steps, or one response for each direction"
            )
        if self.continuous is None:
            texts.append("a pole has no equivalent in continuous time; sample faster")
        if self.free_run_nrmse is None:
            texts.append(
                "the order was chosen on the fitted record; give a second record to choose it"
            )
        slowest = float(self.model.time_constants[0])
        longest = max(np.count_nonzero(one.u) for one in self.stretches) * self._interval
        # Remainder of the slowest mode after the longest hold above which holds are too short
        if np.exp(-longest / slowest) > 0.05:
            texts.append(
                f"the slowest time constant is {slowest:.3g} s and the longest hold "
                f"{longest:.3g} s; hold for three time constants"
            )
        return tuple(texts)

    def __str__(self) -> str:
        structure = self.candidate.structure
        pairs = zip(self.model.time_constants, self.time_constant_deviations, strict=True)
        times = ", ".join(f"{time:.4g} ± {spread:.1g}" for time, spread in pairs)
        free = self.free_run_nrmse
        rows = [
            ("coefficients of A, B", f"{structure.na}, {structure.nb}"),
            ("dead time", f"{self.model.delay:g} s"),
            ("time constants [s]", times),
            ("gain of the record", f"{self.gain:.6g}"),
            ("error, record", f"{self.nrmse:.3%} of range"),
            ("error, second record", "none given" if free is None else f"{free:.3%} of range"),
        ]
        lines = [f"{name:<24} {value}" for name, value in rows]
        return "\n".join([*lines, *self._table(), *(f"advice: {text}" for text in self.advice)])

    @property
    def _interval(self) -> float:
        return self.model.interval or 1.0

    def _table(self) -> list[str]:
        """Return the best candidates, one per line."""
        lines = [f"{'tried: A, B, delay':<24} {'BIC':>10} {'record':>9} {'second':>9}"]
        for one in sorted(self.candidates, key=lambda each: each.score)[:_SHOWN]:
            structure = one.structure
            name = f"{structure.na}, {structure.nb}, {structure.delay}"
            second = "" if one.free_run is None else f"{one.free_run:.3%}"
            mark = "  chosen" if one is self.candidate else ""
            kind = "" if one.kind == "plain" else f"  {one.kind}"
            lines.append(f"{name:<24} {one.bic:10.1f} {one.nrmse:9.3%} {second:>9}{kind}{mark}")
        return lines


@dataclass(frozen=True, eq=False)
class StepResponse(Drawn):
    """Unit step responses for either direction of the output."""

    rising: LinearFit | None
    falling: LinearFit | None
    """``rising`` and ``falling``: fit of each direction; None if the record has no such step."""

    @property
    def models(self) -> tuple[Linear, Linear]:
        """Models for rising and falling outputs; the same model twice if one is missing."""
        up, down = self.rising or self.falling, self.falling or self.rising
        if up is None or down is None:
            raise ParameterError("there is no response; identify at least one direction")
        return up.model, down.model

    def __str__(self) -> str:
        lines = []
        for name, fit in (("rising", self.rising), ("falling", self.falling)):
            lines += [f"{name}:", "  no such step" if fit is None else str(fit)]
        return "\n".join(lines)

"""An experiment that chooses its own inputs: design, repetition of outliers, validation.

The next input depends only on the points so far. An experiment that was stopped therefore continues
as it would have without the stop.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Literal, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray, Levels, as_finite, as_seconds, as_whole, uniform_levels
from minorloop.errors import MinorloopError, ParameterError
from minorloop.identification.advising import fault_warnings
from minorloop.identification.bands import Prediction
from minorloop.identification.design import MOST_HOLDS, design, next_input
from minorloop.identification.fit import Plane
from minorloop.identification.plane_result import Identification
from minorloop.identification.prior import Gaussian, Prior
from minorloop.lab.records import Record
from minorloop.operators.memory import Memory, Start

_Role: TypeAlias = Literal["design", "outlier", "repeat", "validation"]

VALIDATION = 4
"""Holds at random levels at the end of an experiment; they are never fitted."""
REPEATS = 3
"""Additional holds at most, to repeat or replace outliers and missing readings."""
_PROBABILITY = 0.9
"""Probability of the bands that validation holds are checked against."""
_FIXED = 4
"""First holds, which are designed before anything is measured."""
_FITTED = ("design", "repeat")
"""Roles of points that are fitted."""
_FEWEST = 3
"""Least holds of a design."""


@dataclass(frozen=True)
class Validation:
    """Score of the model on holds that it was not fitted to."""

    prediction: Prediction
    """Outputs (n,) predicted for the validation holds."""
    measured: FloatArray
    """Shape (n,). Outputs of these holds."""
    scale: float
    """Range of all outputs that are not outliers."""

    @property
    def nrmse(self) -> float:
        """Root-mean-square error over the range of all measured outputs."""
        return float(np.sqrt(np.mean((self.prediction.y - self.measured) ** 2))) / self.scale

    @property
    def covered(self) -> int:
        """Number of outputs inside their bands."""
        return round(self.prediction.covers(self.measured) * self.measured.size)

    @property
    def trusted(self) -> bool:
        """Whether three quarters lie inside their bands and the rms error is below 3 deviations."""
        away = (self.prediction.y - self.measured) / self.prediction.sd
        # Validation passes with this share inside the bands, and this rms error in deviations
        inside = self.covered >= 0.75 * self.measured.size
        return inside and bool(np.sqrt(np.mean(away**2)) <= 3.0)


@dataclass(frozen=True)
class RunFindings:
    """Findings of an adaptive run: outliers, contradictions, validation and warnings."""

    holds: int
    """Holds that the model was fitted to."""
    outliers: tuple[int, ...]
    """Holds left out of the fit: not measured, or far outside their band."""
    repeated: tuple[int, ...]
    """Outliers that were measured again at once."""
    changes: tuple[int, ...]
    """Holds that contradict the model although their repetition agrees with them."""
    validation: Validation | None
    """Score on the holds that were never fitted; None where there are none yet."""
    warnings: tuple[str, ...]
    """Reasons not to trust the model."""


@dataclass
class Adaptive:
    """Choose the next input from the measurements so far.

    A reading that is missing or lies far outside its band is repeated at once. If the repetition
    agrees with the model, the first reading is an outlier and is left out. If it agrees with the
    first reading, both are fitted, the point is one of the ``changes``, and the bands are widened
    by the contradiction. A hold that later ones show to be an outlier is left out and replaced.

    Raises a `ParameterError` if an option is out of its range.

    Examples
    --------
    >>> chooser = Adaptive(-1.0, 1.0, levels=10, holds=6)
    >>> u, y = [], []
    >>> while (level := chooser.choose(u, y)) is not None:
    ...     u.append(level)
    ...     y.append(level**3)
    >>> len(u), chooser.validation(u, y).trusted
    (10, True)
    """

    low: float
    high: float
    """Range of the input."""
    levels: int = 20
    """Bands of the model."""
    holds: int = 12
    """Budget, without validation (4 holds) and repetitions (3 at most)."""
    step: float = float("inf")
    """Largest allowed change of the input."""
    least_gain: float = 0.0
    """Stop when the next hold is expected to reduce the standard deviation by less than this."""
    seed: int = 0
    """Seed of the levels of the validation."""
    noise: float | None = None
    """Standard deviation of a measured output, where it is known."""
    _fits: dict[bytes, Identification] = field(default_factory=dict, init=False, repr=False)
    _first: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        as_whole("holds", self.holds, _FEWEST, MOST_HOLDS)
        if not 0 <= as_finite("least_gain", self.least_gain) < 1:
            raise ParameterError(f"least_gain is {self.least_gain}; give a share from 0 to 1")
        self._first = design(self.grid, min(_FIXED, self.holds), step=self.step)

    @property
    def grid(self) -> Levels:
        """(L + 1,) thresholds."""
        return uniform_levels(self.low, self.high, self.levels)

    @property
    def law(self) -> Plane:
        """Law that the experiment was designed for."""
        return Plane(self.grid, diagonal="reversible", slope=False, lag=0)

    @property
    def most(self) -> int:
        """Largest number of holds of the experiment."""
        return self.holds + VALIDATION + REPEATS

    def choose(self, u: Sequence[float], y: Sequence[float]) -> float | None:
        """Return the next input; None when the experiment is complete.

        Parameters
        ----------
        u : (n,) array_like
            Inputs applied so far, in their unit.
        y : (n,) array_like
            Settled outputs; NaN where none was read.
        """
        progress = _Progress(self, u, y)
        if progress.repeat_next:
            return float(u[-1])
        if not progress.is_designed:
            following = progress.design(len(u))
            if following is not None:
                return following
        if progress.validated == VALIDATION:
            return None
        return self._validation_level(progress.validated, float(u[-1]))

    def roles(self, u: Sequence[float], y: Sequence[float]) -> list[_Role]:
        """Return the role of each point, u and y as of `choose`; an ``outlier`` is not fitted."""
        return _Progress(self, u, y).roles

    def changes(self, u: Sequence[float], y: Sequence[float]) -> list[int]:
        """Return the points that contradict the model although their repetition agrees with them.

        There the actuator or its sensor changed, or no Preisach model describes it. u and y are as
        of `choose`.
        """
        return sorted(_Progress(self, u, y).changes)

    def learn_noise(self, sd: Sequence[float]) -> None:
        """Estimate the noise from the standard deviations of the first settled outputs.

        Parameters
        ----------
        sd : (n,) array_like
            Standard deviations of settled outputs, in the unit of the output.
        """
        known = [value for value in sd[:_FIXED] if np.isfinite(value)]
        if known:
            self.noise = float(np.median(known))

    def identification(
        self,
        u: Sequence[float],
        y: Sequence[float],
        law: Plane | None = None,
        prior: Prior = "auto",
        start: Start = "negative",
    ) -> Identification:
        """Identify the model from the points to be fitted; validation points are held out.

        Parameters
        ----------
        u, y
            As of `choose`.
        law : Plane, optional
            Its fields that are not "auto" replace those that the experiment was designed for.
        prior : "auto", Gaussian or Smooth
            `Gaussian` if "auto".
        start : {"negative", "positive", "demagnetised"} or Memory
            Memory before the first point.
        """
        progress = _Progress(self, u, y)
        fit = progress.fit(len(u), law, prior, start)
        outputs = np.where(np.isfinite(y), y, np.nan)
        fitted = np.zeros(outputs.size, dtype=np.bool_)
        fitted[: fit.fitted.size] = fit.fitted
        held = np.array([role == "validation" for role in progress.roles]) & np.isfinite(outputs)
        return replace(fit, u=np.array(u), y=outputs, fitted=fitted, held_out=held)

    def validation(self, u: Sequence[float], y: Sequence[float]) -> Validation | None:
        """Return the score on the validation points, None without any; u and y as of `choose`."""
        if "validation" not in self.roles(u, y):
            return None
        fit = self.identification(u, y)
        held = fit.held_out
        if not held.any():
            return None
        whole = fit.predict(fit.u, bands=_PROBABILITY)
        part = replace(whole, u=whole.u[held], y=whole.y[held], sd=whole.sd[held])
        scale = float(np.ptp(fit.y[fit.fitted | held])) or 1.0
        return Validation(part, fit.y[held], scale)

    def findings(self, u: Sequence[float], y: Sequence[float]) -> RunFindings:
        """Return the findings from the points; u and y as of `choose`."""
        roles = self.roles(u, y)
        outliers = [k for k, role in enumerate(roles) if role == "outlier"]
        validation = self.validation(u, y)
        return RunFindings(
            holds=sum(role in _FITTED for role in roles),
            outliers=tuple(outliers),
            repeated=tuple(k for k in outliers if k + 1 < len(u) and u[k] == u[k + 1]),
            changes=tuple(self.changes(u, y)),
            validation=validation,
            warnings=tuple(self._warnings(u, y, validation)),
        )

    def _warnings(
        self, u: Sequence[float], y: Sequence[float], validation: Validation | None
    ) -> list[str]:
        """Return reasons not to trust the model; one sentence each."""
        said = [
            f"hold {k + 1} contradicts the model, and its repetition gave the same: the actuator "
            f"or its sensor changed at about hold {k + 1}, or a Preisach model cannot follow it; "
            "the bands are widened by this contradiction"
            for k in self.changes(u, y)
        ]
        if validation is not None and not validation.trusted:
            said.append(
                f"do not trust this model: {validation.covered} of {validation.measured.size} "
                "validation holds lie within their 90 % bands, with an error of "
                f"{validation.nrmse:.2%} of range"
            )
        try:
            return [*said, *fault_warnings(self.identification(u, y))]
        except MinorloopError:
            return said  # Too few points for a model yet.

    def _validation_level(self, index: int, now: float) -> float:
        """Random level in one quarter of the range, at most a step from the present level."""
        shares = np.random.default_rng(self.seed).uniform(size=VALIDATION)
        # Quarters of the range in an order that reverses the input at every validation hold
        part = ((2, 0, 3, 1)[index] + shares[index]) / VALIDATION
        level = self.low + part * (self.high - self.low)
        return float(np.clip(level, now - self.step, now + self.step))


class _Progress:
    """State of an experiment after some points, updated point by point.

    ``designed`` and ``validated`` count the holds of design and validation, ``extra`` repetitions
    and replacements, ``replaced`` the replacements alone. ``changes`` maps points whose repetition
    agreed with them to their deviation from the model. ``repeat_next``: the next point repeats the
    last. ``validating``: the design is complete.
    """

    def __init__(self, of: Adaptive, u: Sequence[float], y: Sequence[float]) -> None:
        self.of = of
        self.u, self.y = np.array(u, dtype=np.float64), np.array(y, dtype=np.float64)
        self.roles: list[_Role] = []
        self.designed = self.validated = self.extra = self.replaced = 0
        self.changes: dict[int, float] = {}
        self.repeat_next = self.validating = False
        for k in range(len(u)):
            if self.repeat_next:
                self._repeated(k)
            else:
                self._measured(k)
            self._find_outliers(k + 1)

    @property
    def is_designed(self) -> bool:
        """Whether the holds of the design are complete."""
        return self.validating or self.designed >= self.of.holds + self.replaced

    def design(self, count: int) -> float | None:
        """Return the input that follows the first points; None if it gains too little."""
        first = self.of._first
        if self.designed < first.size:
            return float(first[self.designed])
        memory = Memory.after(self.u[:count], low=self.of.low, high=self.of.high)
        found = next_input(self.fit(count), memory, step=self.of.step)
        return None if found.gain < self.of.least_gain else found.u

    def fit(
        self, count: int, law: Plane | None = None, prior: Prior = "auto", start: Start = "negative"
    ) -> Identification:
        """Identify the model from the first points, whose roles are known; results are cached."""
        kept = [k for k in range(count) if self.roles[k] in _FITTED]
        last = max(kept, default=-1) + 1
        outputs = np.full(last, np.nan)
        outputs[kept] = self.y[kept]
        inputs = self.u[:last].copy()
        given = {} if law is None else {one.name: getattr(law, one.name) for one in fields(law)}
        known = {name: x for name, x in given.items() if not (isinstance(x, str) and x == "auto")}
        used = replace(self.of.law, **known)
        prior = Gaussian() if prior == "auto" else prior
        key = inputs.tobytes() + outputs.tobytes()
        key += repr((self.of.noise, used, prior, start)).encode()
        if key not in self.of._fits:
            record = Record(inputs, outputs, sd=self.of.noise, start=start)
            self.of._fits[key] = used.fit(record, prior)
        return _with_wider_bands(self.of._fits[key], self.changes)

    def _measured(self, k: int) -> None:
        """Set the role of a point that does not repeat the previous point."""
        early = self.of.least_gain > 0 and self.designed >= self.of._first.size
        self.validating = self.is_designed or (early and self.design(k) is None)
        role: _Role = "validation" if self.validating else "design"
        self.validated += self.validating
        self.designed += not self.validating
        if self._is_doubtful(k):
            role, self.repeat_next = "outlier", self.extra < REPEATS
        self.roles.append(role)

    def _repeated(self, k: int) -> None:
        """Set the role of a point that repeats the previous point."""
        self.extra += 1
        measured = bool(np.isfinite(self.y[k]))
        self.repeat_next = not measured and self.extra < REPEATS
        if not measured:
            self.roles.append("outlier")
            return
        if np.isfinite(self.y[k - 1]):
            away, apart = self._deviation(k - 1)[0], self.y[k] - self.y[k - 1]
            if abs(apart) < abs(apart + away):
                self.changes[k - 1] = abs(away)
                if not self.validating:
                    self.roles[-1] = "design"
        self.roles.append("validation" if self.validating else "repeat")

    def _find_outliers(self, count: int) -> None:
        """Leave out earlier points that now turn out to be outliers, and replace them."""
        if self.validating or self.repeat_next or self.extra == REPEATS or self._too_few():
            return
        for k in self.fit(count).suspects:
            sure = k in self.changes or self.roles[k] != "design"
            if not sure and self.extra < REPEATS:
                self.roles[k] = "outlier"
                self.extra += 1
                self.replaced += 1

    def _is_doubtful(self, k: int) -> bool:
        """Whether a reading is missing, or far outside its band and can be repeated."""
        if not np.isfinite(self.y[k]):
            return True
        if self._too_few() or self.extra == REPEATS:
            return False
        away, allowed = self._deviation(k)
        # Standard deviations from its prediction at which a reading is repeated
        return abs(away) > 6.0 * allowed

    def _too_few(self) -> bool:
        # Points that are fitted before a reading can be called an outlier
        return sum(role in _FITTED for role in self.roles) < 6

    def _deviation(self, k: int) -> tuple[float, float]:
        """Deviation of a point from its prediction by earlier points, and that expected."""
        shown = self.fit(k).predict(self.u[: k + 1], bands=_PROBABILITY)
        return float(self.y[k] - shown.y[-1]), float(shown.sd[-1])


def _with_wider_bands(fit: Identification, changes: dict[int, float]) -> Identification:
    """Raise the discrepancy to the rms deviation of the points that contradict the model."""
    if fit.posterior is None or not changes:
        return fit
    posterior, h = fit.posterior, fit.posterior.hyperparameters
    away = float(np.sqrt(np.mean(np.square(list(changes.values()))))) / posterior.unit
    widened = replace(h, discrepancy=max(h.discrepancy, away))
    return replace(fit, posterior=replace(posterior, hyperparameters=widened))


def design_holds(holds: int | None, hours: float | None, hold: float) -> int:
    """Return the number of holds of a budget that the design may choose.

    Raises a `ParameterError` if both or neither are given, or they allow less than 3 holds or more
    than 1000.

    ``holds``: holds to choose, without validation and repetitions; ``hours``: time for all holds,
    validation and repetitions included; ``hold``: longest hold, in seconds.
    """
    if holds is not None and hours is None:
        return as_whole("holds", holds, _FEWEST, MOST_HOLDS)
    if holds is not None or hours is None:
        raise ParameterError("give a budget either in holds or in hours")
    more = VALIDATION + REPEATS
    seconds = as_seconds("hold", hold)
    count = int(as_finite("hours", hours) * 3600 / seconds)
    if not _FEWEST <= count - more <= MOST_HOLDS:
        raise ParameterError(
            f"{hours:g} h are {max(count, 0)} holds of {seconds:g} s; {VALIDATION} of them are for "
            f"validation and {REPEATS} for repetitions; give "
            f"{(_FEWEST + more) * seconds / 3600:.3g} h or more, for at most {MOST_HOLDS} holds"
        )
    return count - more

"""An experiment that chooses its own inputs: design, repetition of outliers, validation.

The next input is a function of the points so far and nothing else. An experiment that was stopped
therefore continues as it would have without the stop.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Literal, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray, Levels, as_finite, uniform_levels
from minorloop.errors import ParameterError
from minorloop.identification.bands import Prediction
from minorloop.identification.design import budget, design, next_input
from minorloop.identification.fit import Plane
from minorloop.identification.regularisation import Gaussian, Prior
from minorloop.identification.result import Identification
from minorloop.lab.records import Record
from minorloop.operators.memory import Memory, Start

Role: TypeAlias = Literal["design", "outlier", "repeat", "validation"]

VALIDATION = 4
"""Holds at random levels at the end of an experiment; they are never fitted."""
REPEATS = 3
"""Additional holds at most, to repeat or replace outliers and missing readings."""
PROBABILITY = 0.9
"""Probability of the bands that validation holds are checked against."""
_FIXED = 4
"""First holds, which are designed before anything is measured."""
_BEFORE_CHECKS = 6
"""Points that are fitted before a reading can be called an outlier."""
_OUTLIER_DEVIATIONS = 6.0
"""Standard deviations from its prediction at which a reading is repeated."""
_LEAST_INSIDE = 0.75
_MOST_RMS = 3.0
"""Validation passes with this share inside the bands, and this rms error in deviations."""
_PART_ORDER = (2, 0, 3, 1)
"""Order in which validation visits the quarters of the range, so that it reverses every time."""


@dataclass(frozen=True)
class Validation:
    """Score of the model on holds that it was not fitted to."""

    prediction: Prediction
    """Of the validation holds, (n,)."""
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
        inside = self.covered >= _LEAST_INSIDE * self.measured.size
        return inside and bool(np.sqrt(np.mean(away**2)) <= _MOST_RMS)


@dataclass
class _Progress:
    """State of an experiment.

    ``designed`` and ``validated`` count the holds of design and validation, ``extra`` repetitions
    and replacements, ``replaced`` the replacements alone. ``changes`` are the deviations from the
    model of points whose repetition agreed with them. ``repeat_next``: the last point is to be
    repeated. ``validating``: the design is complete.
    """

    roles: list[Role] = field(default_factory=list)
    designed: int = 0
    validated: int = 0
    extra: int = 0
    replaced: int = 0
    changes: dict[int, float] = field(default_factory=dict)
    repeat_next: bool = False
    validating: bool = False


@dataclass
class Adaptive:
    """Choose the next input from the measurements so far.

    A reading that is missing or lies far outside its band is repeated at once. If the repetition
    agrees with the model, the first reading is an outlier and is left out. If it agrees with the
    first reading, both are fitted, the point is one of the ``changes``, and the bands are widened
    by the contradiction. A hold that later ones show to be an outlier is left out and replaced.

    Raises
    ------
    ParameterError
        If an option is out of its range.

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
    _fits: dict[bytes, Identification] = field(default_factory=dict, repr=False)
    _first: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        budget(self.holds, None, 1.0)
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
        progress = self._progress(u, y)
        if progress.repeat_next:
            return float(u[-1])
        if not self._is_designed(progress):
            following = self._design(u, y, progress)
            if following is not None:
                return following
        if progress.validated == VALIDATION:
            return None
        return self._validation_level(progress.validated, float(u[-1]))

    def roles(self, u: Sequence[float], y: Sequence[float]) -> list[Role]:
        """Return the role of each point, u and y as of `choose`; an ``outlier`` is not fitted."""
        return self._progress(u, y).roles

    def changes(self, u: Sequence[float], y: Sequence[float]) -> list[int]:
        """Return the points that contradict the model although their repetition agrees with them.

        There the actuator or its sensor changed, or no Preisach model describes it. u and y are as
        of `choose`.
        """
        return sorted(self._progress(u, y).changes)

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
            What is not "auto" in it is used instead of what the experiment was designed for.
        prior : "auto", Gaussian or Smooth
            `Gaussian` if "auto".
        start : {"negative", "positive", "demagnetised"} or Memory
            Memory before the first point.
        """
        progress = self._progress(u, y)
        fit = self._fit(u, y, progress, law, prior, start)
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
        whole = fit.predict(fit.u, bands=PROBABILITY)
        part = replace(whole, u=whole.u[held], y=whole.y[held], sd=whole.sd[held])
        scale = float(np.ptp(fit.y[fit.fitted | held])) or 1.0
        return Validation(part, fit.y[held], scale)

    def _progress(self, u: Sequence[float], y: Sequence[float]) -> _Progress:
        progress = _Progress()
        for k in range(len(u)):
            if progress.repeat_next:
                self._repeated(u[: k + 1], y[: k + 1], progress)
            else:
                self._measured(u[: k + 1], y[: k + 1], progress)
            self._find_outliers(u[: k + 1], y[: k + 1], progress)
        return progress

    def _measured(self, u: Sequence[float], y: Sequence[float], progress: _Progress) -> None:
        """Set the role of the last point, which is no repetition."""
        progress.validating = self._is_designed(progress) or self._stopped_early(u, y, progress)
        role: Role = "validation" if progress.validating else "design"
        progress.validated += progress.validating
        progress.designed += not progress.validating
        if self._is_doubtful(u, y, progress):
            role, progress.repeat_next = "outlier", progress.extra < REPEATS
        progress.roles.append(role)

    def _repeated(self, u: Sequence[float], y: Sequence[float], progress: _Progress) -> None:
        """Set the role of the last point, which repeats the one before."""
        progress.extra += 1
        progress.repeat_next = not np.isfinite(y[-1]) and progress.extra < REPEATS
        if not np.isfinite(y[-1]):
            progress.roles.append("outlier")
            return
        if np.isfinite(y[-2]):
            away = self._deviation(u[:-1], y[:-1], progress)[0]
            if abs(y[-1] - y[-2]) < abs(y[-1] - y[-2] + away):
                progress.changes[len(u) - 2] = abs(away)
                if not progress.validating:
                    progress.roles[-1] = "design"
        progress.roles.append("validation" if progress.validating else "repeat")

    def _find_outliers(self, u: Sequence[float], y: Sequence[float], progress: _Progress) -> None:
        """Leave out earlier points that now turn out to be outliers, and replace them."""
        if progress.validating or progress.repeat_next or progress.extra == REPEATS:
            return
        if sum(role in ("design", "repeat") for role in progress.roles) < _BEFORE_CHECKS:
            return
        for k in self._fit(u, y, progress).suspects:
            sure = k in progress.changes or progress.roles[k] != "design"
            if not sure and progress.extra < REPEATS:
                progress.roles[k] = "outlier"
                progress.extra += 1
                progress.replaced += 1

    def _is_doubtful(self, u: Sequence[float], y: Sequence[float], progress: _Progress) -> bool:
        """Whether the last reading is missing, or far outside its band and can be repeated."""
        if not np.isfinite(y[-1]):
            return True
        known = sum(role in ("design", "repeat") for role in progress.roles)
        if known < _BEFORE_CHECKS or progress.extra == REPEATS:
            return False
        away, allowed = self._deviation(u, y, progress)
        return abs(away) > _OUTLIER_DEVIATIONS * allowed

    def _deviation(
        self, u: Sequence[float], y: Sequence[float], progress: _Progress
    ) -> tuple[float, float]:
        """Error of the prediction of the last point from those before, and its deviation."""
        before = len(u) - 1
        fit = self._fit(u[:before], y[:before], progress)
        shown = fit.predict(np.array(u), bands=PROBABILITY)
        return float(y[-1] - shown.y[-1]), float(shown.sd[-1])

    def _is_designed(self, progress: _Progress) -> bool:
        return progress.validating or progress.designed >= self.holds + progress.replaced

    def _stopped_early(self, u: Sequence[float], y: Sequence[float], progress: _Progress) -> bool:
        """Whether the design ended early, before the last point."""
        if self.least_gain == 0 or progress.designed < self._first.size:
            return False
        return self._next(u[:-1], y[:-1], progress) is None

    def _design(self, u: Sequence[float], y: Sequence[float], progress: _Progress) -> float | None:
        if progress.designed < self._first.size:
            return float(self._first[progress.designed])
        return self._next(u, y, progress)

    def _next(self, u: Sequence[float], y: Sequence[float], progress: _Progress) -> float | None:
        memory = Memory.after(u, low=self.low, high=self.high)
        found = next_input(self._fit(u, y, progress), memory, step=self.step)
        return None if found.gain < self.least_gain else found.u

    def _fit(
        self,
        u: Sequence[float],
        y: Sequence[float],
        progress: _Progress,
        law: Plane | None = None,
        prior: Prior = "auto",
        start: Start = "negative",
    ) -> Identification:
        """Identify the model from the points whose roles are known; results are cached."""
        kept = [k for k in range(len(u)) if progress.roles[k] in ("design", "repeat")]
        last = max(kept, default=-1) + 1
        outputs = np.full(last, np.nan)
        outputs[kept] = np.array(y, dtype=np.float64)[kept]
        inputs = np.array(u[:last], dtype=np.float64)
        given = {} if law is None else {one.name: getattr(law, one.name) for one in fields(law)}
        used = replace(self.law, **{k: v for k, v in given.items() if not _is_auto(v)})
        prior = Gaussian() if prior == "auto" else prior
        key = inputs.tobytes() + outputs.tobytes()
        key += repr((self.noise, used, prior, start)).encode()
        if key not in self._fits:
            record = Record(inputs, outputs, sd=self.noise, start=start)
            self._fits[key] = used.fit(record, prior)
        return _with_wider_bands(self._fits[key], progress.changes)

    def _validation_level(self, index: int, now: float) -> float:
        """Random level in one quarter of the range, at most a step from the present one."""
        shares = np.random.default_rng(self.seed).uniform(size=VALIDATION)
        part = (_PART_ORDER[index] + shares[index]) / VALIDATION
        level = self.low + part * (self.high - self.low)
        return float(np.clip(level, now - self.step, now + self.step))


def _is_auto(value: object) -> bool:
    return isinstance(value, str) and value == "auto"


def _with_wider_bands(fit: Identification, changes: dict[int, float]) -> Identification:
    """Raise the discrepancy to the rms deviation of the points that contradict the model."""
    if fit.posterior is None or not changes:
        return fit
    posterior, h = fit.posterior, fit.posterior.hyperparameters
    away = float(np.sqrt(np.mean(np.square(list(changes.values()))))) / posterior.unit
    widened = replace(h, discrepancy=max(h.discrepancy, away))
    return replace(fit, posterior=replace(posterior, hyperparameters=widened))

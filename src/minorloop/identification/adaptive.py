"""An experiment that chooses its own inputs: design, repetition of what was knocked, validation.

What comes next follows from the points so far and from nothing else, so that an experiment that
was stopped goes on as it would have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray, Levels, as_finite, uniform_levels
from minorloop.errors import ParameterError
from minorloop.identification.bands import Prediction
from minorloop.identification.design import budget, design, next_input
from minorloop.identification.fit import identify
from minorloop.identification.result import Identification
from minorloop.operators.memory import Memory

Role: TypeAlias = Literal["design", "knocked", "repeat", "validation"]

VALIDATION = 4
"""Holds at random levels that close an experiment and are never fitted."""
REPEATS = 3
"""Further holds that an experiment may spend on what was knocked or not measured."""
PROBABILITY = 0.9
_FIRST = 4
_BEFORE_DOUBT = 6
_FAR = 6.0

_INSIDE = 0.75
_TOO_FAR = 3.0
_ORDER = (2, 0, 3, 1)


@dataclass(frozen=True)
class Validation:
    """How the model did on holds that it was not fitted to.

    Parameters
    ----------
    prediction : Prediction
        Of the validation holds, (n,).
    measured : (n,) array
        What they gave.
    scale : float
        Range of all that was measured and not set aside.
    noise : float
        Standard deviation of a measured output.
    """

    prediction: Prediction
    measured: FloatArray
    scale: float
    noise: float = 0.0

    @property
    def nrmse(self) -> float:
        """Root-mean-square error over the range of all that was measured."""
        return float(np.sqrt(np.mean((self.prediction.y - self.measured) ** 2))) / self.scale

    @property
    def covered(self) -> int:
        """How many lie within their bands, which the noise of the sensor widens."""
        seen = replace(self.prediction, sd=self._allowed)
        return round(seen.covers(self.measured) * self.measured.size)

    @property
    def trusted(self) -> bool:
        """Whether three quarters lie within their bands, and no error is far above these."""
        away = (self.prediction.y - self.measured) / self._allowed
        inside = self.covered >= _INSIDE * self.measured.size
        return inside and bool(np.sqrt(np.mean(away**2)) <= _TOO_FAR)

    @property
    def _allowed(self) -> FloatArray:
        return np.hypot(self.prediction.sd, self.noise)


@dataclass
class _Course:
    """What became of an experiment so far.

    ``fresh`` and ``tested`` count design and validation without repetitions, ``spent`` what went
    on repetitions and on holds that make up for knocked ones, ``made_up`` the latter alone;
    ``changes`` are distances from the model of points whose repetition gave the same;
    ``pending``: the last is to be repeated; ``closing``: the design is over.
    """

    roles: list[Role] = field(default_factory=list)
    fresh: int = 0
    tested: int = 0
    spent: int = 0
    made_up: int = 0
    changes: dict[int, float] = field(default_factory=dict)
    pending: bool = False
    closing: bool = False


@dataclass
class Adaptive:
    """What to measure next, and what the measurements say.

    A reading that is missing or lies far outside its band is measured again at once. Where the
    repetition gives what was expected, the first reading was knocked and is left out. Where it
    gives the same again, both are fitted, the point is among the ``changes``, and the bands are
    widened by the contradiction. A hold of which later ones show that it was knocked is left out,
    and made up for by another.

    Parameters
    ----------
    low, high : float
        Range of the input.
    levels : int
        Bands of the model.
    holds : int
        Budget; the holds of the validation (4) and repetitions (3 at most) not counted.
    step : float
        Largest change of the input that is allowed.
    least_gain : float
        Stop when the next hold is expected to take less than this share off the standard
        deviation.
    seed : int
        Draws the levels of the validation.
    noise : float, optional
        Standard deviation of a measured output, where it is known.

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
    levels: int = 20
    holds: int = 12
    step: float = float("inf")
    least_gain: float = 0.0
    seed: int = 0
    noise: float | None = None
    _fits: dict[bytes, Identification] = field(default_factory=dict, repr=False)
    _first: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        budget(self.holds, None, 1.0)
        if not 0 <= as_finite("least_gain", self.least_gain) < 1:
            raise ParameterError(f"least_gain is {self.least_gain}; give a share from 0 to 1")
        self._first = design(self.grid, min(_FIRST, self.holds), step=self.step)

    @property
    def grid(self) -> Levels:
        """(L + 1,) thresholds."""
        return uniform_levels(self.low, self.high, self.levels)

    @property
    def settings(self) -> dict[str, Any]:
        """Options of `identify` that the experiment was designed for."""
        return {
            "levels": self.grid,
            "prior": "gaussian",
            "diagonal": "reversible",
            "noise": self.noise,
        }

    @property
    def most(self) -> int:
        """Holds that the experiment takes at most."""
        return self.holds + VALIDATION + REPEATS

    def choose(self, u: Sequence[float], y: Sequence[float]) -> float | None:
        """The next input after inputs u and settled outputs y; None when there are enough.

        Parameters
        ----------
        u : (n,) array_like
            Inputs applied so far, in their unit.
        y : (n,) array_like
            Settled outputs; NaN where none was read.
        """
        course = self._course(u, y)
        if course.pending:
            return float(u[-1])
        if not self._over(course):
            following = self._design(u, y, course)
            if following is not None:
                return following
        if course.tested == VALIDATION:
            return None
        return self._validation_level(course.tested, float(u[-1]))

    def roles(self, u: Sequence[float], y: Sequence[float]) -> list[Role]:
        """What each point is for; ``knocked`` ones are not fitted.

        Parameters
        ----------
        u : (n,) array_like
            Inputs applied so far, in their unit.
        y : (n,) array_like
            Settled outputs; NaN where none was read.
        """
        return self._course(u, y).roles

    def changes(self, u: Sequence[float], y: Sequence[float]) -> list[int]:
        """Points that contradict the model though their repetition gave the same.

        About there the actuator or its sensor changed, or no such model follows it.

        Parameters
        ----------
        u : (n,) array_like
            Inputs applied so far, in their unit.
        y : (n,) array_like
            Settled outputs; NaN where none was read.
        """
        return sorted(self._course(u, y).changes)

    def learn_noise(self, sd: Sequence[float]) -> None:
        """Take the noise from the standard deviations of the first settled outputs.

        Parameters
        ----------
        sd : (n,) array_like
            Standard deviations of settled outputs, in the unit of the output.
        """
        known = [value for value in sd[:_FIRST] if np.isfinite(value)]
        if known:
            self.noise = float(np.median(known))

    def identification(
        self, u: Sequence[float], y: Sequence[float], **options: Any
    ) -> Identification:
        """The model of the points that are there to be fitted; those of the validation held out.

        ``options`` of `identify` take the place of those of the experiment.

        Parameters
        ----------
        u : (n,) array_like
            Inputs applied so far, in their unit.
        y : (n,) array_like
            Settled outputs; NaN where none was read.
        **options
            Further ones of `identify`.
        """
        course = self._course(u, y)
        fit = self._fit(u, y, course, **options)
        outputs = np.where(np.isfinite(y), y, np.nan)
        fitted = np.zeros(outputs.size, dtype=np.bool_)
        fitted[: fit.fitted.size] = fit.fitted
        held = np.array([role == "validation" for role in course.roles]) & np.isfinite(outputs)
        return replace(fit, u=np.array(u), y=outputs, fitted=fitted, held_out=held)

    def validation(self, u: Sequence[float], y: Sequence[float]) -> Validation | None:
        """The score on the points that were not fitted; None where there are none yet.

        Parameters
        ----------
        u : (n,) array_like
            Inputs applied so far, in their unit.
        y : (n,) array_like
            Settled outputs; NaN where none was read.
        """
        if "validation" not in self.roles(u, y):
            return None
        fit = self.identification(u, y)
        held = fit.held_out
        if not held.any():
            return None
        assert fit.belief is not None
        whole = fit.predict(fit.u, bands=PROBABILITY)
        part = Prediction(whole.u[held], whole.y[held], whole.sd[held], PROBABILITY)
        scale = float(np.ptp(fit.y[fit.fitted | held])) or 1.0
        noise = fit.belief.hyperparameters.noise * fit.belief.unit
        return Validation(part, fit.y[held], scale, noise)

    def _course(self, u: Sequence[float], y: Sequence[float]) -> _Course:
        course = _Course()
        for k in range(len(u)):
            if course.pending:
                self._repeated(u[: k + 1], y[: k + 1], course)
            else:
                self._measured(u[: k + 1], y[: k + 1], course)
            self._look_back(u[: k + 1], y[: k + 1], course)
        return course

    def _measured(self, u: Sequence[float], y: Sequence[float], course: _Course) -> None:
        """Say what the last point is for, which is no repetition."""
        course.closing = self._over(course) or self._stopped(u, y, course)
        role: Role = "validation" if course.closing else "design"
        course.tested += course.closing
        course.fresh += not course.closing
        if self._doubtful(u, y, course):
            role, course.pending = "knocked", course.spent < REPEATS
        course.roles.append(role)

    def _repeated(self, u: Sequence[float], y: Sequence[float], course: _Course) -> None:
        """Say what the last point is for, which repeats the one before."""
        course.spent += 1
        course.pending = not np.isfinite(y[-1]) and course.spent < REPEATS
        if not np.isfinite(y[-1]):
            course.roles.append("knocked")
            return
        if np.isfinite(y[-2]):
            away = self._away(u[:-1], y[:-1], course)[0]
            if abs(y[-1] - y[-2]) < abs(y[-1] - y[-2] + away):
                course.changes[len(u) - 2] = abs(away)
                if not course.closing:
                    course.roles[-1] = "design"
        course.roles.append("validation" if course.closing else "repeat")

    def _look_back(self, u: Sequence[float], y: Sequence[float], course: _Course) -> None:
        """Leave out what was knocked before enough was known to see it, and make up for it."""
        if course.closing or course.pending or course.spent == REPEATS:
            return
        if sum(role in ("design", "repeat") for role in course.roles) < _BEFORE_DOUBT:
            return
        for k in self._fit(u, y, course).suspects:
            sure = k in course.changes or course.roles[k] != "design"
            if not sure and course.spent < REPEATS:
                course.roles[k] = "knocked"
                course.spent += 1
                course.made_up += 1

    def _doubtful(self, u: Sequence[float], y: Sequence[float], course: _Course) -> bool:
        """Whether nothing was measured, or what lies far outside its band and can be repeated."""
        if not np.isfinite(y[-1]):
            return True
        known = sum(role in ("design", "repeat") for role in course.roles)
        if known < _BEFORE_DOUBT or course.spent == REPEATS:
            return False
        away, allowed = self._away(u, y, course)
        return abs(away) > _FAR * allowed

    def _away(self, u: Sequence[float], y: Sequence[float], course: _Course) -> tuple[float, float]:
        """The last point less its prediction by those before, and the deviation of that."""
        before = len(u) - 1
        fit = self._fit(u[:before], y[:before], course)
        assert fit.belief is not None
        shown = fit.predict(np.array(u), bands=PROBABILITY)
        noise = fit.belief.hyperparameters.noise * fit.belief.unit
        return float(y[-1] - shown.y[-1]), float(np.hypot(shown.sd[-1], noise))

    def _over(self, course: _Course) -> bool:
        return course.closing or course.fresh >= self.holds + course.made_up

    def _stopped(self, u: Sequence[float], y: Sequence[float], course: _Course) -> bool:
        """Whether the design had ended early before the last point."""
        if self.least_gain == 0 or course.fresh < self._first.size:
            return False
        return self._next(u[:-1], y[:-1], course) is None

    def _design(self, u: Sequence[float], y: Sequence[float], course: _Course) -> float | None:
        if course.fresh < self._first.size:
            return float(self._first[course.fresh])
        return self._next(u, y, course)

    def _next(self, u: Sequence[float], y: Sequence[float], course: _Course) -> float | None:
        memory = Memory.after(u, low=self.low, high=self.high)
        found = next_input(self._fit(u, y, course), memory, step=self.step)
        return None if found.gain < self.least_gain else found.u

    def _fit(
        self, u: Sequence[float], y: Sequence[float], course: _Course, **options: Any
    ) -> Identification:
        """The model of these points, as far as their roles are known."""
        kept = [k for k in range(len(u)) if course.roles[k] in ("design", "repeat")]
        last = max(kept, default=-1) + 1
        outputs = np.full(last, np.nan)
        outputs[kept] = np.array(y, dtype=np.float64)[kept]
        inputs = np.array(u[:last], dtype=np.float64)
        key = inputs.tobytes() + outputs.tobytes() + repr((self.noise, options)).encode()
        if key not in self._fits:
            self._fits[key] = identify(inputs, outputs, **{**self.settings, **options})
        return _widened(self._fits[key], course.changes)

    def _validation_level(self, index: int, now: float) -> float:
        """A random level of a part of the range, within the step of the present one."""
        shares = np.random.default_rng(self.seed).uniform(size=VALIDATION)
        part = (_ORDER[index] + shares[index]) / VALIDATION
        level = self.low + part * (self.high - self.low)
        return float(np.clip(level, now - self.step, now + self.step))


def _widened(fit: Identification, changes: dict[int, float]) -> Identification:
    """With a discrepancy that accounts for what contradicted the model and was repeated."""
    if fit.belief is None or not changes:
        return fit
    belief, h = fit.belief, fit.belief.hyperparameters
    away = float(np.sqrt(np.mean(np.square(list(changes.values()))))) / belief.unit
    widened = replace(h, discrepancy=max(h.discrepancy, away))
    return replace(fit, belief=replace(belief, hyperparameters=widened))

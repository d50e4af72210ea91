"""An experiment that chooses its own inputs: design, repetition of what was knocked, validation.

What comes next follows from the points so far and from nothing else, so that an experiment that
was stopped goes on as it would have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

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
"""Repetitions of a hold that an experiment may spend."""
PROBABILITY = 0.9
_FIRST = 4
_BEFORE_DOUBT = 6
_FAR = 6.0


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
        Range of all that was measured.
    """

    prediction: Prediction
    measured: FloatArray
    scale: float

    @property
    def nrmse(self) -> float:
        """Root-mean-square error over the range of all that was measured."""
        return float(np.sqrt(np.mean((self.prediction.y - self.measured) ** 2))) / self.scale

    @property
    def covered(self) -> int:
        """How many lie within their bands."""
        return round(self.prediction.covers(self.measured) * self.measured.size)


@dataclass
class Adaptive:
    """What to measure next, and what the measurements say.

    Parameters
    ----------
    low, high : float
        Range of the input.
    levels : int
        Bands of the model.
    holds : int
        Budget, validation not counted.
    step : float
        Largest change of the input that is allowed.
    least_gain : float
        Stop when the next hold is expected to take less than this share off the standard
        deviation.
    seed : int
        Draws the levels of the validation.

    Raises
    ------
    ParameterError
        If an option is out of its range.
    """

    low: float
    high: float
    levels: int = 20
    holds: int = 12
    step: float = float("inf")
    least_gain: float = 0.0
    seed: int = 0
    _fits: dict[int, Identification] = field(default_factory=dict, repr=False)
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
    def most(self) -> int:
        """Holds that the experiment takes at most."""
        return self.holds + VALIDATION + REPEATS

    def choose(self, u: Sequence[float], y: Sequence[float]) -> float | None:
        """The next input after inputs u and settled outputs y; None when there are enough."""
        roles = self.roles(u, y)
        designed = roles.count("design")
        if roles and roles[-1] == "knocked":
            return u[-1]
        spent = roles.count("validation")
        if not spent and designed < self.holds:
            following = self._design(u, y, designed)
            if following is not None:
                return following
        if spent == VALIDATION:
            return None
        return float(self._validation_levels(u[: len(u) - spent])[spent])

    def roles(self, u: Sequence[float], y: Sequence[float]) -> list[Role]:
        """What each point is for; ``knocked`` ones are not fitted."""
        roles: list[Role] = []
        for k in range(len(u)):
            roles.append(self._role(u[: k + 1], y[: k + 1], roles))
            if roles[-1] == "repeat" and self._agrees(y[: k + 1], u[: k + 1], roles):
                roles[-2] = roles[-1] = "design"
        return roles

    def identification(self, u: Sequence[float], y: Sequence[float]) -> Identification:
        """The model of the points that are there to be fitted."""
        roles = self.roles(u, y)
        last = max((k for k, role in enumerate(roles) if role != "validation"), default=-1) + 1
        return self._fit(u[:last], y[:last], roles[:last])

    def validation(self, u: Sequence[float], y: Sequence[float]) -> Validation | None:
        """The score on the points that were not fitted; None where there are none yet."""
        roles = self.roles(u, y)
        held = np.array([role == "validation" for role in roles])
        if not held.any():
            return None
        whole = self.identification(u, y).predict(np.array(u), bands=PROBABILITY)
        part = Prediction(whole.u[held], whole.y[held], whole.sd[held], PROBABILITY)
        values = np.array(y, dtype=np.float64)
        return Validation(part, values[held], float(np.nanmax(values) - np.nanmin(values)) or 1.0)

    def _design(self, u: Sequence[float], y: Sequence[float], count: int) -> float | None:
        if count < self._first.size:
            return float(self._first[count])
        return self._next(u, y, self.roles(u, y))

    def _next(self, u: Sequence[float], y: Sequence[float], roles: Sequence[Role]) -> float | None:
        memory = Memory.after(u, low=self.low, high=self.high)
        found = next_input(self._fit(u, y, roles), memory, step=self.step)
        return None if found.gain < self.least_gain else found.u

    def _role(self, u: Sequence[float], y: Sequence[float], before: list[Role]) -> Role:
        """What the last point is for."""
        if before and before[-1] == "knocked":
            return "repeat"
        if "validation" in before or before.count("design") == self.holds:
            return "validation"
        if self._stopped(u, y, before):
            return "validation"
        if len(before) < _BEFORE_DOUBT or before.count("knocked") == REPEATS:
            return "design"
        return "knocked" if self._surprise(u, y, before) > _FAR else "design"

    def _stopped(self, u: Sequence[float], y: Sequence[float], before: list[Role]) -> bool:
        """Whether the design had ended early before the last point."""
        count = before.count("design")
        if self.least_gain == 0 or count < self._first.size:
            return False
        return self._next(u[:-1], y[:-1], before) is None

    def _surprise(self, u: Sequence[float], y: Sequence[float], before: list[Role]) -> float:
        """Distance of the last point from its prediction, in standard deviations."""
        fit = self._fit(u[:-1], y[:-1], before)
        assert fit.belief is not None
        shown = fit.predict(np.array(u), bands=PROBABILITY)
        noise = fit.belief.hyperparameters.noise * fit.belief.unit
        return float(abs(y[-1] - shown.y[-1]) / np.hypot(shown.sd[-1], noise))

    def _agrees(self, y: Sequence[float], u: Sequence[float], roles: list[Role]) -> bool:
        """Whether a repetition gave what was given before, rather than what was predicted."""
        fit = self._fit(u[:-2], y[:-2], roles[:-2])
        predicted = float(fit.predict(np.array(u))[-1])
        return abs(y[-1] - y[-2]) < abs(y[-1] - predicted)

    def _fit(self, u: Sequence[float], y: Sequence[float], roles: Sequence[Role]) -> Identification:
        if len(u) not in self._fits:
            outputs = np.array(y, dtype=np.float64)
            outputs[[role == "knocked" for role in roles]] = np.nan
            self._fits[len(u)] = identify(
                np.array(u), outputs, levels=self.grid, prior="gaussian", diagonal="reversible"
            )
        return self._fits[len(u)]

    def _validation_levels(self, u: Sequence[float]) -> FloatArray:
        """Random levels, each within the step of the one before."""
        rng = np.random.default_rng(self.seed)
        levels, now = [], float(u[-1])
        for _ in range(VALIDATION):
            low, high = max(self.low, now - self.step), min(self.high, now + self.step)
            now = float(rng.uniform(low, high))
            levels.append(now)
        return np.array(levels)

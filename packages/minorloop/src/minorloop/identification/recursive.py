"""Recursive identification: one settled sample at a time, for actuators that drift.

Least squares with forgetting, in information form: the state is the normal matrix R and vector b
instead of a covariance. A leak towards the present weights keeps R invertible if the input does not
excite the whole plane. The weights are updated by coordinate descent with bounds at zero. Clipping
the weights of a covariance recursion is not a projection in its metric, and diverges on inputs that
do not excite all weights.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    BoolArray,
    FloatArray,
    Levels,
    as_finite,
    as_levels,
    check_option,
    writable,
)
from minorloop.errors import ParameterError
from minorloop.identification import _recursive_kernels as _kernels
from minorloop.identification.design_matrix import PlaneSpec, pack
from minorloop.operators._memory_kernels import switched_on
from minorloop.operators.memory import Memory, Start
from minorloop.operators.plane import RELAYS, Relay, relay_outputs
from minorloop.operators.preisach import Diagonal, Preisach


@dataclass(frozen=True, eq=False)
class RecursiveState:
    """State of the recursion."""

    memory: Memory
    """Memory of the relays after the last input."""
    theta: FloatArray
    """Shape (n,). Packed weights and offset, in the unit of the output."""
    information: FloatArray
    """Shape (n, n). Weighted sum of the outer products of the regressors, with the leak."""
    vector: FloatArray
    """Shape (n,). Weighted sum of regressors times outputs, with the leak."""
    updates: int = 0
    """Number of samples used."""
    frozen: str = ""
    """Reason why the last sample was not used; empty if it was used."""


@dataclass(frozen=True, eq=False)
class Recursive:
    """Recursive identification of a Preisach model, from settled samples.

    Raises a `ParameterError` if an option is out of its range.

    References
    ----------
    Tan and Baras, Proc. American Control Conference 2004: recursive identification of the
    density and persistent excitation.
    """

    levels: Levels
    """Shape (L + 1,). Thresholds."""
    forgetting: float = 0.995
    """Factor by which an update reduces the weight of old samples, above 0 and up to 1; 0.995 keeps
    about 200 samples."""
    prior: float = 0.1
    """Strength of the leak towards the present weights, in samples; positive."""
    relay: Relay = "bipolar"
    diagonal: Diagonal = "uniform"
    """As in `Preisach`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "levels", as_levels(self.levels))
        check_option("relay", self.relay, RELAYS)
        check_option("diagonal", self.diagonal, ("uniform", "reversible"))
        if not 0 < as_finite("forgetting", self.forgetting) <= 1:
            raise ParameterError(f"forgetting is {self.forgetting}; give more than 0, up to 1")
        if not as_finite("prior", self.prior) > 0:
            raise ParameterError(f"prior is {self.prior}; give a positive number of samples")

    @property
    def spec(self) -> PlaneSpec:
        """Unknowns: all weights and the offset."""
        return PlaneSpec(self.levels, self.relay, self.diagonal)

    def begin(self, start: Start = "negative", model: Preisach | None = None) -> RecursiveState:
        """Return the state before the first sample.

        ``start``: memory of the actuator; ``model``: initial model on the same levels; by default
        all weights are zero. Raises a `ParameterError` if the model has other levels, relays or
        diagonal, or a slope.
        """
        theta = np.zeros(self.spec.unknowns)
        if model is not None:
            same = (
                np.array_equal(model.levels, self.levels)
                and (model.relay, model.diagonal) == (self.relay, self.diagonal)
                and model.slope == 0
            )
            if not same:
                raise ParameterError(
                    f"{model!r} has other levels, relays or diagonal than this recursion, or a "
                    "slope; give a model with the same, without a slope"
                )
            theta[:-1], theta[-1] = pack(model.weights), model.offset
        blank = self.model(RecursiveState(Memory.negative(0.0), theta, theta, theta))
        information = self.prior * np.eye(theta.size)
        return RecursiveState(blank.memory(start), theta, information, self.prior * theta)

    def update(
        self, state: RecursiveState, u: float, y: float, *, settled: bool = True
    ) -> RecursiveState:
        """Return the state after one sample; the old state does not change.

        Only the memory is updated if the output has not settled or was not measured (NaN), if the
        input is beyond the levels, or if no relay switched.

        Raises a `ParameterError` if the input is not finite, or the output is infinite.

        ``state``: state before the sample; ``u``: applied input; ``y``: measured output; NaN if not
        measured; ``settled``: whether the output has settled.
        """
        value, output = as_finite("u", u), float(y)
        if np.isinf(output):
            raise ParameterError(f"y is {y!r}; give a finite number, or NaN if not measured")
        low, high = float(self.levels[0]), float(self.levels[-1])
        memory = Memory.after([*state.memory.extrema[1:], value], low=low, high=high)
        reason = ""
        if not settled or np.isnan(output):
            reason = "not settled"
        elif not low <= value <= high:
            reason = "beyond the levels"
        elif memory == state.memory and state.updates:
            reason = "no relay switched"
        if reason:
            return replace(state, memory=memory, frozen=reason)
        information, vector = state.information.copy(), state.vector.copy()
        theta = state.theta.copy()
        row = self.regressor(memory)
        _kernels.absorb(information, vector, row, output, self.forgetting, self.prior, theta)
        # Two sweeps of coordinate descent per update
        _kernels.descend(information, vector, theta, self._bounded, 2)
        return RecursiveState(memory, theta, information, vector, state.updates + 1)

    def run(self, state: RecursiveState, u: npt.ArrayLike, y: npt.ArrayLike) -> RecursiveState:
        """Return the state after a sequence of settled samples.

        ``state``: state before the sequence; ``u`` (n,): inputs; ``y`` (n,): settled outputs; NaN
        if not read.
        """
        for value, output in zip(np.asarray(u).ravel(), np.asarray(y).ravel(), strict=True):
            state = self.update(state, float(value), float(output))
        return state

    def model(self, state: RecursiveState) -> Preisach:
        """Return the present estimate of the operator, from a state as of `run`."""
        return self.spec.model(state.theta)

    def excitation(self, state: RecursiveState) -> float:
        """Least eigenvalue of the information, over the effective number of samples.

        Zero if some combination of the weights has not been excited recently; about 0.005 for a
        decaying staircase of 10 bands. The leak is not included. The state is as of `run`.
        """
        leak = self.prior * np.eye(state.theta.size)
        remembered = (1 - self.forgetting**state.updates) / (1 - self.forgetting or np.inf)
        count = remembered if self.forgetting < 1 else float(state.updates)
        least = float(np.linalg.eigvalsh(state.information - leak)[0])
        return max(least, 0.0) / max(count, 1.0)

    def regressor(self, memory: Memory) -> FloatArray:
        """(n,) signed area fractions of all cells, and 1 for the offset.

        ``memory``: memory of the relays.
        """
        row = np.ones(self.spec.unknowns)
        extrema = np.array(memory.extrema)
        spread = self.diagonal == "uniform"
        switched_on(writable(self.levels), spread, extrema, extrema.size, row[:-1])
        row[:-1] = relay_outputs(self.relay, row[:-1])
        return row

    @property
    def _bounded(self) -> BoolArray:
        bounded = np.ones(self.spec.unknowns, dtype=np.bool_)
        bounded[-1] = False
        return bounded

"""The relay-by-relay model: one relay for each pair of levels.

Many papers draw and program the Preisach model in this way; this model serves for comparison. Each
relay has the thresholds (alpha, beta) = (levels[a], levels[b]). Inputs act only when they cross a
level, and the resolution of the stepping inverse is that of the levels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    ByValue,
    FloatArray,
    Levels,
    Samples,
    as_finite,
    as_levels,
    as_samples,
    as_triangle,
    check_option,
)
from minorloop.errors import ParameterError
from minorloop.figures import Drawn
from minorloop.operators._play_fit import as_record
from minorloop.operators.inversion import Inversion, as_signal
from minorloop.operators.memory import Memory
from minorloop.operators.plane import RELAYS, Relay
from minorloop.operators.preisach import Preisach

RelayStart: TypeAlias = Literal["negative", "positive"]


@dataclass(frozen=True, eq=False)
class RelayModel(ByValue, Drawn):
    """Weighted relays on level pairs.

    A relay at (alpha, beta) switches on when the input reaches alpha and off when it falls below
    beta; between them it keeps its state. So an input that rises to level k switches on the row
    alpha = levels[k], and an input that falls below level k switches off the column
    beta = levels[k].

    Raises a `ParameterError` if levels do not increase, shapes disagree, or a number is not finite.

    References
    ----------
    Mayergoyz, Mathematical Models of Hysteresis, 1991, section 1.1.

    Examples
    --------
    >>> relays = ml.RelayModel([0.0, 1.0], [[0.0, 0.0], [0.0, 2.0]])
    >>> relays.simulate([0.5, 1.0, 0.5])
    array([-2.,  2., -2.])
    """

    levels: Levels
    """Shape (N,). Thresholds in the unit of the input, strictly increasing."""
    weights: FloatArray
    """Shape (N, N). ``weights[a, b]``, b <= a, is the weight of the relay at (levels[a],
    levels[b]), in the unit of the output; zero above the diagonal."""
    offset: float = 0.0
    """Offset of the output."""
    relay: Relay = "bipolar"
    """Whether the output of a relay is -1 or +1, bipolar, or 0 or 1, unipolar."""

    def __post_init__(self) -> None:
        store = object.__setattr__
        store(self, "levels", as_levels(self.levels))
        store(self, "weights", as_triangle(self.weights, self.levels.size, name="weights"))
        store(self, "offset", as_finite("offset", self.offset))
        check_option("relay", self.relay, RELAYS)

    @classmethod
    def from_preisach(cls, model: Preisach) -> RelayModel:
        """Return relays that are equivalent to a Preisach operator for inputs on the levels.

        The weight of cell (i, j) goes to the relay (i + 1, j + 1): it is on when the input has
        reached the upper end of band i, off when it has fallen to the lower end of band j. The
        column at the lowest level is empty, because its relays never switch off.

        Raises a `ParameterError` if the model has a slope, which relays cannot represent.

        Parameters
        ----------
        model : Preisach
            Its levels become those of the relays.
        """
        if model.slope:
            raise ParameterError(
                f"the model has slope {model.slope:g}, which relays cannot represent; give slope 0"
            )
        weights = np.zeros((model.levels.size, model.levels.size))
        weights[1:, 1:] = model.weights
        return cls(model.levels, weights, model.offset, model.relay)

    @classmethod
    def fit(
        cls, u: npt.ArrayLike, y: npt.ArrayLike, levels: npt.ArrayLike, *, signed: bool = False
    ) -> RelayModel:
        """Fit unipolar relays to settled outputs by least squares.

        Reversal curves to every level, from rest at the lowest level, have as many inputs as there
        are relays. Then ``signed`` weights solve the square system of Sohn and colleagues,
        SWNT-reinforced polyaniline fibres, Eq. 3. The relay at the lowest level is always on: its
        weight is the offset.

        Raises a `SignalError` if lengths differ, or an input or output never changes; a
        `ParameterError` if an input is below the lowest level.

        Parameters
        ----------
        u : (T,) array_like
            Inputs, in order, from negative saturation, not below the lowest level.
        y : (T,) array_like
            Settled outputs; NaN if not measured.
        levels : (N,) array_like
            Thresholds.
        signed : bool
            Whether weights may be negative.
        """
        from scipy.optimize import nnls

        inputs, outputs = as_record(u, y)
        grid = as_levels(levels)
        if inputs.min() < grid[0]:
            raise ParameterError(
                f"u reaches {inputs.min():g}, below the lowest level; give inputs from "
                f"{grid[0]:g}, where every other relay is off"
            )
        relays, low = cls(grid, np.tri(grid.size)), np.tril_indices(grid.size)
        known = np.flatnonzero(~np.isnan(outputs))
        rows = np.array([relays.states(inputs[: k + 1])[low] for k in known])
        mean, middle = rows.mean(axis=0), outputs[known].mean()
        off = rows - mean, outputs[known] - middle
        found = np.linalg.lstsq(*off)[0] if signed else nnls(*off)[0]
        weights = np.zeros(relays.weights.shape)
        weights[low] = found
        return cls(grid, weights, float(middle - mean @ found), relay="unipolar")

    def states(self, u: npt.ArrayLike, start: RelayStart = "negative") -> FloatArray:
        """Return the (N, N) relays after an input: 1 if on, 0 if off or above the diagonal.

        Parameters
        ----------
        u : float or (T,) array_like
            Inputs, in order.
        start : {"negative", "positive"}
            Saturation before the first input.
        """
        levels, past = self._plane.levels, self._start(start).extrema
        inputs = self._on_levels(as_signal(u, name="u"))
        extrema = Memory.after([*past, *inputs], low=levels[0], high=levels[-1]).extrema
        on = np.zeros(self.weights.shape)
        # The relays between each maximum and the next minimum are on.
        for most, least in zip(extrema[1::2], [*extrema[2::2], np.inf], strict=False):
            on[np.ix_(self.levels <= most, self.levels <= least)] = 1.0
        return np.tril(on)

    def simulate(self, u: npt.ArrayLike, start: RelayStart = "negative") -> Samples:
        """Return the outputs for inputs from ``"negative"`` or ``"positive"`` saturation."""
        inputs = self._on_levels(as_samples(u, name="u"))
        return self._plane.simulate(inputs, self._start(start))

    def stepping_inverse(self, targets: npt.ArrayLike, start: RelayStart = "negative") -> Inversion:
        """Move the input level by level until the output passes each target.

        Inputs are level values; a target that no level reaches is marked unreachable.

        This is the search of Boudjabi, Ferreira and Krupa, 2003, Fig. 6; it stops at the last
        level. It overshoots by up to one level; `Preisach.invert` is exact. Targets are as of
        `Preisach.invert`, the start is as of `states`.
        """
        wanted, memory = as_signal(targets, name="targets"), self._start(start)
        u, y = np.empty_like(wanted), np.empty_like(wanted)
        reachable = np.empty(wanted.size, dtype=np.bool_)
        for k, target in enumerate(wanted):
            now, _ = self._plane.step(memory, memory.u)
            rising = target > now
            at = max(int(np.searchsorted(self.levels, memory.u, side="right")) - 1, 0)
            path = self.levels[at:] if rising else self.levels[at::-1]
            ahead = np.append(now, self._plane.simulate(path[1:], memory))
            passed = ahead >= target if rising else ahead <= target
            u[k] = path[int(np.argmax(passed)) if passed.any() else -1]
            y[k], memory = self._plane.step(memory, u[k])
            reachable[k] = y[k] >= target if rising else y[k] <= target
        return Inversion(u=u, y=y, residual=y - wanted, reachable=reachable)

    def line(self) -> tuple[float, float]:
        """Return the swing of a relay, and the output when all are off."""
        return self._plane.swing, self._plane.all_off

    @cached_property
    def _plane(self) -> Preisach:
        """The equivalent operator on the levels and an additional level below them."""
        below = 2 * self.levels[0] - self.levels[1]
        return Preisach(np.append(below, self.levels), self.weights, self.offset, self.relay)

    def _on_levels(self, u: Samples) -> Samples:
        """Return the highest level that each input reaches, or the additional level below."""
        return self._plane.levels[np.searchsorted(self.levels, u, side="right")]

    def _start(self, start: str) -> Memory:
        check_option("start", start, ("negative", "positive"))
        return self._plane.memory(start)  # type: ignore[arg-type]

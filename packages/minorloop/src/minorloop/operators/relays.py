"""The relay-by-relay model: one relay for each pair of levels.

Many papers draw and program the Preisach model in this way; it is here for comparison. Each relay
has the thresholds (alpha, beta) = (levels[a], levels[b]). Inputs act only when they cross a level,
and the resolution of the stepping inverse is that of the levels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
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
from minorloop.operators import _relay_kernels as _kernels
from minorloop.operators.inversion import Inversion, as_signal
from minorloop.operators.plane import RELAYS, Relay, off_output, swing

if TYPE_CHECKING:
    from minorloop.operators.preisach import Preisach


@dataclass(frozen=True, eq=False)
class RelayModel(Drawn):
    """Weighted relays on level pairs.

    A relay at (alpha, beta) switches on when the input reaches alpha and off when it falls
    below beta; in between it keeps its state. So an input that rises to level k switches on the
    row alpha = levels[k], and one that falls below level k switches off the column
    beta = levels[k].

    Raises
    ------
    ParameterError
        If levels do not increase, shapes disagree, or a number is not finite.

    References
    ----------
    Mayergoyz, Mathematical Models of Hysteresis, 1991, section 1.1.
    """

    levels: Levels
    """Shape (N,). Thresholds in the unit of the input, strictly increasing."""
    weights: FloatArray
    """Shape (N, N). ``weights[a, b]``, b <= a, is the weight of the relay at (levels[a],
    levels[b]), in the unit of the output; zero above the diagonal."""
    offset: float = 0.0
    """Added to the output."""
    relay: Relay = "bipolar"
    """Whether the output of a relay is -1 or +1, bipolar, or 0 or 1, unipolar."""

    def __post_init__(self) -> None:
        store = object.__setattr__
        store(self, "levels", as_levels(self.levels))
        store(self, "weights", as_triangle(self.weights, self.levels.size, name="weights"))
        store(self, "offset", as_finite("offset", self.offset))
        check_option("relay", self.relay, RELAYS)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RelayModel):
            return NotImplemented
        return (
            np.array_equal(self.levels, other.levels)
            and np.array_equal(self.weights, other.weights)
            and (self.offset, self.relay) == (other.offset, other.relay)
        )

    @classmethod
    def from_preisach(cls, model: Preisach) -> RelayModel:
        """Return relays that are equivalent to a Preisach operator for inputs on the levels.

        The weight of cell (i, j) goes to the relay (i + 1, j + 1): it is on when the input has
        reached the upper end of band i, off when it has fallen to the lower end of band j. The
        column at the lowest level is empty, because its relays never switch off.

        Parameters
        ----------
        model : Preisach
            Its levels become those of the relays.

        Raises
        ------
        ParameterError
            If the model has a slope, which relays cannot represent.
        """
        if model.slope:
            raise ParameterError(
                f"the model has slope {model.slope:g}, which relays cannot represent; give slope 0"
            )
        weights = np.zeros((model.levels.size, model.levels.size))
        weights[1:, 1:] = model.weights
        return cls(model.levels, weights, model.offset, model.relay)

    def states(
        self, u: npt.ArrayLike, start: Literal["negative", "positive"] = "negative"
    ) -> FloatArray:
        """Return the (N, N) relays after an input: 1 if on, 0 if off or above the diagonal.

        Parameters
        ----------
        u : float or (T,) array_like
            Inputs, in order.
        start : {"negative", "positive"}
            Saturation before the first input.
        """
        on, level = self._start(start)
        inputs = as_signal(u, name="u")
        _kernels.simulate(self.levels, self.weights, on, level, inputs, np.empty_like(inputs))
        return on

    def simulate(
        self, u: npt.ArrayLike, start: Literal["negative", "positive"] = "negative"
    ) -> Samples:
        """Return the outputs for inputs from ``"negative"`` or ``"positive"`` saturation."""
        inputs = as_samples(u, name="u")
        outputs = np.empty_like(inputs)
        for row, out in zip(np.atleast_2d(inputs), np.atleast_2d(outputs), strict=True):
            on, level = self._start(start)
            _kernels.simulate(self.levels, self.weights, on, level, row, out)
        return self._scale(outputs)

    def stepping_inverse(
        self, targets: npt.ArrayLike, start: Literal["negative", "positive"] = "negative"
    ) -> Inversion:
        """Move the input level by level until the output passes each target.

        This is the search of Boudjabi, Ferreira and Krupa, 2003, Fig. 6, on a copy of the relays;
        it stops at the last level. It overshoots by up to one level; `Preisach.invert` is exact.
        Targets are as of `Preisach.invert`, the start is as of `states`.

        Returns
        -------
        Inversion
            Inputs are level values; a target that no level reaches is marked unreachable.
        """
        wanted = as_signal(targets, name="targets")
        on, level = self._start(start)
        size, low = self.line()
        u, y = np.empty_like(wanted), np.empty_like(wanted)
        reachable = np.empty(wanted.size, dtype=np.bool_)
        _kernels.stepping_inverse(
            self.levels, self.weights, on, level, (wanted - low) / size, u, y, reachable
        )
        y = self._scale(y)
        return Inversion(u=u, y=y, residual=y - wanted, reachable=reachable)

    def _start(self, start: str) -> tuple[FloatArray, int]:
        """Return the relays, and the highest level that is reached (-1 if none)."""
        check_option("start", start, ("negative", "positive"))
        if start == "negative":
            return np.zeros(self.weights.shape), -1
        return np.tril(np.ones(self.weights.shape)), self.levels.size - 1

    def line(self) -> tuple[float, float]:
        """Return the swing of a relay, and the output when all are off."""
        off = off_output(self.relay) * float(self.weights.sum())
        return swing(self.relay), self.offset + off

    def _scale(self, on_weight: Samples) -> Samples:
        size, low = self.line()
        return low + size * on_weight

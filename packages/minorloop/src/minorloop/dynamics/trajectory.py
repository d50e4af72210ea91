"""Settled values of an operator, joined by step responses."""

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_waveform, check_option
from minorloop.dynamics.linear import Linear
from minorloop.errors import ParameterError
from minorloop.operators.operator import Operator

Joining: TypeAlias = Literal["settled", "superposed"]

_UNIT = 1e-6
"""Largest difference of a DC gain from 1: far below what a record can show, above rounding."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """An operator for the settled values, and unit step responses for the transients.

    Raises
    ------
    ParameterError
        If a response is unstable or its DC gain is not 1.

    References
    ----------
    Sohn and colleagues, SWNT-reinforced polyaniline fibres, Fig. 5: settled values of a
    Preisach model joined by one step response. Two responses are an extension.
    """

    operator: Operator
    """Gives the settled value for each input, with memory."""
    rising: Linear
    """Response with DC gain 1 of an output that rises."""
    falling: Linear | None = None
    """Response of an output that falls; ``rising`` if not given."""

    def __post_init__(self) -> None:
        for name in ("rising", "falling"):
            response = getattr(self, name)
            if response is None:
                continue
            if not response.stable or abs(response.dc_gain - 1) > _UNIT:
                raise ParameterError(
                    f"the {name} response has DC gain {response.dc_gain:.9g} and is "
                    f"{'stable' if response.stable else 'unstable'}; give a stable one with DC "
                    "gain 1, as normalised() does"
                )

    def simulate(
        self,
        t: npt.ArrayLike,
        u: npt.ArrayLike,
        start: Any = "negative",
        *,
        before: float | None = None,
        joining: Joining = "settled",
    ) -> FloatArray:
        """Return the outputs for an input that is held in steps, as `TimedModel.simulate`.

        Parameters
        ----------
        joining : {"settled", "superposed"}
            How transients are joined, with steps at t_k to settled values Y_k, and the step
            response s of the direction. ``"settled"``: y(t) = y_k + (Y_k - y_k) s(t - t_k), where
            y_k is the output at t_k; the transient of the step before ends at t_k.
            ``"superposed"``: y(t) = Y_0 + sum (Y_k - Y_k-1) s(t - t_k); all transients continue.
        """
        times, inputs = as_waveform(t, u)
        check_option("joining", joining, ("settled", "superposed"))
        held = float(inputs[0]) if before is None else as_finite("before", before)
        changes = np.flatnonzero(np.diff(inputs, prepend=held))
        steady = self.operator.simulate(np.append(held, inputs[changes]), start)
        began = np.append(2 * times[0] - times[1], times)[changes]
        join = self._settled if joining == "settled" else self._superposed
        return join(times, began, steady)

    def _settled(self, t: FloatArray, began: FloatArray, steady: FloatArray) -> FloatArray:
        y = np.full(t.size, steady[0])
        now = float(steady[0])
        ends = np.searchsorted(t, began, side="right")
        for k, first in enumerate(ends):
            last = ends[k + 1] if k + 1 < ends.size else t.size
            change = float(steady[k + 1]) - now
            y[first:last] = now + change * self._response(change, t[first:last] - began[k])
            now = float(y[last - 1])
        return y

    def _superposed(self, t: FloatArray, began: FloatArray, steady: FloatArray) -> FloatArray:
        y = np.full(t.size, steady[0])
        for k, change in enumerate(np.diff(steady)):
            first = int(np.searchsorted(t, began[k], side="right"))
            y[first:] += change * self._response(float(change), t[first:] - began[k])
        return y

    def _response(self, change: float, since: FloatArray) -> FloatArray:
        falling = self.rising if self.falling is None else self.falling
        return (self.rising if change >= 0 else falling).step_response(since)

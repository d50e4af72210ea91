"""Settled values of an operator, joined by step responses."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_waveform
from minorloop.dynamics.linear import Linear
from minorloop.errors import ParameterError
from minorloop.operators.operator import Operator
from minorloop.operators.relays import RelayModel


@dataclass(frozen=True, eq=False)
class Trajectory:
    """An operator for the settled values, and unit step responses for the transients.

    Raises a `ParameterError` if a response is unstable or its DC gain is not 1.

    References
    ----------
    Sohn and colleagues, SWNT-reinforced polyaniline fibres, Fig. 5: settled values of a
    Preisach model joined by one step response. Two responses are an extension.
    """

    operator: Operator | RelayModel
    """Operator that returns the settled value for each input, with memory."""
    rising: Linear
    """Response with DC gain 1 of an output that rises."""
    falling: Linear | None = None
    """Response of an output that falls; ``rising`` by default."""

    def __post_init__(self) -> None:
        for name in ("rising", "falling"):
            response = getattr(self, name)
            if response is None:
                continue
            # Largest difference of a DC gain from 1: far below what a record can show, above
            # rounding
            if not response.stable or abs(response.dc_gain - 1) > 1e-6:
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
    ) -> FloatArray:
        """Return the outputs for an input that is held in steps, as `TimedModel.simulate`.

        With steps at t_k to settled values Y_k, and the step response s of the direction, it is
        y(t) = y_k + (Y_k - y_k) s(t - t_k), where y_k is the output at t_k; the transient of the
        previous step ends at t_k.
        """
        times, inputs = as_waveform(t, u)
        held = float(inputs[0]) if before is None else as_finite("before", before)
        changes = np.flatnonzero(np.diff(inputs, prepend=held))
        steady = self.operator.simulate(np.append(held, inputs[changes]), start)
        began = np.append(2 * times[0] - times[1], times)[changes]
        y = np.full(times.size, steady[0])
        now, falling = float(steady[0]), self.falling or self.rising
        ends = np.append(np.searchsorted(times, began, side="right"), times.size)
        for settled, begin, first, last in zip(steady[1:], began, ends, ends[1:], strict=False):
            response = self.rising if settled >= now else falling
            y[first:last] = now + (settled - now) * response.step_response(
                times[first:last] - begin
            )
            now = float(y[last - 1])
        return y

"""What an inversion gives: inputs, what they achieve, and how near that is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, check_option
from minorloop.errors import UnreachableError

_SHOWN = 12


@dataclass(frozen=True, eq=False)
class Inversion:
    """Inputs that bring a model to a sequence of targets.

    Parameters
    ----------
    u : (T,) array
        Inputs, in order.
    y : (T,) array
        What the model gives for them.
    residual : (T,) array
        ``y - target``.
    reachable : (T,) array of bool
        Whether the target lies within what the model can reach.
    """

    u: FloatArray
    y: FloatArray
    residual: FloatArray
    reachable: BoolArray

    @property
    def targets(self) -> FloatArray:
        """(T,) outputs that were asked for."""
        return self.y - self.residual

    @property
    def worst(self) -> float:
        """Largest distance between output and target."""
        return float(np.max(np.abs(self.residual), initial=0.0))

    def __str__(self) -> str:
        lines = [f"{'target':>14} {'input':>14} {'output':>14} {'residual':>10}"]
        for row in range(min(self.u.size, _SHOWN)):
            mark = "" if self.reachable[row] else "  out of reach"
            lines.append(
                f"{self.targets[row]:14.6g} {self.u[row]:14.6g} {self.y[row]:14.6g} "
                f"{self.residual[row]:10.2g}{mark}"
            )
        if self.u.size > _SHOWN:
            lines.append(f"... {self.u.size - _SHOWN} more")
        missed = int(np.count_nonzero(~self.reachable))
        lines.append(f"worst residual {self.worst:.3g}, {missed} of {self.u.size} out of reach")
        return "\n".join(lines)

    def plot(self, *, input_label: str = "input", output_label: str = "output") -> Any:
        """Draw targets with outputs, and the inputs below; gives the matplotlib figure."""
        from minorloop.operators.drawing import draw_inversion

        return draw_inversion(self, input_label=input_label, output_label=output_label)


def check_unreachable_option(value: str) -> None:
    """Refuse anything but ``"raise"`` and ``"clip"``."""
    check_option("unreachable", value, ("raise", "clip"))


def refuse_unreachable(
    targets: FloatArray, low: float, high: float, reachable: BoolArray, unit: str = ""
) -> None:
    """Refuse targets that are out of reach.

    Raises
    ------
    UnreachableError
        Naming the first of them.
    """
    if reachable.all():
        return
    index = int(np.argmin(reachable))
    of = f" {unit}" if unit else ""
    raise UnreachableError(
        f"target {targets[index]:g}{of} at index {index} is beyond what the model can reach, "
        f'[{low:g}, {high:g}]{of}; pass unreachable="clip" to go as near as it can'
    )

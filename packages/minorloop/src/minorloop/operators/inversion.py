"""Result of an inversion, and checks that all inversions share."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, as_finite, as_samples, check_option
from minorloop.errors import SignalError, UnreachableError
from minorloop.figures import Drawn

Unreachable: TypeAlias = Literal["raise", "clip"]


_SHOWN = 12
"""Most rows of a printed table: half of a terminal of 24 lines."""


@dataclass(frozen=True, eq=False)
class Inversion(Drawn):
    """Inputs that bring a model to a sequence of targets."""

    u: FloatArray
    """Shape (T,). Inputs, in order."""
    y: FloatArray
    """Shape (T,). Outputs of the model for these inputs."""
    residual: FloatArray
    """Shape (T,). ``y - target``."""
    reachable: BoolArray
    """Shape (T,). Whether the target lies within the range of the model."""
    sd: FloatArray | None = None
    """Shape (T,). Standard deviation of a reading of the actuator's output; None if not known."""
    warnings: tuple[str, ...] = ()
    """Reasons not to trust the inverted model."""

    @property
    def targets(self) -> FloatArray:
        """(T,) target outputs."""
        return self.y - self.residual

    @property
    def worst(self) -> float:
        """Largest distance between output and target."""
        return float(np.max(np.abs(self.residual), initial=0.0))

    def __str__(self) -> str:
        lines = [f"{'target':>14} {'input':>14} {'output':>14} {'residual':>10}"]
        if self.sd is not None:
            lines[0] += f" {'sd':>10}"
        for row in range(min(self.u.size, _SHOWN)):
            mark = "" if self.reachable[row] else "  out of reach"
            if self.sd is not None:
                mark = f" {self.sd[row]:10.2g}{mark}"
            lines.append(
                f"{self.targets[row]:14.6g} {self.u[row]:14.6g} {self.y[row]:14.6g} "
                f"{self.residual[row]:10.2g}{mark}"
            )
        if self.u.size > _SHOWN:
            lines.append(f"... {self.u.size - _SHOWN} more")
        missed = int(np.count_nonzero(~self.reachable))
        lines.append(f"worst residual {self.worst:.3g}, {missed} of {self.u.size} out of reach")
        return "\n".join([*lines, *(f"warning: {text}" for text in self.warnings)])


def check_unreachable_option(value: str) -> None:
    """Refuse an option that is neither ``"raise"`` nor ``"clip"``."""
    check_option("unreachable", value, ("raise", "clip"))


def as_signal(values: npt.ArrayLike, *, name: str) -> FloatArray:
    """Return one sequence of samples, (T,); a single number counts as one sample.

    Raises a `SignalError` if the values are not finite numbers, or have more than one dimension.
    """
    samples = as_samples(np.atleast_1d(values), name=name)
    if samples.ndim != 1:
        raise SignalError(f"{name} has shape {samples.shape}; give one sequence, (T,)")
    return samples


def within_reach(targets: FloatArray, low: float, high: float) -> BoolArray:
    """Return whether each target lies between the least and greatest output, within rounding."""
    # Share of the range beyond it within which a target counts as reachable: rounding of outputs
    slack = 1e-12 * (high - low)
    return (targets >= low - slack) & (targets <= high + slack)


def as_targets(
    targets: npt.ArrayLike, low: float, high: float, unreachable: Unreachable
) -> tuple[FloatArray, BoolArray]:
    """Return targets (T,), and whether each lies between the least and the greatest output.

    Raises an `UnreachableError` if one does not and ``unreachable="raise"``; a `SignalError` or a
    `ParameterError` if targets or option are invalid.
    """
    check_unreachable_option(unreachable)
    wanted = as_signal(targets, name="targets")
    reachable = within_reach(wanted, low, high)
    if unreachable == "raise":
        refuse_unreachable(wanted, low, high, reachable)
    return wanted, reachable


def refuse_unreachable(targets: FloatArray, low: float, high: float, reachable: BoolArray) -> None:
    """Refuse targets that are out of reach.

    Raises an `UnreachableError` that names the first of them.
    """
    if reachable.all():
        return
    index = int(np.argmin(reachable))
    target, bottom, top = _in_few_digits(float(targets[index]), low, high)
    raise UnreachableError(
        f"target {target} at index {index} is beyond what the model can reach, "
        f'[{bottom}, {top}]; pass unreachable="clip" to go as near as it can'
    )


def as_reachable(y: float, low: float, high: float, unreachable: Unreachable) -> float:
    """Return one target within the reach of a model; the nearer end for ``"clip"``.

    Raises an `UnreachableError` if the target is out of reach and ``unreachable="raise"``; a
    `ParameterError` if the target is not a finite number, or there is no such option.
    """
    check_unreachable_option(unreachable)
    target = as_finite("target", y)
    if not low <= target <= high:  # a target inside, as in a live loop, does not need arrays
        as_targets([target], low, high, unreachable)
    return min(max(target, low), high)


def _in_few_digits(target: float, low: float, high: float) -> tuple[str, str, str]:
    """Return the numbers as text, with enough digits to show that the target is outside."""
    for digits in (6, 9, 12, 17):
        texts = [f"{number:.{digits}g}" for number in (target, low, high)]
        shown, bottom, top = map(float, texts)
        if not bottom <= shown <= top:
            break
    return texts[0], texts[1], texts[2]

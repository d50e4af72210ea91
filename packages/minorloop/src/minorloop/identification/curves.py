"""Curves: parts of a record that begin with a reset of the memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, get_args

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, IntArray, Levels, check_option
from minorloop.errors import ParameterError, SignalError, counted
from minorloop.operators.memory import Saturation, Start, StartOfCurve
from minorloop.operators.preisach import Preisach

AS_LEFT: Final = "as-left"
"""Start of a curve that continues from the previous one."""


@dataclass(frozen=True, eq=False)
class Curves:
    """Rows before which the memory of a record is reset."""

    begins: IntArray
    """Shape (C,). First row of each curve, in increasing order; the first is 0."""
    start: Start
    """{"negative", "positive", "demagnetised"} or Memory. Memory before each curve."""
    names: tuple[str, ...] = ()
    """Labels of the curves; their numbers if empty."""

    @classmethod
    def whole(cls, start: Start) -> Curves:
        """Return one curve, which is the whole record."""
        return cls(np.zeros(1, dtype=np.int64), start)

    def name(self, number: int) -> str:
        """Return the label of a curve."""
        return self.names[number] if self.names else str(number)

    def parts(self, samples: int) -> list[tuple[int, int]]:
        """First row of each curve, and the row after its last."""
        return list(pairwise([*self.begins.tolist(), samples]))

    def first_rows(self, samples: int) -> IntArray:
        """(T,) for each row, the first row of its curve."""
        if self.begins.size == 1:
            return np.zeros(samples, dtype=np.int64)
        return np.asarray(self.begins[self._number(samples)])

    def positions(self, samples: int) -> IntArray:
        """(T,) for each row, its place in its curve, from 0."""
        return np.asarray(np.arange(samples) - self.first_rows(samples))

    def delayed(self, values: FloatArray, lag: int) -> FloatArray:
        """Delay signals (..., T) within each curve; they begin with its first value."""
        samples = values.shape[-1]
        rows = np.maximum(np.arange(samples) - lag, self.first_rows(samples))
        return np.asarray(values[..., rows])

    def travelled(self, u: FloatArray, travel: float) -> FloatArray:
        """Delay inputs (T,) by a travel, in their unit, within each curve, at any rate.

        A curve begins with its first input; later inputs are interpolated linearly.
        """
        path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(u)))])
        places = np.maximum(path - travel, path[self.first_rows(u.size)])
        return np.asarray(np.interp(places, path, u))

    def driven(self, u: FloatArray, levels: Levels, lag: int = 0) -> tuple[FloatArray, IntArray]:
        """Inputs with those that set the memory before each later curve, and the place of each row.

        ``u`` (T,): inputs of all curves; ``levels`` (L + 1,): thresholds of the plane; ``lag``:
        rows by which the inputs are delayed within each curve.
        """
        late = self.delayed(u, lag)
        later = self.begins[1:]
        if not later.size:
            return late, np.arange(u.size)
        plane = Preisach(levels, np.zeros((levels.size - 1, levels.size - 1)))
        reset = np.asarray(plane.memory(self.start).extrema)
        inputs = np.insert(late, np.repeat(later, reset.size), np.tile(reset, later.size))
        return inputs, np.arange(u.size) + reset.size * self._number(u.size)

    def simulate(self, model: Preisach, u: FloatArray, lag: int = 0) -> FloatArray:
        """(T,) outputs of a model along the curves."""
        inputs, places = self.driven(u, model.levels, lag)
        return np.asarray(model.simulate(inputs, self.start))[places]

    def _number(self, samples: int) -> IntArray:
        return np.searchsorted(self.begins, np.arange(samples), side="right") - 1


def as_curves(
    labels: npt.ArrayLike | None, samples: int, start: Start, start_of_curve: StartOfCurve | None
) -> Curves:
    """Return the curves of a record whose rows have labels.

    Raises a `SignalError` if there is not one label for each row; a `ParameterError` if
    ``start_of_curve`` is given without labels, or is not a start.

    ``labels`` (T,): a new curve begins where the label changes; without labels, the record is one
    curve; ``samples``: T; ``start``: memory before the first row; ``start_of_curve``: memory before
    each curve, also the first; ``start`` by default. With ``"as-left"`` the memory continues.
    """
    if labels is None:
        if start_of_curve is not None:
            raise ParameterError(
                "start_of_curve is given without curves; give curves (--record curves=COLUMN)"
            )
        return Curves.whole(start)
    number = as_groups("curves", labels, samples)
    if isinstance(start_of_curve, str):
        allowed = (*get_args(Saturation), AS_LEFT)
        check_option("start_of_curve (--record start_of_curve)", start_of_curve, allowed)
    if start_of_curve is None:
        start_of_curve = start
    if start_of_curve == AS_LEFT:
        return Curves.whole(start)
    begins = np.flatnonzero(np.append(True, np.diff(number) != 0))
    lengths = np.diff(np.append(begins, samples))
    returns = begins.size > np.unique(number).size
    if returns and 2 * np.count_nonzero(lengths == 1) >= lengths.size:
        shown = ", ".join(map(_as_text, np.asarray(labels)[begins[:4]].tolist()))
        raise ParameterError(
            f"curves (--record curves=COLUMN) changes from row to row, {shown}, and each change "
            "begins a curve; put all rows of a curve together, or give the start state "
            '"as-left" (--record start_of_curve=as-left) if the rows are in the order of time'
        )
    names = tuple(map(_as_text, np.asarray(labels)[begins].tolist()))
    return Curves(begins, start_of_curve, names)


def _as_text(label: object) -> str:
    """Return a label as text; whole numbers without a decimal point."""
    whole = isinstance(label, float) and label.is_integer()
    return f"{label:.0f}" if whole else f"{label}"


def _quoted(label: object) -> str:
    """Return a label as in the file; text is in quotation marks."""
    return repr(label) if isinstance(label, str) else _as_text(label)


def as_groups(name: str, labels: npt.ArrayLike, samples: int) -> IntArray:
    """(T,) number of the group of each row, from 0 in the order of their labels.

    Raises a `SignalError` if there is not one label for each row.
    """
    given = np.asarray(labels)
    if given.shape != (samples,):
        raise SignalError(
            f"{name} has shape {given.shape}; give one label for each of {samples} rows"
        )
    if given.dtype.kind == "f" and np.isnan(given).any():
        row = int(np.argmax(np.isnan(given)))
        raise SignalError(f"{name} is NaN at index {row}; give every row a label")
    return np.unique(given, return_inverse=True)[1].astype(np.int64)


def check_group_sizes(name: str, groups: IntArray, labels: Sequence[object]) -> None:
    """Raise an error if a group has one row only, which does not show how the group differs.

    Raises a `ParameterError` if a group has one row.
    """
    counts = np.bincount(groups)
    single = np.flatnonzero(counts == 1)
    if 0 < 2 * single.size < counts.size:
        row = int(np.argmax(groups == single[0]))
        raise ParameterError(
            f"{name} has {_quoted(labels[single[0]])} in one row only, at index {row}; correct "
            "this label, or remove the row"
        )
    if single.size:
        raise ParameterError(
            f"{name} has {counted(single.size, 'group')} of one row, the first is "
            f"{_quoted(labels[single[0]])}; give the rows of one curve or specimen the same label"
        )

"""Millions of independent operators with the same weights, such as the points of a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, IntArray, as_samples
from minorloop.errors import ParameterError, SignalError
from minorloop.fleet import _kernels
from minorloop.operators import plane
from minorloop.operators._parallel import in_parallel
from minorloop.operators.memory import Memory
from minorloop.operators.preisach import Preisach, Start, _swing

__all__ = ["FleetState", "simulate_fleet"]

LEAST_ROOM = 6
_CHUNK = 16_384


@dataclass(frozen=True, eq=False)
class FleetState:
    """Memories of many operators, as arrays.

    Parameters
    ----------
    stacks : (S, room, 4) array
        Remembered extrema of each operator, the present input last: input, output of the
        relays, band of the plane, fraction of the band.
    rows : (S,) array of int
        How many of them are in use.
    lost : (S,) array
        What the loops dropped so far for lack of room can have changed the output by, at most,
        in its unit.
    """

    stacks: FloatArray
    rows: IntArray
    lost: FloatArray

    @classmethod
    def begin(
        cls, model: Preisach, operators: int, *, start: Start = "negative", room: int = 16
    ) -> FleetState:
        """The same memory for every operator.

        Parameters
        ----------
        model : Preisach
            The operator.
        operators : int
            How many.
        start : {"negative", "positive", "demagnetised"} or Memory
            What is remembered.
        room : int
            Extrema that each operator has room for, the present input included, at least 6.
            When a history has more, the smallest loop is dropped. Each takes 32 bytes.

        Raises
        ------
        ParameterError
            If there is no operator, too little room, or more is remembered than there is
            room for.
        """
        if isinstance(operators, bool) or int(operators) != operators or operators < 1:
            raise ParameterError(f"{operators!r} operators; give a whole number of at least 1")
        if isinstance(room, bool) or int(room) != room or room < LEAST_ROOM:
            raise ParameterError(f"room is {room!r}; give a whole number of at least {LEAST_ROOM}")
        stack, rows = model._stack(start, 0)
        if rows >= room:
            raise ParameterError(
                f"start remembers {rows} extrema, and room is {room}; give room for more than that"
            )
        stacks = np.empty((int(operators), int(room), 4))
        stacks[:, :rows] = stack[:rows]
        return cls(stacks, np.full(int(operators), rows), np.zeros(int(operators)))

    def __len__(self) -> int:
        return len(self.rows)

    def memory(self, operator: int) -> Memory:
        """What one operator remembers."""
        return Memory(self.stacks[operator, : self.rows[operator], 0].tolist())

    def copy(self) -> FleetState:
        """An independent state."""
        return FleetState(self.stacks.copy(), self.rows.copy(), self.lost.copy())


def simulate_fleet(
    model: Preisach,
    u: npt.ArrayLike,
    state: FleetState | None = None,
    *,
    in_place: bool = False,
) -> tuple[FloatArray, FleetState]:
    """Outputs of many independent operators with the same weights.

    Parameters
    ----------
    model : Preisach
        The operator.
    u : (S,) or (S, T) array_like
        The next input of each of S operators, or the next T of them.
    state : FleetState, optional
        Memories before; negative saturation if not given.
    in_place : bool
        Whether ``state`` may be overwritten, which saves a copy of its memory.

    Returns
    -------
    y : (S,) or (S, T) array
    state : FleetState
        Memories after.

    Raises
    ------
    SignalError
        If the inputs are not finite numbers, or not for as many operators as the state has.
    """
    inputs = as_samples(u, name="u")
    if state is None:
        state, in_place = FleetState.begin(model, len(inputs)), True
    if len(inputs) != len(state):
        raise SignalError(
            f"u has {len(inputs)} rows and the state {len(state)} operators; give one row for each"
        )
    after = state if in_place else state.copy()
    table = inputs.reshape(len(inputs), -1)
    outputs = np.empty_like(table)
    sizes = _swing(model.relay) * plane.nodes_from_weights(np.abs(model.weights))
    bow = sizes.diagonal(-1).copy() if model.diagonal == "uniform" else np.zeros(model.bands)

    def work(chunk: int) -> None:
        first = chunk * _CHUNK
        last = min(first + _CHUNK, len(table))
        _kernels.march(model._plane, sizes, bow, *_parts(after), table, outputs, first, last)

    in_parallel(work, -(-len(table) // _CHUNK))
    return outputs.reshape(inputs.shape), after


def _parts(state: FleetState) -> tuple[FloatArray, IntArray, FloatArray]:
    return state.stacks, state.rows, state.lost

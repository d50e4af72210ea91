"""Millions of independent operators with the same weights, such as the points of a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, IntArray, as_samples, as_whole, check_kind
from minorloop.errors import ParameterError, SignalError
from minorloop.fleet import _kernels
from minorloop.operators import plane
from minorloop.operators._parallel import in_parallel
from minorloop.operators.memory import LEAST_ROOM, MOST_ROOM, ROOM, Memory, Start
from minorloop.operators.preisach import Preisach

_MOST_OPERATORS = 2**31
"""Most operators. A choice: with the least room, their memory takes 412 GB."""
_CHUNK = 16_384
"""Operators in a task of a thread: enough that the start of a task takes little time."""


@dataclass(frozen=True, eq=False)
class FleetState:
    """Memories of many operators, as arrays."""

    model: Preisach
    """The operator of the memories."""
    stacks: FloatArray
    """Shape (S, room, 4). Remembered extrema of each operator, the present input last: input,
    output of the relays, band of the plane, fraction of the band."""
    rows: IntArray
    """Shape (S,). Number of extrema in use."""
    lost: FloatArray
    """Shape (S,). Bound of the output error from loops that were dropped for lack of room, in the
    unit of the output; it is zero again after the input has passed them."""
    within: FloatArray
    """Shape (S, 2). Inputs between which this error lasts."""

    @classmethod
    def begin(
        cls, model: Preisach, operators: int, *, start: Start = "negative", room: int = ROOM
    ) -> FleetState:
        """Return the same memory for every operator.

        Raises a `ParameterError` if there is no operator, or too little room for the memory.

        ``model``: the operator; ``operators``: number of operators; ``start`` {"negative",
        "positive", "demagnetised"} or Memory: memory of each operator; ``room``: most extrema of
        each operator, with the present input, at least 6. If a history has more, the smallest loop
        is dropped. Each extremum takes 32 bytes.
        """
        check_kind("model", model, Preisach)
        count = as_whole("operators", operators, 1, _MOST_OPERATORS)
        room = as_whole("room", room, LEAST_ROOM, MOST_ROOM)
        stack, rows = model.stack(start, 0)
        if rows >= room:
            raise ParameterError(
                f"start remembers {rows} extrema, and room is {room}; give room for more than that"
            )
        stacks = np.empty((count, room, 4))
        stacks[:, :rows] = stack[:rows]
        return cls(model, stacks, np.full(count, rows), np.zeros(count), np.zeros((count, 2)))

    def __len__(self) -> int:
        return len(self.rows)

    def memory(self, operator: int) -> Memory:
        """Return the memory of one operator."""
        return Memory(self.stacks[operator, : self.rows[operator], 0].tolist())

    def copy(self) -> FleetState:
        """Return an independent state."""
        stacks, rows, lost, within = _parts(self)
        return FleetState(self.model, stacks.copy(), rows.copy(), lost.copy(), within.copy())


def simulate_fleet(
    model: Preisach, u: npt.ArrayLike, state: FleetState | None = None, *, in_place: bool = False
) -> tuple[FloatArray, FleetState]:
    """Simulate many independent operators with the same weights.

    Raises a `SignalError` if the inputs are not finite numbers, or not for as many operators as the
    state has; a `ParameterError` if the model is of another class, or the state is of another
    model, damaged, or may not be overwritten.

    ``model``: the operator; ``u`` (S,) or (S, T): the next input, or the next T inputs, of each of
    S operators; ``state``: memories before, by default negative saturation; ``in_place``: whether
    ``state`` may be overwritten, which saves a copy of its memory.

    Returns
    -------
    y : (S,) or (S, T) array
    state : FleetState
        Memories after the inputs.
    """
    check_kind("model", model, Preisach)
    inputs = as_samples(u, name="u")
    if state is None:
        state, in_place = FleetState.begin(model, len(inputs)), True
    _check_state(model, state, in_place)
    if len(inputs) != len(state):
        raise SignalError(
            f"u has {len(inputs)} rows and the state {len(state)} operators; give one row for each"
        )
    after = state if in_place else state.copy()
    table = inputs.reshape(len(inputs), -1)
    outputs = np.empty_like(table)
    sizes = model.swing * plane.nodes_from_weights(np.abs(model.weights))
    bow = sizes.diagonal(-1).copy() if model.diagonal == "uniform" else np.zeros(model.bands)

    def work(chunk: int) -> None:
        first = chunk * _CHUNK
        last = min(first + _CHUNK, len(table))
        _kernels.march(model.tables, sizes, bow, *_parts(after), table, outputs, first, last)

    in_parallel(work, -(-len(table) // _CHUNK))
    return outputs.reshape(inputs.shape), after


def _parts(state: FleetState) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    return state.stacks, state.rows, state.lost, state.within


def _check_state(model: Preisach, state: FleetState, in_place: bool) -> None:
    """Check that a state is complete and belongs to the model; the loops do not check."""
    check_kind("state", state, FleetState)
    if not _same_relays(state.model, model):
        raise ParameterError(
            f"the state belongs to another model, with {state.model.bands} bands from "
            f"{state.model.levels[0]:g} to {state.model.levels[-1]:g}; begin one of this model"
        )
    stacks, rows, lost, within = _parts(state)
    count, room = len(rows), stacks.shape[1] if stacks.ndim == 3 else 0
    shapes = (stacks.shape, lost.shape, within.shape) == ((count, room, 4), (count,), (count, 2))
    kinds = rows.dtype == np.int64 and all(x.dtype == np.float64 for x in (stacks, lost, within))
    if not (shapes and kinds and room >= LEAST_ROOM and rows.min() >= 1 and rows.max() < room):
        raise ParameterError("the arrays of the state do not fit together; begin another")
    if in_place and not all(part.flags.writeable for part in _parts(state)):
        raise ParameterError("the state is read-only; give a copy, or in_place=False")


def _same_relays(a: Preisach, b: Preisach) -> bool:
    """Whether the same memory gives the same output of the relays."""
    return a is b or (
        (a.relay, a.diagonal, a.offset) == (b.relay, b.diagonal, b.offset)
        and np.array_equal(a.levels, b.levels)
        and np.array_equal(a.weights, b.weights)
    )

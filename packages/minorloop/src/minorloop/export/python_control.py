"""Convert a model to a system of python-control, with memory and dynamics as the state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_whole
from minorloop.dynamics.cascade import Cascade, CascadeState
from minorloop.errors import MissingExtraError, ParameterError
from minorloop.operators.memory import LEAST_ROOM, MOST_ROOM, ROOM, Memory, Start
from minorloop.operators.prandtl_ishlinskii import PlayStart, PrandtlIshlinskii
from minorloop.operators.preisach import Preisach

Operator: TypeAlias = Preisach | PrandtlIshlinskii
Step = Callable[[FloatArray, float], tuple[float, FloatArray]]
Update = Callable[[float, FloatArray, FloatArray, Mapping[str, Any]], Any]


def as_system(
    model: Operator | Cascade,
    interval: float | Literal[True] = True,
    *,
    room: int = ROOM,
    feedthrough: bool = True,
    name: str = "hysteresis",
    input: str = "u",
    output: str = "y",
) -> Any:
    """Return a model as a discrete-time ``control.NonlinearIOSystem``.

    Update and output are pure functions of state and input, so the system can be connected and
    simulated any number of times. Begin a simulation from `as_state` with the same room. A state
    that is not a memory of the operator, such as zeros, is refused. So linearisation and the search
    for operating points, which try such states, are not possible for a Preisach operator.

    Raises a `MissingExtraError` if python-control is not installed; a `ParameterError` if the model
    is of another class, there is too little room, the interval is not positive or not that of the
    linear part, or ``feedthrough`` is false for a cascade; in a simulation, if a state is not a
    memory.

    Parameters
    ----------
    model : Preisach, PrandtlIshlinskii or Cascade
        The operator, or one of these with dynamics. Dead time is rounded to whole intervals.
    interval : float or True
        Seconds between samples; True if it does not matter, which needs an operator, or a
        cascade with a sampled linear part.
    room : int
        Extrema in the state of a Preisach operator, at least 6. When a history has more, the
        smallest loop is dropped.
    feedthrough : bool
        Whether the output depends on the input at the same time, as that of a hysteresis does. If
        not, it belongs to the previous input, which breaks algebraic loops. The linear part of a
        Preisach operator then has clamped inputs beyond the levels, like the state. Always true for
        a cascade.
    name, input, output : str
        Names of the system and its signals.
    """
    if interval is not True and not as_finite("interval", interval) > 0:
        raise ParameterError(f"interval is {interval!r} s; give a positive time, or True")
    if isinstance(model, Cascade):
        if not feedthrough:
            raise ParameterError("feedthrough is False; omit it, because cascades always have it")
        model = _sampled(model, interval)
        interval = model.linear.interval or True
    try:
        from control import NonlinearIOSystem
    except ImportError:
        raise MissingExtraError("python-control", "control") from None
    size = as_state(model, room=room).size
    step = _step(model, room)

    def update(t: float, x: FloatArray, u: FloatArray, params: Mapping[str, Any]) -> FloatArray:
        return step(np.asarray(x), float(np.ravel(u)[0]))[1]

    def answer(t: float, x: FloatArray, u: FloatArray, params: Mapping[str, Any]) -> float:
        if feedthrough or isinstance(model, Cascade):
            return step(np.asarray(x), float(np.ravel(u)[0]))[0]
        return _rest(model, np.asarray(x))

    return NonlinearIOSystem(
        update,
        answer,
        inputs=[input],
        outputs=[output],
        states=[f"x[{k}]" for k in range(size)],
        dt=interval,
        name=name,
    )


def as_state(
    model: Operator | Cascade,
    start: Start | PlayStart | None = None,
    *,
    room: int = ROOM,
    before: float | None = None,
    interval: float | Literal[True] = True,
) -> FloatArray:
    """Return an initial state of `as_system`.

    Raises a `ParameterError` if the model is of another class, or there is too little room.

    Parameters
    ----------
    model : Preisach, PrandtlIshlinskii or Cascade
        The model.
    start : start state of the operator, optional
        Memory; by default negative saturation of a Preisach operator, or demagnetised plays. Plays
        have no saturation: after ``"negative"`` they are infinitely far down until an input moves
        them.
    room : int
        As for `as_system`.
    before : float, optional
        Input at which a cascade has settled; by default the last input of ``start``, or 0 for
        plays.
    interval : float or True
        As for `as_system`.

    Returns
    -------
    (room,) or (plays,) array, longer for a cascade
        The remembered extrema, oldest first, with the present input repeated to the end; or the
        positions of the plays. For a cascade, the states of its linear part and its creep follow.
    """
    if isinstance(model, Cascade):
        operator = as_state(model.operator, start, room=room)  # type: ignore[arg-type]
        if before is None:
            before = as_memory(operator).u if isinstance(model.operator, Preisach) else 0.0
        settled = _sampled(model, interval).begin(before, _memory(model.operator, operator))
        states = [_room(model.operator, settled.memory, room), settled.linear]
        return np.concatenate([*states, () if settled.creep is None else settled.creep])
    if isinstance(model, PrandtlIshlinskii):
        plays = "demagnetised" if start is None else start
        return np.array(model.positions(plays))  # type: ignore[arg-type]
    if not isinstance(model, Preisach):
        raise ParameterError(
            f"the model is a {type(model).__name__}; give a Preisach or a PrandtlIshlinskii"
        )
    as_whole("room", room, LEAST_ROOM, MOST_ROOM)
    memory = model.memory("negative" if start is None else start)  # type: ignore[arg-type]
    return _padded(bounded(model, memory, room), room)


def as_memory(state: npt.ArrayLike) -> Memory:
    """Return the memory in a state of a Preisach operator.

    Raises a `ParameterError` if the state is not a memory.
    """
    values = np.asarray(state, dtype=np.float64)
    changes = np.flatnonzero(np.diff(values))
    extrema = values[: changes[-1] + 2] if changes.size else values[:1]
    try:
        return Memory(extrema.tolist())
    except ParameterError as error:
        raise ParameterError(
            "a state is not a memory; begin from as_state(model) with the room of the system, or "
            f"python-control fills it up with zeros ({error})"
        ) from None


def _memory_of(model: Preisach, state: FloatArray) -> Memory:
    """Return the memory in a state; refuse the state of another operator."""
    low = float(model.levels[0])
    if state[0] != low:
        raise ParameterError(
            f"a state begins with {float(state[0])!r} and not with the lowest level, {low!r}; "
            "begin from as_state(model)"
        )
    return as_memory(state)


def _padded(memory: Memory, room: int) -> FloatArray:
    extrema = np.array(memory.extrema)
    return np.append(extrema, np.full(room - extrema.size, extrema[-1]))


def _memory(operator: Any, state: FloatArray) -> Any:
    """Return the memory of an operator in its state."""
    return _memory_of(operator, state) if isinstance(operator, Preisach) else state


def _room(operator: Any, memory: Any, room: int) -> FloatArray:
    """Return the state of an operator for its memory."""
    if isinstance(operator, Preisach):
        return _padded(bounded(operator, memory, room), room)
    return np.array(memory)


def _sampled(model: Cascade, interval: float | Literal[True]) -> Cascade:
    """Return a cascade with a linear part that is sampled at this interval."""
    if model.ahead is not None:
        raise ParameterError(
            "the cascade has dynamics on both sides of the operator, which the export to "
            "python-control does not support; identify it with dynamics on one side"
        )
    if interval is not True:
        return model.sampled(interval)
    if model.linear.interval is None:
        raise ParameterError("the linear part is continuous; give the interval in seconds")
    return model


def _step(model: Operator | Cascade, room: int) -> Step:
    """Return the function from state and input to output and next state."""
    operator = model.operator if isinstance(model, Cascade) else model

    def alone(x: FloatArray, u: float) -> tuple[float, FloatArray]:
        y, memory = operator.step(_memory(operator, x), u)
        return float(y), _room(operator, memory, room)

    if not isinstance(model, Cascade):
        return alone
    size, order = as_state(operator, room=room).size, model.linear.order + model.linear.lag  # type: ignore[arg-type]

    def together(x: FloatArray, u: float) -> tuple[float, FloatArray]:
        memory, linear, creep = np.split(x, [size, size + order])
        state = CascadeState(_memory(operator, memory), linear, creep if model.creep else None)
        y, after = model.step(state, u)
        states = [_room(operator, after.memory, room), after.linear]
        return y, np.concatenate([*states, () if after.creep is None else after.creep])

    return together


def _rest(model: Preisach | PrandtlIshlinskii, x: FloatArray) -> float:
    """Return the output in a state."""
    if isinstance(model, Preisach):
        memory = _memory_of(model, x)
        return float(model.step(memory, memory.u)[0])
    return float(model.weights @ x + model.offset)


def bounded(model: Preisach, memory: Memory, room: int) -> Memory:
    """Drop the smallest loops of a memory until it has fewer than ``room`` past extrema.

    ``model``: the operator; the smallest loop has the least sum of absolute weights; ``memory``:
    the memory; ``room``: one more than the number of extrema to keep, without the present input; at
    least 4.
    """
    extrema = list(memory.extrema)
    if len(extrema) <= room:
        return memory
    size = Preisach(model.levels, np.abs(model.weights), diagonal=model.diagonal)
    while len(extrema) > room:
        values = np.array(extrema[:-1])
        a, b, c, d = (values[k : values.size - 3 + k] for k in range(4))
        loss = _weight(size, a, b) - _weight(size, b, c) + _weight(size, c, d) - _weight(size, a, d)
        least = 1 + int(np.argmin(np.abs(loss)))
        del extrema[least : least + 2]
    return Memory(extrema)


def _weight(size: Preisach, p: FloatArray, q: FloatArray) -> FloatArray:
    return size.everett(np.maximum(p, q), np.minimum(p, q))

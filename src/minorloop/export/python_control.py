"""A model as an input-output system of python-control, with its memory as the state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import MissingExtraError, ParameterError
from minorloop.export._bounded import bounded
from minorloop.operators.memory import Memory
from minorloop.operators.prandtl_ishlinskii import PlayStart, PrandtlIshlinskii
from minorloop.operators.preisach import Preisach, Start

__all__ = ["as_memory", "as_state", "as_system"]

LEAST_ROOM = 6
Update = Callable[[float, FloatArray, FloatArray, Mapping[str, Any]], Any]


def as_system(
    model: Preisach | PrandtlIshlinskii,
    interval: float | Literal[True] = True,
    *,
    room: int = 64,
    feedthrough: bool = True,
    name: str = "hysteresis",
    input: str = "u",
    output: str = "y",
) -> Any:
    """A model as a discrete-time ``control.NonlinearIOSystem``.

    Its update and output are pure functions of state and input, so it can be simulated,
    connected and simulated again. Begin a simulation from `as_state`; a state of zeros is no
    memory.

    Parameters
    ----------
    model : Preisach or PrandtlIshlinskii
        The operator.
    interval : float or True
        Seconds between samples; True where it does not matter.
    room : int
        Extrema that the state of a Preisach operator has room for, at least 6. When a history
        has more, the smallest loop is dropped.
    feedthrough : bool
        Whether the output answers to the input of the same instant, as a hysteresis does. If
        not, it is that of the input before, which breaks algebraic loops; the linear part of a
        Preisach operator then sees inputs beyond the levels clamped to them, as the state does.
    name, input, output : str
        Names of the system and its signals.

    Returns
    -------
    control.NonlinearIOSystem

    Raises
    ------
    MissingExtraError
        If python-control is not installed.
    ParameterError
        If the model is of another kind, or there is too little room.
    """
    try:
        from control import NonlinearIOSystem
    except ImportError:
        raise MissingExtraError("python-control", "control") from None
    size = as_state(model, room=room).size
    step = _preisach_step(model, room) if isinstance(model, Preisach) else _plays_step(model)

    def update(t: float, x: FloatArray, u: FloatArray, params: Mapping[str, Any]) -> FloatArray:
        return step(np.asarray(x), float(np.ravel(u)[0]))[1]

    def answer(t: float, x: FloatArray, u: FloatArray, params: Mapping[str, Any]) -> float:
        if feedthrough:
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
    model: Preisach | PrandtlIshlinskii,
    start: Start | PlayStart = "negative",
    *,
    room: int = 64,
) -> FloatArray:
    """Initial state of `as_system`.

    Parameters
    ----------
    model : Preisach or PrandtlIshlinskii
        The operator.
    start : start state of the operator
        What is remembered.
    room : int
        As for `as_system`.

    Returns
    -------
    (room,) or (plays,) array
        The remembered extrema, oldest first, the present input repeated to the end; or the
        positions of the plays.

    Raises
    ------
    ParameterError
        If the model is of another kind, or there is too little room.
    """
    if isinstance(model, PrandtlIshlinskii):
        return np.array(model.positions(start))  # type: ignore[arg-type]
    if not isinstance(model, Preisach):
        raise ParameterError(
            f"a {type(model).__name__} has no state here; give a Preisach or a PrandtlIshlinskii"
        )
    if room < LEAST_ROOM:
        raise ParameterError(f"room is {room} extrema; give at least {LEAST_ROOM}")
    return _padded(bounded(model, model.memory(start), room), room)  # type: ignore[arg-type]


def as_memory(state: npt.ArrayLike) -> Memory:
    """The memory that a state of a Preisach operator stands for.

    Raises
    ------
    ParameterError
        If the state is no memory.
    """
    values = np.asarray(state, dtype=np.float64)
    return Memory(values[np.append(True, np.diff(values) != 0)])


def _padded(memory: Memory, room: int) -> FloatArray:
    extrema = np.array(memory.extrema)
    return np.append(extrema, np.full(room - extrema.size, extrema[-1]))


def _preisach_step(
    model: Preisach, room: int
) -> Callable[[FloatArray, float], tuple[float, FloatArray]]:
    def step(x: FloatArray, u: float) -> tuple[float, FloatArray]:
        y, memory = model.step(as_memory(x), u)
        return y, _padded(bounded(model, memory, room), room)

    return step


def _plays_step(
    model: PrandtlIshlinskii,
) -> Callable[[FloatArray, float], tuple[float, FloatArray]]:
    def step(x: FloatArray, u: float) -> tuple[float, FloatArray]:
        y, after = model.step(x, u)
        return y, np.array(after)

    return step


def _rest(model: Preisach | PrandtlIshlinskii, x: FloatArray) -> float:
    """Output that goes with a state."""
    if isinstance(model, Preisach):
        memory = as_memory(x)
        return float(model.step(memory, memory.u)[0])
    return float(model.weights @ x + model.offset)

"""The firmware of a board on an emulated Cortex-M4F: its inputs against Python, and its cost."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks._cortex import COMPILER, EMULATOR, HERE, run
from minorloop.arrays import FloatArray
from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.serial_line import parse, write
from minorloop.operators.preisach import Preisach
from minorloop_head.board import BoardAxis, BoardSource, board_source
from minorloop_head.heated_wire import HeatedWire
from papers.catheter.control.laws import Feedforward

INTERVAL = 0.04
COUPLING = np.array([[1.0, 0.07], [0.06, 1.0]])
_FILES = "control.c", "protocol.c", "numbers.c", "axis0.c", "axis1.c"
_HIGH, _RATE = 0.4, 5.0
_NUMBERS = 65_536


@dataclass(frozen=True)
class BoardCount:
    """Instructions and stack of a tick of both axes and of a question, and the error of the inputs.

    Parameters
    ----------
    inputs : (T, 2) array
        After each tick, by the board.
    stack : int
        Bytes, the question included.
    """

    inputs: FloatArray
    worst_tick: int
    mean_tick: int
    worst_question: int
    mean_question: int
    stack: int

    def errors(self, axes: list[BoardAxis], expected: FloatArray) -> tuple[float, float]:
        """Return the largest differences of inputs and of their outputs, as shares of the ranges.

        Parameters
        ----------
        axes : list of BoardAxis
        expected : (T, 2) array
            Inputs by Python.
        """
        ends = np.array([(axis.input.low, axis.input.high) for axis in axes])
        reach = np.array([axis.operator.range for axis in axes])
        moved = outputs_of(axes, self.inputs) - outputs_of(axes, expected)
        return (
            float((np.abs(self.inputs - expected) / np.ptp(ends, axis=1)).max()),
            float((np.abs(moved) / np.ptp(reach, axis=1)).max()),
        )


def heated_axes(bands: int = 12) -> list[BoardAxis]:
    """Return pan and tilt of a head, with currents of which the limits matter."""
    return [
        BoardAxis(
            model=HeatedWire(_operator(k, np.linspace(0.0, 0.16, bands + 1), 60.0), 4.0, 0.003),
            input=Channel(f"{name} current", "A", 0.0, _HIGH, _RATE),
            output=Channel(name, "deg", -10.0, 90.0),
        )
        for k, name in enumerate(("pan", "tilt"))
    ]


def static_axes(bands: int = 20) -> list[BoardAxis]:
    """Return two axes without dynamics, such as of a piezo stage."""
    return [
        BoardAxis(
            model=_operator(k, np.linspace(-1.0, 1.0, bands + 1), 100.0),
            input=Channel(f"voltage {k}", "V", -1.0, 1.0, 2.0 / INTERVAL),
            output=Channel(f"position {k}", "um"),
        )
        for k in (10, 11)
    ]


def _operator(seed: int, levels: FloatArray, swing: float) -> Preisach:
    bands = levels.size - 1
    weights = np.tril(np.random.default_rng(1000 + seed).uniform(0.0, 1.0, (bands, bands)))
    return Preisach(levels, swing * weights / weights.sum(), relay="unipolar")


def targets_of(axes: list[BoardAxis], ticks: int) -> FloatArray:
    """Return targets (T, 2) over the whole reach: steps, holds and sines of changing amplitude."""
    rng, k = np.random.default_rng(1000), np.arange(ticks)
    found = np.empty((ticks, len(axes)))
    for column, axis in enumerate(axes):
        low, high = axis.operator.range
        steps = np.repeat(rng.uniform(0.0, 1.0, ticks // 40 + 1), 40)[:ticks]
        waves = 0.5 + 0.5 * np.sin(k / (7.0 + column)) * np.abs(np.cos(k / 97.0))
        share = np.where((k // 400) % 2 == column, steps, waves)
        found[:, column] = np.round(low + share * (high - low), 6)
        found[:, column] = np.clip(found[:, column], low, high)
    return found


def expected_inputs(
    axes: list[BoardAxis], targets: FloatArray, coupling: FloatArray | None
) -> FloatArray:
    """Return the inputs (T, 2) of the controllers and operators of Python, limited in rate."""
    wanted = targets if coupling is None else _own(axes, targets, coupling)
    columns = []
    for axis, goals in zip(axes, wanted.T, strict=True):
        follow = _heated if isinstance(axis.model, HeatedWire) else _static
        columns.append(follow(axis, goals))
    return np.array(columns).T


def _own(axes: list[BoardAxis], targets: FloatArray, coupling: FloatArray) -> FloatArray:
    """Return the targets without what the sensors see of the other axis."""
    ends = np.array([axis.operator.range for axis in axes])
    own = np.clip(targets @ np.linalg.inv(coupling).T, ends[:, 0], ends[:, 1])
    return targets - own @ (coupling - np.eye(len(axes))).T


def _heated(axis: BoardAxis, wanted: FloatArray) -> list[float]:
    assert isinstance(axis.model, HeatedWire)
    control = Feedforward(wire=axis.model, interval=INTERVAL, highest=_HIGH)
    state, found = control.begin(), []
    for reference in wanted.tolist():
        before = state.applied
        current, state = control.step(state, reference)
        current = _limited(axis, current, before)
        state = type(state)(state.wire, current)
        found.append(current)
    return found


def _static(axis: BoardAxis, wanted: FloatArray) -> list[float]:
    assert isinstance(axis.model, Preisach)
    tracker, u, found = axis.model.track(), axis.rest, []
    for reference in wanted.tolist():
        tracker.push(u)
        u = _limited(axis, tracker.aim(reference), u)
        found.append(u)
    return found


def outputs_of(axes: list[BoardAxis], inputs: FloatArray) -> FloatArray:
    """Return the outputs (T, 2) of the models of Python for inputs, without coupling."""
    columns = []
    for axis, u in zip(axes, inputs.T, strict=True):
        model = axis.model
        if isinstance(model, HeatedWire):
            columns.append(model.simulate(INTERVAL * np.arange(u.size), u))
        else:
            columns.append(model.simulate(u))
    return np.array(columns).T


def _limited(axis: BoardAxis, u: float, before: float) -> float:
    most = axis.input.rate * INTERVAL
    u = min(max(u, axis.input.low), axis.input.high)
    return min(max(u, before - most), before + most)


def count_board(
    axes: list[BoardAxis],
    targets: FloatArray,
    *,
    float32: bool = False,
    coupling: FloatArray | None = None,
) -> BoardCount:
    """Compile a firmware for a Cortex-M4F, let it follow targets in an emulator, and count."""
    code = board_source(axes, float32=float32, coupling=coupling, interval=INTERVAL)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        code.write(folder, force=True)
        return _counted(folder, targets)


def _counted(folder: Path, targets: FloatArray) -> BoardCount:
    (folder / "lines.txt").write_text("".join(f"{line}\n" for line in _questions(targets)))
    for file in ("start.c", "start.h", "systick.h", "count_board.c"):
        shutil.copy(HERE / file, folder)
    shutil.copy(HERE / "link.ld", folder / "count.ld")
    link = ["-nostartfiles", "-T", "count.ld", "start.c", "count_board.c", *_FILES]
    run([*COMPILER, *link, "-lm", "-lgcc", "-lc", "-o", "count.elf"], folder)
    answers, _, counted = run([*EMULATOR.split(), "count.elf"], folder).partition("counted ")
    lines = answers.splitlines()[2::2]
    inputs = []
    for k, line in enumerate(lines):
        good = parse(line, _number(2 * k + 2))
        if good is None or not good[0]:
            raise RuntimeError(f"the board answers {line!r}")
        inputs.append([float(word) for word in good[1]])
    return BoardCount(np.array(inputs), *map(int, counted.split()))


def _questions(targets: FloatArray) -> list[str]:
    """Return a greeting, then for each tick targets, and a question for the inputs."""
    lines = [write(0, "HELLO")]
    for k, row in enumerate(targets.tolist()):
        lines.append(write(_number(2 * k + 1), "FOLLOW", *map(repr, row)))
        lines.append(write(_number(2 * k + 2), "ON"))
    return lines


def _number(k: int) -> int:
    return k % _NUMBERS


def text_bytes(code: BoardSource) -> int:
    """Return the bytes of a linked firmware in flash."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        code.write(folder, force=True)
        run(["make", "-s"], folder)
        size = run(["arm-none-eabi-size", "firmware.elf"], folder).splitlines()[1].split()
    return int(size[0]) + int(size[1])

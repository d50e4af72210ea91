"""Exported C: speed on this machine, and instructions and errors on an emulated Cortex-M4F."""

from __future__ import annotations

import ctypes
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import _board
from benchmarks._cortex import COMPILER, EMULATOR, HERE, missing_tools, run
from benchmarks._timing import Row, best, faster
from minorloop import Preisach
from minorloop.export._tables import Numbers
from minorloop.export.c99 import source

CLOCK = 100e6
WARNINGS = "-Wall -Wextra -Werror -pedantic"


@dataclass(frozen=True)
class Count:
    """Instructions of one call, and bytes."""

    worst_step: int
    mean_step: int
    worst_aim: int
    mean_aim: int
    state_bytes: int
    code_bytes: int
    table_bytes: int


HOST_LOOP = """
#include "minorloop.h"
__attribute__((visibility("default"))) void walk(const double *u, double *y, long count);
void walk(const double *u, double *y, long count)
{
    minorloop_state state;
    minorloop_reset(&state);
    for (long k = 0; k < count; ++k) {
        y[k] = minorloop_step(&state, u[k]);
    }
}
"""


def rows(quick: bool = False) -> list[Row]:
    samples = 10_000 if quick else 1_000_000
    found = [row for kind in ("random", "smooth") for row in _host(samples, kind)]
    if missing_tools():
        return [*found, Row(f"Cortex-M4F: not measured without {missing_tools()[0]}", 0.0)]
    for bands in (10, 20, 50, 100):
        seen = count(bands)
        text = (
            f"step worst {seen.worst_step}, mean {seen.mean_step}; aim worst {seen.worst_aim}, "
            f"mean {seen.mean_aim}; bytes: state {seen.state_bytes}, tables {seen.table_bytes}, "
            f"code {seen.code_bytes}"
        )
        met = seen.worst_step <= 2000 and seen.state_bytes <= 2048 if bands == 20 else None
        required = "<= 2000 instructions, <= 2048 bytes" if bands == 20 else ""
        at = seen.worst_step / CLOCK
        what = f"Cortex-M4F at 100 MHz and one instruction a cycle, L = {bands}: worst step"
        found.append(Row(what, at, required=required, met=met, accuracy=text))
    return [*found, *_board_rows(500 if quick else 10_000)]


def _board_rows(ticks: int) -> list[Row]:
    """Return a row for each kind of axes and type of the firmware of a board."""
    found = []
    for kind, axes, coupling in (
        ("two heated wires", _board.heated_axes(), _board.COUPLING),
        ("two operators", _board.static_axes(), None),
    ):
        targets = _board.targets_of(axes, ticks)
        expected = _board.expected_inputs(axes, targets, coupling)
        for float32 in (False, True):
            seen = _board.count_board(axes, targets, float32=float32, coupling=coupling)
            error, moved = seen.errors(axes, expected)
            text = (
                f"inputs differ from Python by {error:.2g} of range in {ticks} ticks, outputs by "
                f"{moved:.2g}; tick worst {seen.worst_tick}, mean {seen.mean_tick} instructions; "
                f"question worst {seen.worst_question}, mean {seen.mean_question}; stack "
                f"{seen.stack} bytes"
            )
            real = "float" if float32 else "double"
            found.append(
                Row(
                    f"Cortex-M4F, firmware of a board, {kind}, {real}: worst tick",
                    seen.worst_tick / CLOCK,
                    required="" if float32 else "differ by <= 1e-6 of range",
                    met=None if float32 else max(error, moved) <= 1e-6,
                    accuracy=text,
                )
            )
    return found


def _host(samples: int, kind: str) -> list[Row]:
    """A loop over the C step, against Python called once a sample, and its compiled loop.

    All are for the processor of this machine, as the compiled loop of Python is.
    """
    model, rng = a_model(100), np.random.default_rng(1)
    u = rng.uniform(-1, 1, samples) if kind == "random" else 0.99 * np.sin(np.arange(samples) / 500)
    y = np.empty_like(u)
    with tempfile.TemporaryDirectory() as scratch:
        folder = source(model).write(Path(scratch) / "c")
        (folder / "walk.c").write_text(HOST_LOOP)
        flags = ["-std=c99", "-O2", "-march=native", "-shared", "-fPIC", "-fvisibility=hidden"]
        run(["cc", *flags, "minorloop.c", "walk.c", "-lm", "-o", "model.so"], folder)
        walk = ctypes.CDLL(str(folder / "model.so")).walk
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (u, y)]
    expected = model.simulate(u)
    ours, theirs = best(
        lambda: walk(*pointers, ctypes.c_long(samples)), lambda: model.simulate(u), rounds=9
    )
    error = float(np.abs(y - expected).max() / np.ptp(model.range))
    few, tracker = u[: min(samples, 20_000)], model.track()
    called = best(lambda: [tracker.push(float(x)) for x in few], rounds=2)[0] / few.size
    return [
        faster(
            f"C step in a loop, L = 100, {kind}, a sample",
            ours / samples,
            way,
            a_sample,
            1.0,
            f"differ by {error:.1g} of range",
            error <= 1e-12,
        )
        for way, a_sample in (
            ("the kernel of Python called in a loop", called),
            ("the compiled loop of Python", theirs / samples),
        )
    ]


def a_model(bands: int) -> Preisach:
    rng = np.random.default_rng(bands)
    levels = np.linspace(-1, 1, bands + 1)
    return Preisach(levels, np.tril(rng.uniform(0, 1, (bands, bands))))


def count(bands: int, memory: int = 32, inputs: np.ndarray | None = None) -> Count:
    """Compile a model of so many bands for a Cortex-M4F, run it emulated, and count."""
    model = a_model(bands)
    code = source(model, float32=True, memory=memory)
    with tempfile.TemporaryDirectory() as scratch:
        folder = code.write(Path(scratch) / "c")
        u = _inputs() if inputs is None else inputs
        (folder / "inputs.h").write_text(_header(model, u))
        for file in ("start.c", "start.h", "systick.h", "count.c", "link.ld"):
            shutil.copy(HERE / file, folder)
        run([*COMPILER, *WARNINGS.split(), "-c", "minorloop.c"], folder)
        size = run(["arm-none-eabi-size", "-A", "minorloop.o"], folder)
        text = sum(int(line.split()[1]) for line in size.splitlines() if ".text" in line)
        sources = ["start.c", "count.c", "minorloop.o"]
        link = ["-nostartfiles", "-T", "link.ld", *sources, "-lm", "-lgcc", "-o", "count.elf"]
        run([*COMPILER, *link], folder)
        said = run([*EMULATOR.split(), "count.elf"], folder)
    *figures, state_bytes = map(int, said.split())
    return Count(*figures, state_bytes, text, code.table_bytes)


def _inputs(samples: int = 4000) -> np.ndarray:
    """Jumps over the whole plane, then alternations that shrink until memory overflows."""
    rng = np.random.default_rng(0)
    k = np.arange(samples // 2)
    shrink = 1 - (k % 193) / 193
    deep = np.where(k % 2, 1, -1) * shrink * rng.uniform(0.995, 1, k.size)
    return np.concatenate([rng.uniform(-1.05, 1.05, samples - k.size), deep])


def _header(model: Preisach, u: np.ndarray) -> str:
    numbers = Numbers(True)
    width = float(np.ptp(model.range))
    return (
        f"#define COUNT {u.size}\n#define WIDTH {numbers.one(width)}\n"
        f"static const float inputs[COUNT] = {{\n{numbers.table(u)}\n}};\n"
        f"static const float targets[COUNT] = {{\n{numbers.table(model.simulate(u))}\n}};\n"
    )

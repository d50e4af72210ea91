"""Exported C: speed on this machine, and instructions on an emulated Cortex-M4F."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks._timing import Row, best, faster
from minorloop import Preisach
from minorloop.export._tables import Numbers
from minorloop.export.c99 import source

HERE = Path(__file__).parent / "cortex_m4"
TOOLS = ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
COMPILER = [
    *("arm-none-eabi-gcc", "-std=c99", "-O2", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard"),
    *("-mfpu=fpv4-sp-d16", "-ffreestanding", "-fno-math-errno"),
]
CLOCK = 100e6
WARNINGS = "-Wall -Wextra -Werror -pedantic"
EMULATOR = (
    "qemu-system-arm -M mps2-an386 -nographic -monitor none -serial none -icount shift=6,sleep=off "
    "-semihosting-config enable=on,target=native -kernel"
)


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
        _run(["cc", *flags, "minorloop.c", "walk.c", "-lm", "-o", "model.so"], folder)
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


def missing_tools() -> list[str]:
    """What is not installed of what an emulated count needs."""
    return [tool for tool in TOOLS if shutil.which(tool) is None]


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
        for file in ("start.c", "start.h", "count.c", "link.ld"):
            shutil.copy(HERE / file, folder)
        _run([*COMPILER, *WARNINGS.split(), "-c", "minorloop.c"], folder)
        size = _run(["arm-none-eabi-size", "-A", "minorloop.o"], folder)
        text = sum(int(line.split()[1]) for line in size.splitlines() if ".text" in line)
        sources = ["start.c", "count.c", "minorloop.o"]
        link = ["-nostartfiles", "-T", "link.ld", *sources, "-lm", "-lgcc", "-o", "count.elf"]
        _run([*COMPILER, *link], folder)
        said = _run([*EMULATOR.split(), "count.elf"], folder)
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


def _run(command: list[str], folder: Path) -> str:
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{command[0]} failed: {done.stdout}{done.stderr}")
    return done.stdout or done.stderr  # the emulator says what the program says on stderr

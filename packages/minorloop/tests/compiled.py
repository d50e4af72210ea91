"""Exported C, compiled and called from Python."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

WARNINGS = [
    "-std=c99",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wconversion",
    "-Wshadow",
    "-Wdouble-promotion",
    "-Wstrict-prototypes",
    "-Wmissing-prototypes",
]
SANITIZED = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]

HARNESS = """
#include "minorloop.h"
long state_bytes(void);
void walk(const minorloop_real *u, minorloop_real *y, minorloop_real *bound, long count);
{chase_prototype}
long state_bytes(void) {{ return (long)sizeof(minorloop_state); }}
void walk(const minorloop_real *u, minorloop_real *y, minorloop_real *bound, long count)
{{
    minorloop_state state;
    long k;
    minorloop_reset(&state);
    for (k = 0; k < count; ++k) {{
        y[k] = minorloop_step(&state, u[k]);
        bound[k] = minorloop_error_bound(&state);
    }}
}}
{chase}
"""
CHASE_PROTOTYPE = (
    "void chase(const minorloop_real *target, minorloop_real *u, minorloop_real *y, long count);"
)
CHASE = """
void chase(const minorloop_real *target, minorloop_real *u, minorloop_real *y, long count)
{
    minorloop_state state;
    long k;
    minorloop_reset(&state);
    for (k = 0; k < count; ++k) {
        u[k] = minorloop_aim(&state, target[k]);
        y[k] = minorloop_step(&state, u[k]);
    }
}
"""


def compiler(name):
    """Return the compiler; skip the test if it is missing."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"needs {name}, which is not installed")
    return found


def build(folder, sources, *options, program="program", cc="gcc"):
    """Compile C files of a folder, with warnings as errors."""
    command = [compiler(cc), *WARNINGS, *options, *sources, "-o", program]
    command += [] if "-c" in options else ["-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / program


def board(code, folder, *options):
    """Compile exported firmware with the board of ``board.c``, as a program."""
    code.write(folder)
    (folder / "board.c").write_bytes(Path(__file__).with_name("board.c").read_bytes())
    return build(folder, ["minorloop.c", "minorloop_firmware.c", "board.c"], *options)


def self_test(code, folder, *options, cc="gcc"):
    """Compile the self-test and run it; return what it printed."""
    code.write(folder)
    program = build(folder, ["minorloop.c", "minorloop_selftest.c"], *options, cc=cc)
    done = subprocess.run([program], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


class Compiled:
    """Exported C as functions of arrays."""

    def __init__(self, code, folder, harness=HARNESS):
        code.write(folder)
        both = "minorloop_aim" in code.files["minorloop.h"]
        text = harness.format(
            chase_prototype=CHASE_PROTOTYPE if both else "", chase=CHASE if both else ""
        )
        (folder / "harness.c").write_text(text)
        options = "-O2", "-shared", "-fPIC"
        path = build(folder, ["minorloop.c", "harness.c"], *options, program="model.so")
        self.library = ctypes.CDLL(str(path))
        single = "typedef float" in code.files["minorloop.h"]
        self.type = np.float32 if single else np.float64

    @property
    def state_bytes(self):
        return self.library.state_bytes()

    def walk(self, u):
        """Outputs, and the error bound after each."""
        return self._call(self.library.walk, u)

    def chase(self, targets):
        """Inputs that lead to the targets, and the outputs for them."""
        return self._call(self.library.chase, targets)

    def _call(self, function, values):
        given = np.ascontiguousarray(values, dtype=self.type)
        first, second = np.empty_like(given), np.empty_like(given)
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (given, first, second)]
        function(*pointers, ctypes.c_long(given.size))
        return first, second

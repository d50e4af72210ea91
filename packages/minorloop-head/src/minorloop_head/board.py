"""Export of models as complete firmware for a Cortex-M4 board, with feedforward on the board.

The firmware speaks the protocol of `minorloop.lab.drivers.serial_board`, with two more queries:
``FOLLOW y ...`` sets targets, to which the exact inverses of the models lead from then on, and
``ON`` returns the present inputs. Each axis has limits of value and rate on the board. Without a
query for its patience the board goes to its safe inputs.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop import modelfile
from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ModelFileError, ParameterError
from minorloop.export._tables import Numbers, render
from minorloop.export.c99 import source
from minorloop.files import PathLike, write_folder
from minorloop.lab.actuator import Channel
from minorloop.lab.records import Quantity
from minorloop.operators.memory import ROOM
from minorloop.operators.preisach import Preisach
from minorloop.version import __version__
from minorloop_head.control.controller import INTERVAL
from minorloop_head.geometry import AXES
from minorloop_head.heated_wire import SMALLEST_CHANGE, SOLVES, HeatedWire
from minorloop_head.procedures.head_file import FORMAT, read_head

__all__ = ["HEAD_LINES", "BoardAxis", "BoardSource", "board_of", "board_source"]

_MOST_AXES = 4
"""Largest number of axes whose numbers fit into a line of the protocol."""
_MOST_LINES = 8
"""Largest number of digital lines: a port of eight pins. One digit of the protocol allows ten."""
_LOW, _HIGH = -10.0, 90.0
"""Angles in degrees beyond which a reading of a head is an error."""
_FILES = (
    *("control.c", "control.h", "protocol.c", "protocol.h", "numbers.c", "numbers.h", "hal.h"),
    *("main.c", "mps2.c", "startup.c", "link.ld", "Makefile", "README.md", "bench.toml"),
)

Lines: TypeAlias = Sequence[tuple[str, bool]]

HEAD_LINES: Lines = (("led 1", True), ("led 2", True), ("led 3", True), ("pump", False))
"""Digital lines of a head, and their states where it is safe."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardAxis:
    """An axis of a board: a model, the channels on both sides of it, and the safe input.

    Raises a `ParameterError` if the model is of another kind, the limits are not finite or beyond
    the levels of the model, rest is beyond the limits, or a unit cannot be written on a line.
    """

    model: Preisach | HeatedWire
    """Model from input to output; monotone. The input of a `HeatedWire` is a current in A."""
    input: Channel
    """Channel with finite limits, and a rate limit if there is one."""
    output: Channel
    rest: float = 0.0
    """Safe input."""

    def __post_init__(self) -> None:
        if not isinstance(self.model, Preisach | HeatedWire):
            raise ParameterError(
                f"the model of {self.input.name} is a {type(self.model).__name__}; firmware is "
                "written for Preisach models and heated wires"
            )
        low, high = self.input.low, self.input.high
        if not (math.isfinite(low) and math.isfinite(high)):
            raise ParameterError(f"{self.input.name} has no limits; give both")
        if isinstance(self.model, HeatedWire) and low < 0:
            raise ParameterError(f"{self.input.name} may be {low:g} A; a wire is heated from 0 A")
        if not low <= as_finite("rest", self.rest) <= high:
            raise ParameterError(
                f"{self.input.name} rests at {self.rest:g}; give one from {low:g} to {high:g}"
            )
        for channel in (self.input, self.output):
            if not channel.unit.isascii() or any(each in channel.unit for each in ' *"\\'):
                raise ParameterError(
                    f"{channel.name} has the unit {channel.unit!r}; give one of ASCII characters "
                    "without spaces, quotes and asterisks"
                )

    @property
    def operator(self) -> Preisach:
        """The operator of the model."""
        return self.model.operator if isinstance(self.model, HeatedWire) else self.model


@dataclass(frozen=True)
class BoardSource:
    """The files of a firmware."""

    files: dict[str, str]
    """Text of each file, by its name."""
    table_bytes: int
    """Bytes of constant tables, in flash."""
    state_bytes: int
    """Bytes of the states of all models, in RAM."""

    def write(self, folder: PathLike, *, force: bool = False) -> None:
        """Write the files into a new or empty folder.

        Raises an `OutputError` if the folder is not empty or cannot be written to.

        ``force``: whether the folder may contain files; those of the same names are replaced.
        """
        write_folder(folder, self.files, force=force)


def board_source(
    axes: Sequence[BoardAxis],
    *,
    coupling: npt.ArrayLike | None = None,
    interval: float = 0.04,
    patience: float = 1.0,
    response: float = 0.4,
    lines: Lines = (),
    serial: str | None = None,
    memory: int = ROOM,
    float32: bool = False,
) -> BoardSource:
    """Return the firmware of a board.

    Raises a `NotInvertibleError` if a model is not monotone; a `ParameterError` if there are too
    many axes or lines, a time is out of its range, or C cannot hold a model.

    Parameters
    ----------
    axes : sequence of BoardAxis
        One to four.
    coupling : (axes, axes) array_like, optional
        Change of each sensor for a change of the output of each axis, as in `HeadControl`.
    interval : float
        Seconds between two steps of models and feedforward: whole milliseconds.
    patience : float
        Seconds without a question until the board goes to its safe inputs.
    response : float
        Time constant in seconds with which a heated wire follows a target.
    lines : sequence of (str, bool)
        Names of digital lines, and their states when the board is safe.
    serial : str, optional
        Serial number of the plant, for the bench file.
    memory : int
        Remembered extrema of each model.
    float32 : bool
        Whether the models compute in single precision.
    """
    if not 1 <= len(axes) <= _MOST_AXES:
        raise ParameterError(f"there are {len(axes)} axes; give 1 to {_MOST_AXES}")
    if len(lines) > _MOST_LINES:
        raise ParameterError(f"there are {len(lines)} lines; give up to {_MOST_LINES}")
    tick = _milliseconds("interval", interval, 1, 1000)
    waits = _milliseconds("patience", patience, 10, 3_600_000)
    if not tick <= 1000 * as_finite("response", response) <= 60_000:
        raise ParameterError(f"response is {response:g} s; give {interval:g} to 60 s")
    numbers, mixing = Numbers(float32), _coupling(coupling, len(axes))
    files: dict[str, str] = {}
    table_bytes = state_bytes = 0
    for k, axis in enumerate(axes):
        heated = isinstance(axis.model, HeatedWire)
        named = f"effective power of the {axis.input.name} [A^2]" if heated else str(axis.input)
        names = Quantity(named), Quantity(str(axis.output))
        known = modelfile.ModelFile(axis.operator, *names, 0, modelfile.Provenance())
        code = source(known, name=f"axis{k}", memory=memory, float32=float32)
        files |= {name: text for name, text in code.files.items() if "selftest" not in name}
        table_bytes += code.table_bytes
        state_bytes += code.state_bytes
    single = "f" if float32 else ""
    context: dict[str, Any] = {
        "version": __version__,
        "axes": [_context(k, each, numbers, tick, response) for k, each in enumerate(axes)],
        "count": len(axes),
        "heated": any(isinstance(each.model, HeatedWire) for each in axes),
        "tick": tick,
        "patience": waits,
        "lines": lines,
        "serial": serial,
        "infinity": math.inf,
        "real": numbers.type,
        "fabs": f"fabs{single}",
        "sqrt": f"sqrt{single}",
        "coupled": not np.array_equal(mixing, np.eye(len(axes))),
        "mixing": _rows(mixing - np.eye(len(axes))),
        "undo": _rows(np.asarray(np.linalg.inv(mixing))),
        "example": " ".join(f"{each.input.low:g}" for each in axes),
        "table_bytes": table_bytes,
        "state_bytes": state_bytes,
    }
    files |= {name: render(f"board/{name}", context, "minorloop_head") for name in _FILES}
    return BoardSource(files, table_bytes, state_bytes)


def _context(
    k: int, axis: BoardAxis, numbers: Numbers, tick: int, response: float
) -> dict[str, Any]:
    """Return the values of an axis for the templates."""
    low, high, rate = axis.input.low, axis.input.high, axis.input.rate
    model = axis.model
    heated = isinstance(model, HeatedWire)
    found = {
        "name": f"axis{k}",
        "input": axis.input,
        "output": axis.output,
        "input_unit": axis.input.unit or "1",
        "output_unit": axis.output.unit or "1",
        **{name: repr(float(v)) for name, v in (("low", low), ("high", high), ("rest", axis.rest))},
        "rated": math.isfinite(rate),
        "rate": repr(rate),
        "step": repr(min(1e-3 * rate, high - low)),
        "reach": axis.operator.range,
        "reach_low": repr(float(axis.operator.range[0])),
        "reach_high": repr(float(axis.operator.range[1])),
        "heated": heated,
    }
    if isinstance(model, HeatedWire):
        found |= {
            "interval": numbers.one(1e-3 * tick),
            "lag": numbers.one(model.lag),
            "latent": numbers.one(model.latent) if model.latent > 0 else "",
            "response": numbers.one(response),
            "smallest": numbers.one(SMALLEST_CHANGE),
            "solves": SOLVES,
        }
    return found


def _milliseconds(name: str, seconds: float, least: int, most: int) -> int:
    """Return whole milliseconds."""
    exact = 1000 * as_finite(name, seconds)
    if not least <= round(exact) <= most or abs(exact - round(exact)) > 1e-6:
        raise ParameterError(
            f"{name} is {seconds:g} s; give whole milliseconds from {1e-3 * least:g} to "
            f"{1e-3 * most:g} s"
        )
    return round(exact)


def _coupling(coupling: npt.ArrayLike | None, count: int) -> FloatArray:
    matrix = np.eye(count) if coupling is None else np.asarray(coupling, dtype=np.float64)
    if matrix.shape != (count, count) or not np.isfinite(matrix).all():
        raise ParameterError(
            f"the coupling has shape {matrix.shape}; give ({count}, {count}) finite numbers"
        )
    if not (np.abs(matrix - np.eye(count)).sum(axis=1) < 0.5).all():
        raise ParameterError(
            "the coupling has rows that differ from the unit matrix by 0.5 or more; such axes "
            "cannot be separated"
        )
    return matrix


def _rows(matrix: FloatArray) -> list[str]:
    """Return the rows of a matrix as C."""
    return [", ".join(repr(float(each)) for each in row) for row in matrix]


def board_of(
    paths: Sequence[Path],
    warn: Callable[[Sequence[str]], None],
    *,
    rate: float | None = None,
    interval: float = INTERVAL,
    **options: Any,
) -> BoardSource:
    """Return the firmware for the file of a head, or for model files, one for each axis.

    Raises a `ModelFileError` if a file cannot be read, or the head is not identified; a
    `ParameterError` as for `board_source`.

    Parameters
    ----------
    paths : sequence of path
    warn : callable
        Called with the warnings of each model file.
    rate : float, optional
        Fastest change of an input in its unit per second; without it its range in one interval.
    interval : float
        Seconds between steps of the feedforward.
    options
        As for `board_source`.
    """
    if len(paths) == 1 and _is_head(paths[0]):
        head = read_head(paths[0])
        known = head.identified
        if known is None:
            raise ModelFileError(f"{paths[0]} has no identified wires; run minorloop head identify")
        high = min(known.highest, math.sqrt(known.limits.highest_power))
        axes = [
            BoardAxis(
                model=wire,
                input=_channel(f"{name} current", "A", 0.0, high, rate, interval),
                output=Channel(name, "deg", _LOW, _HIGH),
            )
            for name, wire in zip(AXES, known.wires, strict=True)
        ]
        options |= {"coupling": known.coupling, "lines": HEAD_LINES, "serial": head.serial}
    else:
        axes = [_axis(path, k, len(paths), rate, interval, warn) for k, path in enumerate(paths)]
    return board_source(axes, interval=interval, **options)


def _axis(
    path: Path,
    k: int,
    count: int,
    rate: float | None,
    interval: float,
    warn: Callable[[Sequence[str]], None],
) -> BoardAxis:
    """Return axis k of a model file; its input is limited to the levels of the model."""
    known = modelfile.read(path)
    warn(known.warnings)
    model: Any = known.model
    if not isinstance(model, Preisach | HeatedWire):
        raise ModelFileError(
            f"{path} has a {type(model).__name__}; firmware is written for Preisach models and "
            "heated wires"
        )
    heated = isinstance(model, HeatedWire)
    operator = model.operator if isinstance(model, HeatedWire) else model
    low, high = map(float, operator.levels[[0, -1]])
    if heated:
        low, high = 0.0, math.sqrt(high)
    number = f" {k + 1}" if count > 1 else ""  # two models may have the same names
    return BoardAxis(
        model=model,
        input=_channel(f"{known.input.name}{number}", known.input.unit, low, high, rate, interval),
        output=Channel(f"{known.output.name}{number}", known.output.unit),
        rest=min(max(0.0, low), high),
    )


def _channel(
    name: str, unit: str, low: float, high: float, rate: float | None, interval: float
) -> Channel:
    """Return an input; without a rate, it changes by its range in an interval."""
    return Channel(name, unit, low, high, (high - low) / interval if rate is None else rate)


def _is_head(path: Path) -> bool:
    """Whether a file has the format of a head; others are read as model files."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("format") == FORMAT

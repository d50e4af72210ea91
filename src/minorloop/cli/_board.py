"""Axes of the firmware of a board, from the file of a head or from model files."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from minorloop import modelfile
from minorloop.cli import _common
from minorloop.dynamics.heated_wire import HeatedWire
from minorloop.errors import ModelFileError
from minorloop.export.board import HEAD_LINES, BoardAxis, BoardSource, board_source
from minorloop.head.geometry import AXES
from minorloop.head.procedures.head_file import FORMAT, read_head
from minorloop.lab.actuator import Channel
from minorloop.operators.preisach import Preisach

_INTERVAL = 0.04
_LOW, _HIGH = -10.0, 90.0
"""Angles in degrees beyond which a reading of a head is an error."""


def board_of(
    paths: Sequence[Path],
    *,
    rate: float | None = None,
    interval: float = _INTERVAL,
    **options: Any,
) -> BoardSource:
    """Return the firmware for the file of a head, or for model files, one for each axis.

    Raises
    ------
    ModelFileError
        If a file cannot be read, or the head is not identified.
    ParameterError
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
        axes = [_axis(path, k, len(paths), rate, interval) for k, path in enumerate(paths)]
    return board_source(axes, interval=interval, **options)


def _axis(path: Path, k: int, count: int, rate: float | None, interval: float) -> BoardAxis:
    """Return axis k of a model file; its input is limited to the levels of the model."""
    known = modelfile.read(path)
    _common.print_warnings(known.warnings)
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
    """Whether a file says that it is of a head; others are read as model files."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("format") == FORMAT

"""The bursts in the journal of a sweep, from which it goes on after it was cut off."""

from __future__ import annotations

import base64
import math
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.cli._journal import NAME, check_folder, check_resumed, parsed_lines, unreadable
from minorloop.errors import RecordError, counted
from minorloop.files import write_atomically

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop.head.ultrasound.echoes import Burst
    from minorloop.head.ultrasound.wall_echoes import SweptBurst

_AGAIN = (
    "delete this line and all lines after it, so that they are fired again, or begin in a new "
    "folder"
)
_LATEST = 1e9
"""Of a time, in seconds."""
_BESIDE = 20e-3
"""How far in metres a burst may be from the swept part, along the pipe."""
_LARGEST = 1e9
"""Of a number of a burst without a trace, which is not used."""
_FEWEST = 200
"""Samples after the dead time, as in `trace_fault`."""
_FULL_SCALE = 1.0 + 1e-9
_MOST_SHOTS = 1000

Limits = tuple[tuple[float, float], ...]
_BURST: dict[str, Limits] = {
    "angles": ((-math.pi, math.pi), (-math.pi, math.pi)),
    "shots": ((0, _MOST_SHOTS), (1, _MOST_SHOTS)),
    "noise": ((0.0, 1.0),),
    "interval": ((1e-9, 50e-9),),
}
"""Least and largest of each number of the mean of a burst."""


@dataclass(frozen=True)
class SweptBefore:
    """What is known of a sweep that was cut off: nothing of a new one.

    Parameters
    ----------
    lines : list of dict
        Of its journal, up to the first that is damaged.
    bursts : list of SweptBurst
        In these lines.
    damaged : int
        Number of the first damaged line, from 1; 0 without one.
    """

    lines: Sequence[dict[str, Any]] = ()
    bursts: Sequence[SweptBurst] = ()
    damaged: int = 0

    @classmethod
    def of(cls, folder: Path, begun: dict[str, Any], along: Sequence[float]) -> SweptBefore:
        """Return it by the journal in a folder.

        Parameters
        ----------
        folder : path
            Of the sweep.
        begun : dict
            What is swept, and by what.
        along : (first, last)
            Ends of the swept part, in metres.

        Raises
        ------
        RecordError
            If there is no journal, or a line has an impossible value.
        ParameterError
            If it is finished, or another sweep was begun.
        """
        check_folder(folder, "sweep")
        file = folder / NAME
        every = parsed_lines(file)
        damaged = 1 + every.index(None) if None in every else 0
        sound = [line for line in (every[: damaged - 1] if damaged else every) if line is not None]
        if not sound:
            raise unreadable(file)
        check_resumed([line for line in every if line is not None], folder, begun, "sweep")
        return cls(sound, kept_bursts(file, sound, along), damaged)

    def set_aside(self, folder: Path) -> str:
        """Copy a damaged journal beside it, and return what is kept and where, as a sentence."""
        file = folder / NAME
        copies = (folder / f"journal.damaged{n or ''}.jsonl" for n in range(1000))
        copy = next(each for each in copies if not each.exists())
        write_atomically(copy, file.read_bytes())
        return (
            f"line {self.damaged} of {file} is damaged; what is kept before it: "
            f"{counted(len(self.bursts), 'burst')}; the rest is fired again, and the journal as it "
            f"was is kept in {copy}"
        )


def burst_line(swept: SweptBurst) -> dict[str, Any]:
    """Return the content of the line of a burst; its numbers are exact."""
    place, spot = swept.place.tolist(), swept.spot.tolist()
    return {"fired": swept.t, "place": place, "spot": spot, **burst_values(swept.burst)}


def burst_values(burst: Burst) -> dict[str, Any]:
    """Return the values of the mean of a burst; its numbers are exact."""
    import numpy as np

    return {
        "angles": burst.angles.tolist(),
        "shots": [burst.used, burst.fired],
        "noise": burst.noise,
        "verdict": burst.verdict,
        "interval": burst.sample_interval,
        "trace": base64.b64encode(np.asarray(burst.trace, dtype="<f8").tobytes()).decode(),
    }


def kept_bursts(
    file: Path, lines: Sequence[dict[str, Any]], along: Sequence[float]
) -> list[SweptBurst]:
    """Return the bursts of the journal of a sweep.

    Parameters
    ----------
    file : path
        Of the journal, for messages.
    lines : sequence of dict
    along : (first, last)
        Ends of the swept part, in metres.

    Raises
    ------
    RecordError
        If a line lacks something, or has an impossible value.
    """
    limits, found = _limits(along), []
    for number, line in enumerate(lines, 1):
        where = f"line {number} of {file}"
        _check(where, "t", line.get("t"), ((0.0, _LATEST),))
        if number == 1 and not isinstance(line.get("began"), str):
            raise unreadable(file)
        if line["what"] != "burst":
            continue
        try:
            found.append(_burst(where, line, limits))
        except RecordError:
            raise
        except (KeyError, TypeError, ValueError):
            raise RecordError(f"{where} is not the whole line of a burst; {_AGAIN}") from None
    return found


def _limits(along: Sequence[float]) -> dict[str, Limits]:
    """Return least and largest of each number of a burst with a trace."""
    z = along[0] - _BESIDE, along[1] + _BESIDE
    turn = 2.0 * math.pi
    return {
        "fired": ((0.0, _LATEST),),
        "place": (z, (-2.0 * turn, 2.0 * turn)),
        "spot": ((-turn, turn), z, (1e-3, 1.0)),
    }


def _burst(where: str, line: dict[str, Any], limits: dict[str, Limits]) -> SweptBurst:
    """Return the burst of a line."""
    import numpy as np

    from minorloop.head.ultrasound.wall_echoes import SweptBurst

    burst = burst_of_values(where, line)
    for name, allowed in limits.items():
        _check(where, name, line[name], allowed, unknown=bool(burst.verdict))
    return SweptBurst(line["fired"], np.array(line["place"]), np.array(line["spot"]), burst)


def burst_of_values(where: str, values: dict[str, Any]) -> Burst:
    """Return the burst whose values `burst_values` gave.

    Parameters
    ----------
    where : str
        Line and file, for messages.
    values : dict

    Raises
    ------
    RecordError
        If a value is impossible.
    KeyError, TypeError, ValueError
        If a value is missing, or of another kind.
    """
    import numpy as np

    from minorloop.head.ultrasound.echoes import Burst

    verdict = values["verdict"]
    if not isinstance(verdict, str):
        raise RecordError(f"{where} has the verdict {reprlib.repr(verdict)}, no text; {_AGAIN}")
    for name, allowed in _BURST.items():
        _check(where, name, values[name], allowed, unknown=bool(verdict))
    data = base64.b64decode(values["trace"], validate=True)
    trace = np.frombuffer(data, "<f8").astype(np.float64)
    if not verdict:
        _check_trace(where, trace, values["interval"])
    used, fired = values["shots"]
    angles, interval, noise = np.array(values["angles"]), values["interval"], values["noise"]
    return Burst(trace, interval, angles, used, fired, noise, verdict)


def _check(where: str, name: str, value: Any, limits: Limits, *, unknown: bool = False) -> None:
    """Refuse a number, or a list of them, beyond its limits.

    Of a burst without a trace, numbers may be ``unknown``: NaN, or beyond limits.
    """
    numbers = value if isinstance(value, list) else [value]
    wide = ((-_LARGEST, _LARGEST),) * len(limits)
    if isinstance(value, list) == (len(limits) > 1) and len(numbers) == len(limits):
        pairs = zip(numbers, wide if unknown else limits, strict=True)
        if all(_within(one, *ends, unknown=unknown) for one, ends in pairs):
            return
    allowed = " and ".join(f"{low:.4g} to {high:.4g}" for low, high in limits)
    raise RecordError(
        f"{where} has {reprlib.repr(value)} as {name!r}, which must be {allowed}; {_AGAIN}"
    )


def _within(value: Any, low: float, high: float, *, unknown: bool) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return low <= value <= high or (unknown and value != value)


def _check_trace(where: str, trace: FloatArray, interval: float) -> None:
    """Refuse a trace that no shots give."""
    import numpy as np

    from minorloop.head.ultrasound.echoes import DEAD_TIME

    least = int(DEAD_TIME / interval) + _FEWEST
    if trace.size < least:
        raise RecordError(
            f"{where} has a trace of {counted(trace.size, 'sample')}, which must be at least "
            f"{least}; {_AGAIN}"
        )
    off = ~(np.abs(trace) <= _FULL_SCALE)
    if off.any():
        raise RecordError(
            f"{where} has the sample {trace[off][0]:.4g} in its trace, which must be -1 to 1; "
            f"{_AGAIN}"
        )

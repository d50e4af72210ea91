"""The bursts in the journal of a sweep, from which it goes on after it was cut off."""

from __future__ import annotations

import base64
import json
import math
import reprlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.errors import RecordError, counted
from minorloop_head.cli._journal import unreadable
from minorloop_head.cli._journal_checks import AGAIN, LATEST, TURN, Limits, check, impossible

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop_head.ultrasound.echoes import Burst
    from minorloop_head.ultrasound.wall_echoes import SweptBurst

_BESIDE = 20e-3
"""How far in metres a burst may be from the swept part, along the pipe."""
_FEWEST = 200
"""Samples after the dead time, as in `trace_fault`."""
_FULL_SCALE = 1.0 + 1e-9
_MOST_SHOTS = 1000

_BURST: dict[str, Limits] = {
    "angles": ((-math.pi, math.pi), (-math.pi, math.pi)),
    "shots": ((0, _MOST_SHOTS), (1, _MOST_SHOTS)),
    "noise": ((0.0, 1.0),),
    "interval": ((1e-9, 50e-9),),
}
"""Least and largest of each number of the mean of a burst."""


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
    limits, found, known = _limits(along), [], Repeats()
    for number, line in enumerate(lines, 1):
        where = f"line {number} of {file}"
        check(where, "t", line.get("t"), ((0.0, LATEST),))
        if number == 1 and not isinstance(line.get("began"), str):
            raise unreadable(file)
        if line["what"] != "burst":
            continue
        try:
            found.append(_burst(where, line, limits))
            known.check(where, {name: line[name] for name in ("fired", "spot", "trace")})
        except RecordError:
            raise
        except (KeyError, TypeError, ValueError):
            raise RecordError(f"{where} is not the whole line of a burst; {AGAIN}") from None
    return found


class Repeats:
    """Bursts that lines have; one that is there twice is refused.

    The noise of no two traces is the same.
    """

    def __init__(self) -> None:
        self._seen: dict[str, str] = {}

    def check(self, where: str, values: dict[str, Any]) -> None:
        """Refuse the values of a burst that were given before; one without a trace may repeat."""
        text = json.dumps(values, sort_keys=True)
        if values["trace"] and text in self._seen:
            raise RecordError(f"{where} repeats the burst of {self._seen[text]}; {AGAIN}")
        self._seen[text] = where


def _limits(along: Sequence[float]) -> dict[str, Limits]:
    """Return least and largest of each number of a burst with a trace."""
    z = along[0] - _BESIDE, along[1] + _BESIDE
    return {
        "fired": ((0.0, LATEST),),
        "place": (z, (-2.0 * TURN, 2.0 * TURN)),
        "spot": ((-TURN, TURN), z, (1e-3, 1.0)),
    }


def _burst(where: str, line: dict[str, Any], limits: dict[str, Limits]) -> SweptBurst:
    """Return the burst of a line."""
    import numpy as np

    from minorloop_head.ultrasound.wall_echoes import SweptBurst

    burst = burst_of_values(where, line)
    for name, allowed in limits.items():
        check(where, name, line[name], allowed, unknown=bool(burst.verdict))
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

    from minorloop_head.ultrasound.echoes import Burst

    verdict = values["verdict"]
    if not isinstance(verdict, str):
        raise RecordError(f"{where} has the verdict {reprlib.repr(verdict)}, no text; {AGAIN}")
    for name, allowed in _BURST.items():
        check(where, name, values[name], allowed, unknown=bool(verdict))
    data = base64.b64decode(values["trace"], validate=True)
    trace = np.frombuffer(data, "<f8").astype(np.float64)
    if not verdict:
        _check_trace(where, trace, values["interval"])
    used, fired = values["shots"]
    if used > fired:
        raise impossible(where, "shots", values["shots"], "no more used than fired")
    angles, interval, noise = np.array(values["angles"]), values["interval"], values["noise"]
    return Burst(trace, interval, angles, used, fired, noise, verdict)


def _check_trace(where: str, trace: FloatArray, interval: float) -> None:
    """Refuse a trace that no shots give."""
    import numpy as np

    from minorloop_head.ultrasound.echoes import DEAD_TIME

    least = int(DEAD_TIME / interval) + _FEWEST
    if trace.size < least:
        raise RecordError(
            f"{where} has a trace of {counted(trace.size, 'sample')}, which must be at least "
            f"{least}; {AGAIN}"
        )
    off = ~(np.abs(trace) <= _FULL_SCALE)
    if off.any():
        raise RecordError(
            f"{where} has the sample {trace[off][0]:.4g} in its trace, which must be -1 to 1; "
            f"{AGAIN}"
        )

"""Read the records of a fleet in threads, because a file system may never answer."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass

from minorloop.fleet.manifest import Specimen

NOTICE = 5.0
"""Seconds without a record after which a message says so."""
APART = 4.0
"""Least seconds between two messages of one kind, for fleets in which all are slow."""
_SOON, _SOON_IF_LATE = 1.0, 0.1
"""Seconds after which the next record is read first; fewer while one is late already."""
TICK = 0.2
"""Seconds between rounds: short against all limits of time."""
_MOST_LATE = 64
"""Records that are waited for at the same time, each by a thread of its own."""


@dataclass
class _Reading:
    """A record that is being read."""

    specimen: Specimen
    data: Future[bytes]
    began: float
    noticed: bool = False

    @classmethod
    def of(cls, specimen: Specimen) -> _Reading:
        data: Future[bytes] = Future()
        # A daemon, because a thread inside a file system that hangs cannot be ended.
        threading.Thread(target=_read, args=(specimen, data), daemon=True).start()
        return cls(specimen, data, time.monotonic())


def _read(specimen: Specimen, data: Future[bytes]) -> None:
    try:
        data.set_result(specimen.read())
    except Exception as error:
        data.set_exception(error)


def read_within(specimen: Specimen, seconds: float) -> bytes:
    """Return the bytes of a record.

    Raises
    ------
    OSError, ValueError
        If it cannot be read, or not within that time.
    """
    return _Reading.of(specimen).data.result(seconds)


def read_records(
    specimens: Sequence[Specimen],
    limit: float,
    say: Callable[[str], None],
    fail: Callable[[Specimen, Exception], None],
) -> Iterator[tuple[Specimen, bytes] | None]:
    """Yield specimens with their records; None at intervals while the last are waited for.

    A record that does not come soon is waited for while others are read.

    Parameters
    ----------
    specimens : sequence of Specimen
        Whose records to read.
    limit : float
        Seconds after which a record is given up.
    say : callable
        Called with sentences about delays.
    fail : callable
        Called with each specimen whose record cannot be read, and the reason.
    """
    late: list[_Reading] = []
    coming, last_notice = iter(specimens), float("-inf")
    more = True
    while more or late:
        one = next(coming, None) if len(late) < _MOST_LATE else None
        if one is not None:
            reading = _Reading.of(one)
            wait([reading.data], timeout=_SOON_IF_LATE if late else _SOON)
            late.append(reading)
        else:
            more = more and len(late) >= _MOST_LATE
            wait([it.data for it in late], timeout=TICK, return_when=FIRST_COMPLETED)
        waited_for, late = late, []
        for it in waited_for:
            name, now = it.specimen.name, time.monotonic()
            if it.data.done():
                try:
                    data = it.data.result()
                except (OSError, ValueError) as error:
                    fail(it.specimen, error)
                else:
                    yield it.specimen, data
            elif now - it.began >= limit:
                say(f"the record of specimen {name} was not read within {limit:g} s")
                reason = f"it was not read within {limit:g} s; look whether its disk answers"
                fail(it.specimen, TimeoutError(reason))
            else:
                late.append(it)
                if not it.noticed and now - it.began >= NOTICE and now - last_notice >= APART:
                    it.noticed, last_notice = True, now
                    say(
                        f"the record of specimen {name} has not been read for "
                        f"{now - it.began:.0f} s; the limit is {limit:g} s"
                    )
        if one is None and late:
            yield None

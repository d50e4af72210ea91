"""Identify every specimen of a manifest; failures do not stop the others."""

from __future__ import annotations

import hashlib
import json
import os
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import as_levels, as_whole
from minorloop.errors import FleetError, ParameterError
from minorloop.files import PathLike
from minorloop.fleet._cluster import Cluster, check_address
from minorloop.fleet._fitting import Found, Task, identify_one
from minorloop.fleet._pool import Pool
from minorloop.fleet._reading import read_records
from minorloop.fleet.manifest import Specimen
from minorloop.fleet.results import (
    earlier_outcomes,
    open_folder,
    strays,
    write_result,
    write_summary,
)
from minorloop.fleet.summary import Outcome, Summary

__all__ = ["identify_fleet"]

OPTIONS = frozenset(
    ("levels", "spacing", "relay", "diagonal", "slope", "signed", "smoothness", "prior", "noise")
) | {"lag", "start", "offset", "holdout", "mean", "skip", "start_of_curve"}
LIMIT = 3600.0
"""Default time limit for a specimen in seconds; the slowest valid fits take minutes."""
_AT_ONCE, _MOST_WRITTEN = 16, 64
"""Results that are written in parallel, and results that may wait."""


def identify_fleet(
    specimens: Sequence[Specimen],
    folder: PathLike,
    *,
    workers: int | None = None,
    address: str | None = None,
    limit: float = LIMIT,
    retry_failed: bool = False,
    patience: float = 60.0,
    watch: Callable[[int, int, Outcome], None] | None = None,
    say: Callable[[str], None] | None = None,
    **options: Any,
) -> Summary:
    """Identify every specimen; failures are reported and do not stop the others.

    Each fit runs in a process that is ended at the time limit. A process that ends for lack of
    memory or by a signal is replaced, and its specimen is tried once more.

    Parameters
    ----------
    specimens : sequence of Specimen
        As `read_manifest` gives them.
    folder : str or path
        Folder for the results: new, empty, or of the same fleet, which then continues. Results of
        specimens whose record, columns and model file are unchanged are kept, failures too; the
        others are identified. If that fails, the model of an earlier start is removed.
    workers : int, optional
        Local processes; as many as there are cores if not given.
    address : str, optional
        Address of the scheduler of a Dask cluster to use instead, such as
        ``tcp://10.0.0.1:8786``. Records are read here and sent to the workers, which return
        models; they need this package and no shared folder.
    limit : float
        Seconds after which the fit of a specimen, or the reading of its record, is given up;
        ``inf`` for no limit.
    retry_failed : bool
        Whether specimens that failed before are tried again although their records are
        unchanged.
    patience : float
        Seconds to wait for a worker of the cluster, or for an answer of its scheduler.
    watch : callable, optional
        Called with the number of specimens done, their total, and the last outcome.
    say : callable, optional
        Called with sentences about delays and faults.
    **options
        Of `minorloop.identify`, the same for all.

    Raises
    ------
    MissingExtraError
        If an address is given and Dask is not installed.
    ParameterError
        If there is no specimen, an option is not one that `minorloop.identify` takes, or there
        is no scheduler at the address, or no worker in time.
    FleetError
        If the scheduler or all workers are lost; results so far are kept.
    OutputError
        If the folder holds something else, another fleet, or cannot be written to.
    """
    _check(specimens, workers, address, options)
    _check_times(limit, patience)
    try_options(options)
    say = say or (lambda sentence: None)
    if address is not None:
        check_address(address)
    place = open_folder(Path(folder), specimens, options)
    known = earlier_outcomes(place, specimens, failed=not retry_failed)
    pending = [one for one in specimens if one.name not in known]

    def start() -> Pool | Cluster:
        if address is not None:
            return Cluster(address, patience, limit, identify_one, say, len(pending))
        count = workers or os.cpu_count() or 1
        return Pool(min(count, len(pending)), limit, identify_one, say)

    outcomes = _outcomes(pending, options, place, start, limit, say)
    with closing(outcomes), _say_what_is_kept(place, known, len(specimens)):
        for outcome in outcomes:
            known[outcome.specimen] = outcome
            if watch is not None:
                watch(len(known), len(specimens), outcome)
    summary = Summary([known[one.name] for one in specimens], strays(place, specimens))
    write_summary(place, summary)
    return summary


@contextmanager
def _say_what_is_kept(place: Path, known: Mapping[str, Outcome], total: int) -> Iterator[None]:
    """Add to the error what is kept, if workers or their scheduler are lost."""
    try:
        yield
    except FleetError as error:
        raise FleetError(
            f"{error}. {len(known)} of {total} specimens are done and kept in {place}; the same "
            "command identifies the rest"
        ) from None


class _Writer:
    """Writes results in parallel threads, because disks are slow.

    The first model is written alone: `msgspec` inspects the classes of a model file on first use,
    and crashes if two threads do so at the same time.
    """

    def __init__(self, place: Path) -> None:
        self._place, self._pool = place, ThreadPoolExecutor(_AT_ONCE)
        self._begun: deque[Future[Outcome]] = deque()
        self._alone = True

    def __enter__(self) -> _Writer:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.shutdown()

    def begin(self, one: Specimen, found: Found) -> None:
        """Start to write the result of a specimen."""
        writing = self._pool.submit(write_result, self._place, one, found)
        self._begun.append(writing)
        if self._alone and "model" in found:
            wait([writing])
            self._alone = False

    def done(self, *, all: bool = False) -> Iterator[Outcome]:
        """Yield outcomes that are written, in the order of `begin`."""
        while self._begun and (all or self._begun[0].done() or len(self._begun) > _MOST_WRITTEN):
            yield self._begun.popleft().result()


def _tasks(
    specimens: Sequence[Specimen],
    options: Mapping[str, Any],
    writing: _Writer,
    limit: float,
    say: Callable[[str], None],
) -> Iterator[Task | None]:
    """Yield specimens with their records, which are read when needed; None while none is read."""

    def fail(one: Specimen, error: Exception) -> None:
        writing.begin(one, {"error": _unreadable(one, error)})

    for found in read_records(specimens, limit, say, fail):
        yield None if found is None else Task(*found, options)


def _outcomes(
    specimens: Sequence[Specimen],
    options: Mapping[str, Any],
    place: Path,
    start: Callable[[], Pool | Cluster],
    limit: float,
    say: Callable[[str], None],
) -> Generator[Outcome]:
    """Yield the outcome of each specimen as soon as it is written."""
    with _Writer(place) as writing, start() as workers:
        for one in workers.run(_tasks(specimens, options, writing, limit, say)):
            if one is not None:
                writing.begin(one[0].specimen, _with_digest(*one))
            yield from writing.done()
        yield from writing.done(all=True)


def _with_digest(task: Task, found: Found) -> Found:
    return {**found, "sha256": hashlib.sha256(task.data).hexdigest()}


def _unreadable(one: Specimen, error: Exception) -> str:
    return f"{one.file} cannot be read: {getattr(error, 'strerror', None) or error}"


def _check(
    specimens: Sequence[Specimen],
    workers: int | None,
    address: str | None,
    options: Mapping[str, Any],
) -> None:
    if not specimens:
        raise ParameterError("there is no specimen; list some in the manifest")
    if workers is not None and (isinstance(workers, bool) or not 1 <= workers <= 1024):
        raise ParameterError(f"workers is {workers!r}; give 1 to 1024")
    if workers is not None and address is not None:
        raise ParameterError(
            f"workers is {workers} and address is {address}; give one of them, because a cluster "
            "has its own workers"
        )
    unknown = sorted(set(options) - OPTIONS)
    if unknown:
        raise ParameterError(
            f"{unknown[0]!r} is not an option of a fleet; options are {', '.join(sorted(OPTIONS))}"
        )
    try:
        json.dumps(options)
    except (TypeError, ValueError):
        raise ParameterError("options of a fleet are numbers, words and lists of them") from None


def _check_times(limit: float, patience: float) -> None:
    if not limit > 0:
        raise ParameterError(f"limit is {limit!r} s; give a positive time, or inf for none")
    if not 0 < patience < float("inf"):
        raise ParameterError(f"patience is {patience!r} s; give a positive time")


def try_options(options: Mapping[str, Any]) -> None:
    """Check options by identifying a small record."""
    from minorloop.identification.design_matrix import MOST_BANDS
    from minorloop.identification.pipeline import Options
    from minorloop.lab.records import Record

    levels, lag = options.get("levels", 1), options.get("lag", 0)
    levels = 1 if isinstance(levels, str) and levels == "auto" else levels
    if np.isscalar(levels):
        as_whole("levels", levels, 1, MOST_BANDS)  # type: ignore[arg-type]
    else:
        as_levels(levels)
    if lag != "auto":
        as_whole("lag", lag, 0, 10**9)
    u = np.resize([0.0, 1.0, 0.25, 0.75, 0.5], 60)
    curves = np.arange(60) // 30 if "start_of_curve" in options else None
    small = Record(u, u + 0.1 * (np.arange(60) % 2), curves=curves)
    Options.of({**options, "levels": 2, "lag": 0}).identify(small)

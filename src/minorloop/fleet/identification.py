"""Identify every specimen of a manifest, whatever becomes of some of them."""

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
from minorloop.fleet.manifest import Specimen
from minorloop.fleet.results import kept, open_folder, settle, strays, write_summary
from minorloop.fleet.summary import Outcome, Summary

__all__ = ["identify_fleet"]

OPTIONS = frozenset(
    ("levels", "spacing", "relay", "diagonal", "slope", "signed", "smoothness", "prior", "noise")
) | {"lag", "start", "offset", "holdout"}
LIMIT = 3600.0
"""Seconds that a specimen may take if nothing else is said: the slowest sound fits take minutes."""
_AT_ONCE, _MOST_WRITTEN = 16, 64
"""Results that are written at once, and that may wait for it."""
_FINE = 64
"""Bands beyond which a prior takes no plane, which is found out before anything is fitted."""


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
    """Identify every specimen; what fails is reported and stops nothing.

    Each fit runs in a process that is ended at the time limit. A process that ends by itself, for
    lack of memory or by a signal, is replaced, and its specimen tried once more.

    Parameters
    ----------
    specimens : sequence of Specimen
        As `read_manifest` gives them.
    folder : str or path
        For the results: new, empty, or of the same fleet, which then goes on. Specimens whose
        record, columns and model file are unchanged are kept, also those that failed; the others
        are done. What fails loses the model of an earlier start.
    workers : int, optional
        Local processes; as many as there are cores if not given.
    address : str, optional
        Address of the scheduler of a Dask cluster to use instead, such as
        ``tcp://10.0.0.1:8786``. Records are read here and sent there, and models come back, so
        that nothing has to be shared but this package.
    limit : float
        Seconds that one specimen may take before it is given up; ``inf`` for no limit.
    retry_failed : bool
        Whether specimens that failed before are tried again although their records are
        unchanged.
    patience : float
        Seconds to wait for a worker of the cluster, or for an answer of its scheduler.
    watch : callable, optional
        Told how many are done, of how many, and the last outcome.
    say : callable, optional
        Told in a sentence what is being waited for and what went wrong.
    **options
        Of `minorloop.identify`, the same for all.

    Returns
    -------
    Summary

    Raises
    ------
    MissingExtraError
        If an address is given and Dask is not installed.
    ParameterError
        If there is no specimen, an option is not one that `minorloop.identify` takes, or there
        is no scheduler at the address, or no worker in time.
    FleetError
        If the scheduler or all workers are lost; what is done by then is kept.
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
    known = kept(place, specimens, failed=not retry_failed)
    pending = [one for one in specimens if one.name not in known]

    def start() -> Pool | Cluster:
        if address is not None:
            return Cluster(address, patience, limit, identify_one, say, len(pending))
        count = workers or os.cpu_count() or 1
        return Pool(min(count, len(pending)), limit, identify_one, say)

    outcomes = _outcomes(pending, options, place, start)
    with closing(outcomes), _ended_well(place, known, len(specimens)):
        for outcome in outcomes:
            known[outcome.specimen] = outcome
            if watch is not None:
                watch(len(known), len(specimens), outcome)
    summary = Summary([known[one.name] for one in specimens], strays(place, specimens))
    write_summary(place, summary)
    return summary


@contextmanager
def _ended_well(place: Path, known: Mapping[str, Outcome], total: int) -> Iterator[None]:
    """Say what is kept where workers or their scheduler are lost."""
    try:
        yield
    except FleetError as error:
        raise FleetError(
            f"{error}. {len(known)} of {total} specimens are done and kept in {place}; the same "
            "command does the rest"
        ) from None


class _Writing:
    """Results being written down, several at once: a disk takes its time.

    The first model is written alone. `msgspec` looks at the classes of a model file when it meets
    them first, and crashes where two threads do so at the same time.
    """

    def __init__(self, place: Path) -> None:
        self._place, self._pool = place, ThreadPoolExecutor(_AT_ONCE)
        self._begun: deque[Future[Outcome]] = deque()
        self._alone = True

    def __enter__(self) -> _Writing:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.shutdown()

    def begin(self, one: Specimen, found: Found) -> None:
        """Write down what became of a specimen."""
        writing = self._pool.submit(settle, self._place, one, found)
        self._begun.append(writing)
        if self._alone and "model" in found:
            wait([writing])
            self._alone = False

    def done(self, *, all: bool = False) -> Iterator[Outcome]:
        """Outcomes that are written down by now, in the order in which they began."""
        while self._begun and (all or self._begun[0].done() or len(self._begun) > _MOST_WRITTEN):
            yield self._begun.popleft().result()


def _tasks(
    specimens: Sequence[Specimen], options: Mapping[str, Any], writing: _Writing
) -> Iterator[Task]:
    """Specimens and their records, read when they are asked for."""
    for one in specimens:
        try:
            yield Task(one, one.read(), options)
        except (OSError, ValueError) as error:
            writing.begin(one, {"error": _unreadable(one, error)})


def _outcomes(
    specimens: Sequence[Specimen],
    options: Mapping[str, Any],
    place: Path,
    start: Callable[[], Pool | Cluster],
) -> Generator[Outcome]:
    """What becomes of each, as it becomes known, and written down by then."""
    with _Writing(place) as writing, start() as workers:
        for one in workers.run(_tasks(specimens, options, writing)):
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
            f"the workers of a cluster are as many as it has, not {workers}; leave workers or "
            "address out"
        )
    strange = sorted(set(options) - OPTIONS)
    if strange:
        raise ParameterError(
            f"{strange[0]!r} is no option of a fleet; there are {', '.join(sorted(OPTIONS))}"
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
    """Refuse what no record could be identified with, by identifying a small one."""
    from minorloop.identification import identify
    from minorloop.identification.design_matrix import MOST_BANDS

    levels, lag = options.get("levels", 1), options.get("lag", 0)
    if np.isscalar(levels):
        bands = as_whole("levels", levels, 1, MOST_BANDS)  # type: ignore[arg-type]
    else:
        bands = as_levels(levels).size - 1
    if lag != "auto":
        as_whole("lag", lag, 0, 10**9)
    coarse = 2 if options.get("prior") != "gaussian" or bands <= _FINE else bands
    u = np.resize([0.0, 1.0, 0.25, 0.75, 0.5], 60)
    identify(u, u + 0.1 * (np.arange(60) % 2), **{**options, "levels": coarse, "lag": 0})

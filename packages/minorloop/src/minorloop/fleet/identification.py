"""Identify every specimen of a manifest; failures do not stop the others."""

from __future__ import annotations

import json
import os
import queue
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import as_levels, as_whole
from minorloop.errors import FleetError, ParameterError
from minorloop.files import PathLike
from minorloop.fleet._cluster import Cluster
from minorloop.fleet._fitting import Task, identify_one
from minorloop.fleet._worker import APART, NOTICE, TICK, LocalWorkers
from minorloop.fleet.manifest import Specimen
from minorloop.fleet.results import (
    earlier_outcome,
    has_result,
    open_folder,
    strays,
    write_result,
    write_summary,
)
from minorloop.fleet.summary import Outcome, Summary

OPTIONS = frozenset(
    ("levels", "spacing", "relay", "diagonal", "slope", "signed", "smoothness", "prior", "noise")
) | {"lag", "start", "offset", "holdout", "mean", "skip", "start_of_curve"}
LIMIT = 3600.0
"""Default time limit for a specimen in seconds; the slowest valid fits take minutes."""
SOON = 1.0
"""Seconds after which a record is late, and the next is read first."""
_MOST_LATE = 64
"""Records that are waited for at the same time, each by a thread of its own."""


def identify_fleet(
    specimens: Sequence[Specimen],
    folder: PathLike,
    *,
    workers: int | str | None = None,
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
    workers : int or str, optional
        Local processes; as many as there are cores if not given. Or the address of the scheduler of
        a Dask cluster, such as ``tcp://10.0.0.1:8786``. Records are read here and sent to its
        workers, which return models; they need this package and no shared folder.
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
        Called with sentences about delays and faults, in any thread.
    **options
        Of `minorloop.identify`, the same for all.

    Raises
    ------
    MissingExtraError
        If workers are those of a cluster and Dask is not installed.
    ParameterError
        If there is no specimen, an option is not one that `minorloop.identify` takes, or there
        is no scheduler at the address.
    FleetError
        If the scheduler or all workers are lost, or none comes; results so far are kept.
    OutputError
        If the folder holds something else, another fleet, or cannot be written to.
    """
    _check(specimens, workers, limit, patience, options)
    _try_options(options)
    say = say or (lambda sentence: None)
    backend: Cluster | LocalWorkers
    if isinstance(workers, str):
        backend = Cluster(workers, patience, identify_one, limit, say)
    else:
        count = min(workers or os.cpu_count() or 1, len(specimens))
        backend = LocalWorkers(count, identify_one, limit, say)
    known: dict[str, Outcome] = {}
    with closing(backend):
        place = open_folder(Path(folder), specimens, options)
        jobs = _Jobs(place, options, backend, limit, retry_failed, say)
        try:
            with closing(jobs.outcomes(specimens)) as outcomes:
                for outcome, new in outcomes:
                    known[outcome.specimen] = outcome
                    if new and watch is not None:
                        watch(len(known), len(specimens), outcome)
        except FleetError as error:
            raise FleetError(
                f"{error}. {len(known)} of {len(specimens)} specimens are done and kept in "
                f"{place}; the same command identifies the rest"
            ) from None
    summary = Summary([known[one.name] for one in specimens], strays(place, specimens))
    write_summary(place, summary)
    return summary


@dataclass(eq=False)
class _Job:
    """A specimen that a thread reads, identifies and writes."""

    specimen: Specimen
    began: float = field(default_factory=time.monotonic)
    read: threading.Lock = field(default_factory=threading.Lock)
    """Taken once, by the thread when it has read the record, or by whom gives the record up."""
    noticed: bool = False


class _Jobs:
    """Specimens in work: a thread for each, because a file system may never answer."""

    def __init__(
        self,
        place: Path,
        options: Mapping[str, Any],
        backend: Cluster | LocalWorkers,
        limit: float,
        retry_failed: bool,
        say: Callable[[str], None],
    ) -> None:
        self._place, self._options, self._backend = place, options, backend
        self._limit, self._retry_failed, self._say = limit, retry_failed, say
        self._jobs: dict[_Job, threading.Thread] = {}
        self._done: queue.SimpleQueue[tuple[_Job, Outcome | BaseException, bool]] = (
            queue.SimpleQueue()
        )
        self._last_notice = float("-inf")

    def outcomes(self, specimens: Sequence[Specimen]) -> Generator[tuple[Outcome, bool]]:
        """Yield the outcome of each specimen as soon as it is written, and whether it is new."""
        # Those with an earlier result first: few are new, and all are known when a fleet is lost.
        coming = iter(sorted(specimens, key=lambda one: not has_result(self._place, one)))
        try:
            while self._begin(coming) or self._jobs:
                self._backend.look()
                yield from self._give_up()
                try:
                    job, outcome, new = self._done.get(timeout=TICK)
                except queue.Empty:
                    continue
                del self._jobs[job]
                if isinstance(outcome, BaseException):
                    raise outcome
                yield outcome, new
        finally:
            self._backend.close()
            for job, thread in self._jobs.items():
                if job.read.locked():  # other threads may hang
                    thread.join()

    def _late(self) -> list[_Job]:
        """Return the jobs whose record has not come soon."""
        soon = time.monotonic() - SOON
        return [job for job in self._jobs if job.began <= soon and not job.read.locked()]

    def _begin(self, coming: Iterator[Specimen]) -> bool:
        """Begin what there is room for; a record that is late takes no room."""
        begun = False
        late = len(self._late())
        while len(self._jobs) - late < self._backend.ahead and late < _MOST_LATE:
            one = next(coming, None)
            if one is None:
                break
            job = _Job(one)
            # A daemon, because a thread inside a file system that hangs cannot be ended.
            self._jobs[job] = threading.Thread(target=self._work, args=(job,), daemon=True)
            self._jobs[job].start()
            begun = True
        return begun

    def _work(self, job: _Job) -> None:
        try:
            try:
                data: bytes | Exception = job.specimen.read()
            except (OSError, ValueError) as error:
                data = error
            if job.read.acquire(blocking=False):
                self._done.put((job, *self._result(job.specimen, data)))
        except BaseException as error:
            self._done.put((job, error, False))

    def _result(self, one: Specimen, data: bytes | Exception) -> tuple[Outcome, bool]:
        if isinstance(data, Exception):
            return self._unreadable(one, getattr(data, "strerror", None) or data), True
        task = Task(one, data, self._options)
        kept = earlier_outcome(self._place, one, task.sha256)
        if kept is not None and (kept.error is None or not self._retry_failed):
            return kept, False
        return write_result(self._place, one, *self._backend.fit(task)), True

    def _give_up(self) -> Iterator[tuple[Outcome, bool]]:
        """Say which records are late, and yield failures of those that reach the limit."""
        for job in self._late():
            name, now = job.specimen.name, time.monotonic()
            spent = now - job.began
            if spent >= self._limit and job.read.acquire(blocking=False):
                del self._jobs[job]
                why = f"it was not read within {self._limit:g} s; look whether its disk answers"
                self._say(f"the record of specimen {name} was not read within {self._limit:g} s")
                yield self._unreadable(job.specimen, why), True
            elif not job.noticed and spent >= NOTICE and now - self._last_notice >= APART:
                job.noticed, self._last_notice = True, now
                self._say(
                    f"the record of specimen {name} has not been read for {spent:.0f} s; the limit "
                    f"is {self._limit:g} s"
                )

    def _unreadable(self, one: Specimen, why: object) -> Outcome:
        return write_result(
            self._place, one, one.outcome(error=f"{one.file} cannot be read: {why}")
        )


def _check(
    specimens: Sequence[Specimen],
    workers: int | str | None,
    limit: float,
    patience: float,
    options: Mapping[str, Any],
) -> None:
    if not specimens:
        raise ParameterError("there is no specimen; list some in the manifest")
    if workers is not None and not isinstance(workers, str):
        as_whole("workers", workers, 1, 1024)
    if not limit > 0:
        raise ParameterError(f"limit is {limit!r} s; give a positive time, or inf for none")
    if not 0 < patience < float("inf"):
        raise ParameterError(f"patience is {patience!r} s; give a positive time")
    unknown = sorted(set(options) - OPTIONS)
    if unknown:
        raise ParameterError(
            f"{unknown[0]!r} is not an option of a fleet; options are {', '.join(sorted(OPTIONS))}"
        )
    try:
        json.dumps(options)
    except (TypeError, ValueError):
        raise ParameterError("options of a fleet are numbers, words and lists of them") from None


def _try_options(options: Mapping[str, Any]) -> None:
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

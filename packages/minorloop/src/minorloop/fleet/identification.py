"""Identify every specimen of a manifest; failures do not stop the others."""

import json
import os
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import as_levels, as_whole
from minorloop.errors import FleetError, ParameterError
from minorloop.files import PathLike
from minorloop.fleet._cluster import Cluster
from minorloop.fleet._fitting import Task, identify_one
from minorloop.fleet._worker import LocalWorkers
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

    Each fit runs in a process that is stopped at the time limit. A process that ends for lack of
    memory or by a signal is replaced, and its specimen is tried once more.

    Parameters
    ----------
    specimens : sequence of Specimen
        As `read_manifest` returns them.
    folder : str or path
        Folder for the results: new, empty, or of the same fleet, which then continues. Results of
        specimens with unchanged record, columns and model file are kept, also failures; other
        specimens are identified. If this fails, the model of an earlier start is removed.
    workers : int or str, optional
        Number of local processes, by default that of the cores. Or the address of the scheduler of
        a Dask cluster, such as ``tcp://10.0.0.1:8786``. Records are read here and sent to its
        workers, which return models; they need this package but no shared folder.
    limit : float
        Seconds after which the fit of a specimen is stopped; ``inf`` for no limit.
    retry_failed : bool
        Whether to try failed specimens again although their records are unchanged.
    patience : float
        Seconds to wait for a worker of the cluster.
    watch : callable, optional
        Called with the number of specimens done, their total, and the last outcome.
    say : callable, optional
        Called with sentences about faults of local workers, in any thread.
    **options
        Options of `minorloop.identify`, the same for all specimens.

    Raises
    ------
    MissingExtraError
        If workers are those of a cluster and Dask is not installed.
    ParameterError
        If there is no specimen, an option is not an option of `minorloop.identify`, or there is no
        scheduler at the address.
    FleetError
        If the scheduler or all workers are lost, or there are no workers; results so far are kept.
    OutputError
        If the folder has other content, another fleet, or cannot be written to.
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
        try:
            with closing(_outcomes(place, specimens, options, backend, retry_failed)) as outcomes:
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


def _outcomes(
    place: Path,
    specimens: Sequence[Specimen],
    options: Mapping[str, Any],
    backend: Cluster | LocalWorkers,
    retry_failed: bool,
) -> Generator[tuple[Outcome, bool]]:
    """Yield the outcome of each specimen as soon as it is written, and whether it is new."""

    def work(one: Specimen) -> tuple[Outcome, bool]:
        try:
            task = Task(one, one.read(), options)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            failed = one.outcome(error=f"{one.file} cannot be read: {why}")
            return write_result(place, one, failed), True
        kept = earlier_outcome(place, one, task.sha256)
        if kept is not None and (kept.error is None or not retry_failed):
            return kept, False
        return write_result(place, one, *backend.fit(task)), True

    # Specimens with an earlier result come first, so that all of them are known if a fleet is lost.
    coming = sorted(specimens, key=lambda one: not has_result(place, one))
    threads = ThreadPoolExecutor(backend.ahead)
    try:
        for done in as_completed([threads.submit(work, one) for one in coming]):
            yield done.result()
    finally:
        backend.close()
        threads.shutdown(cancel_futures=True)


def _check(
    specimens: Sequence[Specimen],
    workers: int | str | None,
    limit: float,
    patience: float,
    options: Mapping[str, Any],
) -> None:
    if not specimens:
        raise ParameterError("there is no specimen; list specimens in the manifest")
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

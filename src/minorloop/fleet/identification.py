"""Identify every specimen of a manifest, on Dask, whatever becomes of some of them."""

from __future__ import annotations

import hashlib
import json
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import as_levels, as_whole
from minorloop.errors import MinorloopError, ParameterError, RecordError
from minorloop.files import PathLike
from minorloop.fleet._workers import check_address, cluster, get_ready
from minorloop.fleet.manifest import Specimen
from minorloop.fleet.results import (
    fail,
    kept,
    one_line,
    open_folder,
    settle_all,
    strays,
    write_summary,
)
from minorloop.fleet.summary import Outcome, Summary
from minorloop.lab.records import Record
from minorloop.operators.preisach import Preisach

__all__ = ["identify_fleet"]

OPTIONS = frozenset(
    ("levels", "spacing", "relay", "diagonal", "slope", "signed", "smoothness", "prior", "noise")
) | {"lag", "start", "offset", "holdout"}
_AHEAD = 3
"""Batches on their way to each worker."""
_STINT, _MOST_EACH = 0.5, 64
"""Seconds of work in a batch, and the most specimens."""
_FINE = 64
"""Bands beyond which a prior takes no plane, which is found out before anything is fitted."""


def identify_fleet(
    specimens: Sequence[Specimen],
    folder: PathLike,
    *,
    workers: int | None = None,
    address: str | None = None,
    patience: float = 60.0,
    watch: Callable[[int, int, Outcome], None] | None = None,
    say: Callable[[str], None] | None = None,
    **options: Any,
) -> Summary:
    """Identify every specimen; what fails is reported and stops nothing.

    Started from a script, the call has to stand under ``if __name__ == "__main__":``, because
    local workers are processes that import the script.

    Parameters
    ----------
    specimens : sequence of Specimen
        As `read_manifest` gives them.
    folder : str or path
        For the results: new, empty, or of the same fleet, which then goes on: specimens that
        are identified and whose record, columns and model file are unchanged are kept, the
        others done. What fails loses the model of an earlier start.
    workers : int, optional
        Local processes; as many as there are cores if not given.
    address : str, optional
        Address of the scheduler of a cluster to use instead, such as ``tcp://10.0.0.1:8786``.
        Records are read here and sent there, and models come back, so that nothing has to be
        shared but this package.
    patience : float
        Seconds to wait until the cluster has a worker.
    watch : callable, optional
        Told how many are done, of how many, and the last outcome.
    say : callable, optional
        Told in a sentence what is being waited for.
    **options
        Of `minorloop.identify`, the same for all.

    Returns
    -------
    Summary

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    ParameterError
        If there is no specimen, an option is not one that `minorloop.identify` takes, or there
        is no scheduler at the address, or no worker in time.
    OutputError
        If the folder holds something else, another fleet, or cannot be written to.
    """
    _check(specimens, workers, options)
    if workers is not None and address is not None:
        raise ParameterError(
            f"the workers of a cluster are as many as it has, not {workers}; leave workers or "
            "address out"
        )
    if not 0 < patience < float("inf"):
        raise ParameterError(f"patience is {patience!r} s; give a positive time")
    if address is None:
        get_ready()
    try_options(options)
    if address is not None:
        check_address(address)
    place = open_folder(Path(folder), specimens, options)
    known = kept(place, specimens)
    pending = [one for one in specimens if one.name not in known]
    done = len(known)
    gather = partial(cluster, workers, address, patience, say or (lambda sentence: None))
    for outcome in _outcomes(pending, place, gather, address is None, options):
        known[outcome.specimen] = outcome
        done += 1
        if watch is not None:
            watch(done, len(specimens), outcome)
    summary = Summary([known[one.name] for one in specimens], strays(place, specimens))
    write_summary(place, summary)
    return summary


def identify_batch(
    batch: Sequence[tuple[bytes | None, Specimen]],
    options: Mapping[str, Any],
    place: Path | None = None,
) -> list[dict[str, Any]] | list[Outcome]:
    """Identify some specimens; runs on a worker.

    Parameters
    ----------
    batch : sequence of (bytes or None, Specimen)
        Records as they are in their files, or None where the worker is to read them.
    options : mapping
        Of `minorloop.identify`.
    place : Path, optional
        Folder in which the worker writes down what it finds. Without it that comes back.
    """
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "record.csv"
        found = (identify_one(data, one, options, path) for data, one in batch)
        return list(found) if place is None else settle_all(place, [one for _, one in batch], found)


def identify_one(
    data: bytes | None, specimen: Specimen, options: Mapping[str, Any], scratch: Path
) -> dict[str, Any]:
    """Identify one specimen from the bytes of its record.

    Gives the model and how good it is, or the error as text: an exception that came from
    somewhere else could not be told from a worker's death.
    """
    from minorloop.identification import identify

    began = time.perf_counter()
    try:
        data = specimen.read() if data is None else data
    except (OSError, ValueError) as error:
        return {"error": one_line(_unreadable(specimen, error))}
    digest = hashlib.sha256(data).hexdigest()
    try:
        record = _record(data, specimen, scratch)
        result = identify(record.u, record.y, **options)
        model = result.model
        return {
            "model": model,
            "input": str(record.input),
            "output": str(record.output),
            "lag": result.lag,
            "nrmse": float(result.nrmse),
            "nrmse_holdout": result.holdout_nrmse,
            "excited": result.excited_fraction,
            "opening": opening(model),
            "samples": int(result.samples),
            "seconds": time.perf_counter() - began,
            "sha256": digest,
        }
    except Exception as error:
        kind = "" if isinstance(error, MinorloopError) else f"{type(error).__name__}: "
        return {"error": one_line(f"{kind}{error}"), "sha256": digest}


def opening(model: Preisach) -> float:
    """Widest gap between the two major branches, as a share of the range."""
    up = model.simulate(model.levels)
    down = model.simulate(model.levels[::-1], "positive")[::-1]
    width = float(np.ptp(model.range))
    return float(np.abs(down - up).max()) / width if width else 0.0


def _record(data: bytes, specimen: Specimen, scratch: Path) -> Record:
    scratch.write_bytes(data)
    try:
        return Record.from_csv(scratch, input=specimen.input, output=specimen.output, gaps=True)
    except RecordError as error:
        told = specimen.told(error).replace(str(scratch), str(specimen.file))
        raise RecordError(told) from None


def _outcomes(
    pending: Sequence[Specimen],
    place: Path,
    gather: Callable[[], AbstractContextManager[tuple[Any, Any]]],
    shared: bool,
    options: Mapping[str, Any],
) -> Iterator[Outcome]:
    """What becomes of each, as it becomes known, and written down by then."""
    readable = []
    for one in pending:
        try:
            with one.open():
                readable.append(one)
        except (OSError, ValueError) as error:
            yield fail(place, one, _unreadable(one, error))
    if readable:
        with gather() as (client, as_completed):
            flow = _Flow(client, as_completed, place, options, shared=shared)
            yield from flow.run(readable)


class _Flow:
    """Specimens on their way to workers and back.

    They go in batches of about half a second of work, so that sending them costs little;
    a batch that no worker survives is taken apart, so that one specimen fails and not its
    neighbours. Workers on this machine share its files: they read records and write results down
    themselves, so that this process has next to nothing to do and is no brake on them.
    """

    def __init__(
        self,
        client: Any,
        as_completed: Any,
        place: Path,
        options: Mapping[str, Any],
        *,
        shared: bool,
    ) -> None:
        self._client, self._place, self._options = client, place, dict(options)
        self._flow, self._shared = as_completed(loop=client.loop), shared
        self._sent: dict[str, list[Specimen]] = {}
        self._size, self._workers, self._left = 1, 1, 0

    def run(self, specimens: Sequence[Specimen]) -> Iterator[Outcome]:
        waiting, self._left = iter(specimens), len(specimens)
        self._workers = max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))
        yield from self._fill(waiting)
        for future in self._flow:
            batch = self._sent.pop(future.key)
            yield from self._settle(future, batch)
            future.release()
            yield from self._fill(waiting)

    def _fill(self, waiting: Iterator[Specimen]) -> Iterator[Outcome]:
        """Send until enough is on its way; gives what cannot be sent."""
        while self._left and len(self._sent) < _AHEAD * self._workers:
            # Small batches at the end, so that the workers end together.
            size = min(self._size, max(1, self._left // (2 * self._workers)))
            some = list(islice(waiting, size))
            self._left -= len(some)
            yield from self._send(some)

    def _send(self, some: Sequence[Specimen]) -> Iterator[Outcome]:
        """Send a batch; gives the outcomes of those that cannot be read here."""
        batch: list[tuple[bytes | None, Specimen]] = []
        for one in some:
            try:
                batch.append((None if self._shared else one.read(), one))
            except (OSError, ValueError) as error:
                yield fail(self._place, one, _unreadable(one, error))
        if batch:
            place = self._place.absolute() if self._shared else None
            future = self._client.submit(identify_batch, batch, self._options, place, pure=False)
            self._sent[future.key] = [one for _, one in batch]
            self._flow.add(future)

    def _settle(self, future: Any, batch: list[Specimen]) -> Iterator[Outcome]:
        try:
            found = future.result()
        except Exception as error:  # the worker died, again and again, or could not take the task
            if len(batch) == 1:
                yield fail(self._place, batch[0], f"no worker lived to the end: {error}")
                return
            for one in batch:
                yield from self._send([one])
            return
        outcomes = found if self._shared else settle_all(self._place, batch, found)
        yield from outcomes
        each = sum(one.seconds or 0.0 for one in outcomes) / len(batch)
        self._size = min(_MOST_EACH, max(1, round(_STINT / max(each, 1e-3))))


def _unreadable(one: Specimen, error: Exception) -> str:
    return f"{one.file} cannot be read: {getattr(error, 'strerror', None) or error}"


def _check(specimens: Sequence[Specimen], workers: int | None, options: Mapping[str, Any]) -> None:
    if not specimens:
        raise ParameterError("there is no specimen; list some in the manifest")
    if workers is not None and (isinstance(workers, bool) or not 1 <= workers <= 1024):
        raise ParameterError(f"workers is {workers!r}; give 1 to 1024")
    strange = sorted(set(options) - OPTIONS)
    if strange:
        raise ParameterError(
            f"{strange[0]!r} is no option of a fleet; there are {', '.join(sorted(OPTIONS))}"
        )
    try:
        json.dumps(options)
    except (TypeError, ValueError):
        raise ParameterError("options of a fleet are numbers, words and lists of them") from None


def try_options(options: Mapping[str, Any]) -> None:
    """Refuse what no record could be identified with, by identifying a small one."""
    from minorloop.identification import identify
    from minorloop.identification.areas import MOST_BANDS

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

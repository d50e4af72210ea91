"""A study: its run on each specimen, and gathering, storage and report of its figures."""

from __future__ import annotations

import inspect
import math
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from multiprocessing import active_children, get_context
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from minorloop.files import write_atomically
from minorloop.report import Report
from minorloop.threads import one_thread
from papers.claims import Claim, claims_of
from papers.page import study_report

T = TypeVar("T")


@dataclass(frozen=True)
class Study:
    """An experiment on simulated specimens, or a part of one."""

    name: str
    """Heading of its claims."""
    title: str
    """Title of its report and table."""
    run: Callable[..., Any]
    """Carries it out on the specimen of a seed, with options. The result has ``figures()``, or is
    a mapping of them; an option ``told`` is called with the name of each finished part."""
    gather: Callable[[Sequence[Mapping[str, Any]]], dict[str, Any]] | None = None
    """Combines the figures of several specimens; `medians` by default."""
    parts: Mapping[str, str] = field(default_factory=dict)
    """Modules of studies of single parts."""
    page: str = ""
    """Module of the pictures of the report, with the template beside it; a part has none."""
    beside: Callable[[Any, Path], list[str]] | None = None
    """Writes further files about the first specimen to a folder; returns lines on them."""

    @property
    def claims(self) -> tuple[Claim, ...]:
        """Rows of its table."""
        return claims_of(self.name)

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options of `run`."""
        return tuple(inspect.signature(self.run).parameters)

    def report(
        self, first: Any, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
    ) -> Report:
        """Return the page, as of `study_report`."""
        return study_report(self, first, figures, runs)


class Results(SimpleNamespace):
    """Results of a run: its figures by their printed names, and further data as attributes.

    The function that creates the results documents the attributes, which are drawn or gathered.
    """

    def __init__(self, figures: Mapping[str, Any] | None = None, **parts: Any) -> None:
        super().__init__(**parts)
        self._figures = figures or {}

    def figures(self) -> dict[str, Any]:
        """Return the figures."""
        return dict(self._figures)


def figures_of(result: Any) -> dict[str, Any]:
    """Return the figures of a result by their names; a mapping is returned itself."""
    return dict(result if isinstance(result, Mapping) else result.figures())


def study_of(module: str) -> Study:
    """Return the study of a module."""
    study = import_module(module).STUDY
    assert isinstance(study, Study)
    return study


def rms(errors: npt.ArrayLike) -> float:
    """Return the root-mean-square value of errors."""
    return float(np.sqrt(np.mean(np.square(errors))))


def medians(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the median of each figure over specimens.

    It is the minimum if its key ends in ``_min``, and the mean if it ends in ``_mean``. A truth
    value is true if it is true for any specimen. Other values are those of the first specimen.
    """
    return {key: _over(key, [run[key] for run in runs]) for key in runs[0]}


def _over(key: str, values: Sequence[Any]) -> Any:
    if isinstance(values[0], Mapping):
        return medians(values)
    if key.endswith("_min"):
        return min(values)
    if key.endswith("_mean"):
        return mean(values)
    if isinstance(values[0], bool):
        return any(values)
    if isinstance(values[0], int | float | np.number):
        return float(np.median(values))
    if isinstance(values[0], list | tuple | np.ndarray):
        return np.median(np.array(values, dtype=np.float64), axis=0).tolist()
    return values[0]


def mean(values: npt.ArrayLike) -> float:
    """Return the mean of numbers, or the share of true values; NaN without values."""
    found = np.asarray(values, dtype=np.float64)
    return float(found.mean()) if found.size else math.nan


def deviation(values: npt.ArrayLike) -> float:
    """Return the sample standard deviation of numbers; NaN of fewer than two."""
    found = np.asarray(values, dtype=np.float64)
    return float(found.std(ddof=1)) if found.size > 1 else math.nan


def median(values: npt.ArrayLike) -> float:
    """Return the median of numbers; NaN without numbers."""
    found = np.asarray(values, dtype=np.float64)
    return float(np.median(found)) if found.size else math.nan


def quantile(values: npt.ArrayLike, share: float) -> float:
    """Return the quantile of values, which is one of them; NaN without values."""
    found = np.asarray(values, dtype=np.float64)
    return float(np.quantile(found, share, method="higher")) if found.size else math.nan


class Specimens:
    """Figures of the finished specimens, of a ``wanted`` number, from a seed on.

    Those of an unfinished study are kept in a file as ``text``.
    """

    def __init__(
        self,
        study: Study,
        wanted: int,
        seed: int,
        unfinished: Path | None,
        text: Callable[[Mapping[str, Any]], str],
    ) -> None:
        self._study, self._wanted, self._seed = study, wanted, seed
        self._file, self._text = unfinished, text
        self.first: Any = None
        self.runs: list[Mapping[str, Any]] = []
        self.gathered: dict[str, Any] = {}

    def run(self, module: str, options: Mapping[str, Any], now: Callable[..., None]) -> None:
        """Run the study of a module: the first specimen here, the others on other cores meanwhile.

        ``now`` is called with texts on the progress.
        """
        work, told = partial(_figures_of, module, options), dict(options)
        if "told" in self._study.options:
            told["told"] = lambda part: now(f"seed {self._seed}, {part}", kept=True)
        with begun(work, self._wanted - 1, self._seed + 1) as others:
            with one_thread():
                began = time.monotonic()
                self.first = self._study.run(self._seed, **told)
            self._add(figures_of(self.first), time.monotonic() - began, now)
            for figures, seconds in others:
                self._add(figures, seconds, now)

    def _add(self, figures: Mapping[str, Any], seconds: float, now: Callable[..., None]) -> None:
        """Add the figures of the next specimen, report its duration, and write all figures."""
        seed = self.next_seed
        self.runs.append(figures)
        self.gathered = (self._study.gather or medians)(self.runs)
        done = len(self.runs)
        now(f"specimen {done} of {self._wanted}, seed {seed}: {seconds:.0f} s", kept=True)
        if done < self._wanted:
            if self._file is not None:
                so_far = {"unfinished": True, "specimens": done, "of": self._wanted}
                content = {**self.gathered, **so_far, "seed": self._seed}
                write_atomically(self._file, self._text(content))
            now(f"specimen {done + 1} of {self._wanted}")
        elif self._file is not None:
            self._file.unlink(missing_ok=True)

    @property
    def next_seed(self) -> int:
        """Seed of the next specimen."""
        return self._seed + len(self.runs)

    def kept(self) -> str:
        """Return a sentence on the results kept after an interruption or an error."""
        done = f"{len(self.runs)} of {self._wanted} specimens are done"
        if not self.runs:
            return f"{done}; nothing is kept"
        if self._file is None:
            return f"{done}; nothing is kept without --out"
        return f"{done}; their figures are in {self._file}"


def _figures_of(module: str, options: Mapping[str, int], seed: int) -> tuple[dict[str, Any], float]:
    """Return the figures of one specimen and its duration, in a separate process."""
    began = time.monotonic()
    return figures_of(study_of(module).run(seed, **options)), time.monotonic() - began


def for_each(
    work: Callable[[int], T], specimens: int, seed: int, *, ordered: bool = True
) -> Iterator[T]:
    """Yield ``work(seed)``, ``work(seed + 1)``, ...: on all cores, one process and one thread each.

    Unless they are to be ``ordered``, results come as they are ready. The processes are ended at
    once when the iterator is closed before its last result.
    """
    if specimens == 1:
        yield _alone(work, seed)
        return
    with begun(work, specimens, seed, ordered=ordered) as results:
        yield from results


@contextmanager
def begun(
    work: Callable[[int], T], specimens: int, seed: int, *, ordered: bool = True
) -> Iterator[Iterator[T]]:
    """Begin the work of `for_each`, and yield its results; unfinished work is ended at the exit."""
    others = set(active_children())
    # A terminal sends its interruption to all processes; the first one ends the others.
    ignoring = partial(signal.signal, signal.SIGINT, signal.SIG_IGN)
    with ProcessPoolExecutor(mp_context=get_context("spawn"), initializer=ignoring) as pool:
        tasks: list[Future[T]] = []
        try:
            tasks += [pool.submit(_alone, work, each) for each in range(seed, seed + specimens)]
            yield (task.result() for task in (tasks if ordered else as_completed(tasks)))
        finally:
            if not (tasks and all(task.done() for task in tasks)):
                for child in set(active_children()) - others:
                    child.terminate()


def _alone(work: Callable[[int], T], seed: int) -> T:
    with one_thread():
        return work(seed)

"""Read a record to identify: a table, or the settled points of an experiment store."""

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from minorloop.errors import ParameterError, RecordError
from minorloop.files import PathLike
from minorloop.identification.adaptive import Adaptive
from minorloop.identification.fit import Plane
from minorloop.identification.plane_result import Identification
from minorloop.identification.preparation import RecordAdvice
from minorloop.identification.prior import Prior
from minorloop.lab._store_file import is_store
from minorloop.lab.logs import AUTO, Named, read_log
from minorloop.lab.records import Record
from minorloop.lab.store import Point, Setup, Store


def read(
    path: PathLike,
    *,
    input: str | None = None,
    output: str | None = None,
    time: Named = AUTO,
    curves: str | None = None,
    groups: str | None = None,
    sd: Named = AUTO,
    progress: Callable[[str], None] | None = None,
) -> Record:
    """Read a record to identify, with further columns such as time and labels.

    Raises a `RecordError` if the file, a column or the times cannot be used; a `ParameterError` if
    a column is missing, is given twice or belongs to no table.

    Parameters
    ----------
    path : str or path
        A table with one header line (CSV, .mat or .xlsx), or an experiment store, which has its
        own input, output and standard deviations.
    input, output : str
        Columns of a table, by the whole header (``voltage [V]``) or the name (``voltage``); the
        output may have empty cells.
    time : str, optional
        Column of time, in s unless its header says ms, us, min or h, or date and time. ``"auto"``:
        the column with the name or the unit of a time, if there is one. None: no time.
    curves, groups : str, optional
        Columns of labels, as the options of `identify` of these names.
    sd : str, optional
        Column of the standard deviation of the output. ``"auto"``: the column ``sd`` in the unit of
        the output, if there is one, or those of a store. None: outputs count alike.
    progress : callable, optional
        Called with the share of the file that has been read, as text.

    Examples
    --------
    >>> ml.Record([0.0, 1.0], [0.1, 0.9], None, "u [V]", "y [um]").to_csv("run.csv")
    >>> ml.read("run.csv", input="u", output="y").output.unit
    'um'
    """
    if not isinstance(path, str | os.PathLike):
        raise ParameterError(f"path is {path!r}; give the name of a file")
    if is_store(path):
        named = (input, output, curves, groups, None if time == AUTO else time)
        if any(named) or sd not in (AUTO, None):
            raise ParameterError(
                f"{path} is an experiment store, which has one input and one output; "
                "leave input, output, time, sd, curves and groups out"
            )
        return _points(path, weighted=sd == AUTO)
    if input is None or output is None:
        if not os.path.exists(path):
            raise RecordError(f"{path} does not exist; give a CSV file or an experiment store")
        missing = "input" if input is None else "output"
        raise ParameterError(f"{missing} (--{missing}) is missing; name a column of {path}")
    return read_log(
        path,
        input=input,
        output=output,
        time=time,
        curves=curves,
        groups=groups,
        sd=sd,
        progress=progress,
    )


def _is_adaptive(store: Store) -> bool:
    """Whether a run chose its inputs to identify; a drive has another design.

    Raises a `ParameterError` if it has sines and no settled points.
    """
    if store.plan.sines:
        raise ParameterError(
            "the store has sines and no settled points; evaluate it with minorloop frequency"
        )
    return "holds" in (store.setup.design or {})


def chooser_of(setup: Setup, points: list[Point]) -> Adaptive:
    """Return the `Adaptive` that chose the levels of a store, with the noise from its points."""
    chooser = Adaptive(**(setup.design or {}), seed=setup.seed)
    chooser.learn_noise([point.sd for point in points])
    return chooser


def _points(path: PathLike, *, weighted: bool) -> Record:
    """Return the points of a store; those of an adaptive run are identified with its settings."""
    with Store.open(path) as store:
        points = store.points()
        chooser = chooser_of(store.setup, points) if _is_adaptive(store) else None
        sd = np.array([point.sd for point in points])
        log = store.record().with_origin(settled=True)
        if weighted and np.isfinite(sd[np.isfinite(log.y)]).any():
            log = log.replace(sd=sd).with_origin(sd_column="sd")
        if store.running:
            note = f"the run continues, and has {len(store)} of {len(store.plan)} points so far"
            log = log.with_origin(notes=(note,))
    if chooser is None:
        return log
    return log.with_origin(identified_by=partial(_identify_run, chooser))


def _identify_run(
    chooser: Adaptive, record: Record, law: Plane, prior: Prior, holdout: float
) -> Identification:
    """Return the model of an adaptive run, by its settings, with its validation held out."""
    if not record.whole or holdout != 0 or record.skip != 0:
        raise ParameterError(
            "an adaptive run holds out its own validation; omit rows, skip and holdout"
        )
    u, y = record.u.tolist(), record.y.tolist()
    result = chooser.identification(u, y, law, prior, record.start)
    found = chooser.findings(u, y)
    new = tuple(text for text in found.warnings if text not in result.advice)
    told = RecordAdvice(notes=record.origin.notes, warnings=new, not_fitted=found.outliers)
    return replace(result, t=record.t, told=told, record=record)

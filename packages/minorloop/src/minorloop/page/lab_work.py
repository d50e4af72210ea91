"""Tasks of the lab page, which run in worker processes.

A task is a generator whose reports are sent to the page. Each file has its own folder, and the
worker changes into it, so that messages contain only the name of the file.
"""

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop import modelfile
from minorloop.drawing.identification import loop_points
from minorloop.errors import ParameterError, RecordError
from minorloop.files import table_text, write_atomically
from minorloop.identification import Dynamics, Plane, Viscosity, identify, read
from minorloop.identification.choosing import LEVELS as DEFAULT_LEVELS
from minorloop.identification.pipeline import Options
from minorloop.identification.result import Fit
from minorloop.lab.columns import read_each
from minorloop.lab.headers import split_header
from minorloop.lab.logs import AUTO, read_times
from minorloop.lab.records import Record
from minorloop.lab.tables import Bounds
from minorloop.lab.timebase import time_column
from minorloop.operators.memory import Memory
from minorloop.operators.preisach import Preisach
from minorloop.page.lab_words import on_page
from minorloop.page.uploads import INPUTS, MODEL, REPORT

Reports: TypeAlias = Iterator[dict[str, Any]]

_SHOWN, _PREVIEWED = 2500, 400
"""Most points of a curve for the page."""
# Limits that keep a task within the time and memory of a worker.
_MOST_LEVELS, _MOST_TARGETS = 100, 10_000
_BOUNDS = Bounds(
    rows=500_000, columns=100, advice=" here, or use 'minorloop identify' on the command line"
)
"""The largest table that the page reads."""


def warm_up() -> None:
    """Compile kernels for which the first user would have to wait."""
    u = np.concatenate([np.linspace(0, 1, 40), np.linspace(1, 0.2, 40), np.linspace(0.2, 1, 40)])
    rng = np.random.default_rng(0)
    model = identify(u, u**2 + rng.normal(0, 0.01, u.size), Plane(4), holdout=0.2).model
    model.invert([0.3, 0.2])
    model.step(Memory.negative(0.0), 0.5)


def look(folder: str, name: str) -> Reports:
    """Describe the columns of a CSV file: unit, rows, range, and whether it looks like time."""
    os.chdir(folder)
    columns: list[dict[str, Any]] = []
    found = read_each(name, _BOUNDS)
    for index, (header, values) in enumerate(found):
        if isinstance(values, RecordError):
            columns.append({"header": header, "trouble": str(values)})
            continue
        finite = values[np.isfinite(values)]
        columns.append(
            {
                "header": header,
                "unit": split_header(header)[1],
                "rows": int(values.size),
                "measured": int(finite.size),
                "least": _number(finite.min()) if finite.size else None,
                "greatest": _number(finite.max()) if finite.size else None,
                "course": _listed(values[_few(values.size, _PREVIEWED)]),
                "time": index == 0 and finite.size > 2 and bool((np.diff(finite) > 0).all()),
            }
        )
    usable = [c for c in columns if "trouble" not in c]
    if len(usable) < 2:
        trouble = next((c["trouble"] for c in columns if "trouble" in c), "")
        raise RecordError(trouble or f"{name} has one column; give an input and an output")
    time = None
    with suppress(RecordError):  # two columns could be time, or the column is not a clock
        if time := time_column([header for header, _ in found]):
            read_times(name, time)
    yield {"name": name, "columns": columns, "time": time}


def identify_file(
    folder: str,
    name: str,
    input: str,
    output: str,
    *,
    time: str | None = None,
    curves: str | None = None,
    groups: str | None = None,
    first: int = 0,
    last: int | None = None,
    dynamics: str = "none",
    creep: str = "none",
    rate: bool = False,
    **options: Any,
) -> Reports:
    """Identify a model; report stages, the result, and the end of the report.

    Columns, rows and options are those of the lab page; ``creep`` and ``rate`` name laws of time to
    compare, as in `minorloop.Viscosity`. Further options are those of
    `minorloop.identification.pipeline.Options`.
    """
    os.chdir(folder)
    if input == output:
        raise ParameterError("input and output are the same column; choose two")
    yield {"stage": f"reading {name}"}
    levels = options.get("levels", AUTO)
    count = DEFAULT_LEVELS if levels == AUTO else levels
    if not isinstance(count, int) or not 1 <= count <= _MOST_LEVELS:
        raise ParameterError(f"levels is {levels!r}; give 1 to {_MOST_LEVELS} here")
    log = read(name, input=input, output=output, time=time, curves=curves, groups=groups)
    asked = Options.of(options)
    log = log.only(first, last).replace(**asked.of_record)
    measured = int(np.isfinite(log.y[log.part]).sum())
    began = perf_counter()
    if creep != "none" or rate:
        if dynamics != "none":
            raise ParameterError("dynamics cannot be combined with creep or rate; choose one")
        yield {"stage": f"comparing laws of time on {measured} rows"}
        found: Fit[Any] = Viscosity(
            count,
            creep,  # type: ignore[arg-type]
            True if rate else AUTO if creep == AUTO else False,
            "uniform" if asked.law.diagonal == "uniform" else "reversible",
            asked.law.spacing,
        ).identify(log)
    else:
        cells = count * (count + 1) // 2
        yield {"stage": f"fitting {cells} cells to {measured} of {log.y[log.part].size} rows"}
        if dynamics == "none":
            found = asked.identify(log)
        else:
            moving = Dynamics(replace(asked.law, lag=AUTO))
            log = log.replace(start_of_curve=None)
            found = moving.identify(log, asked.prior, asked.holdout)
    seconds = perf_counter() - began
    yield {"stage": "scoring"}
    found.save(MODEL, provenance=modelfile.Provenance.of(Path(name)), force=True)
    yield {"result": _shown(found, log, seconds)}
    yield {"stage": "drawing the report"}
    found.report(name).write(REPORT, force=True)
    yield {"report": True}


def move(folder: str, memory: list[float] | None, u: float) -> Reports:
    """Report output and memory after one more input."""
    model = _preisach(_model(folder))
    before = Memory.negative(float(model.levels[0])) if memory is None else Memory(memory)
    y, after = model.step(before, u)
    yield {"y": float(np.asarray(y)), "memory": list(after.extrema)}


def invert(folder: str, targets: list[float], start: str) -> Reports:
    """Report inputs for targets; targets out of reach are approached and marked."""
    if not 0 < len(targets) <= _MOST_TARGETS:
        raise ParameterError(f"there are {len(targets)} targets; give 1 to {_MOST_TARGETS}")
    known = _model(folder)
    found = _preisach(known).invert(np.array(targets), start, "clip")  # type: ignore[arg-type]
    columns = known.inverse_columns(targets, found)
    os.chdir(folder)
    write_atomically(INPUTS, table_text(columns, zip(*columns.values(), strict=True)))
    yield {
        "u": found.u.tolist(),
        "y": found.y.tolist(),
        "reachable": found.reachable.tolist(),
        "worst": found.worst,
        "warnings": list(map(on_page, known.warnings)),
    }


def _shown(found: Fit[Any], log: Record, seconds: float) -> dict[str, Any]:
    """Return the content of the page for a result.

    Lines of the loop are interrupted at null. ``rows`` are times if they are known, and ``held`` is
    the first held-out row. With dynamics, the loop is that of the operator; the other curves are of
    the whole model.
    """
    shown, plane = _few(found.u.size, _SHOWN), found.plane
    static = getattr(found, "static", found)
    (u, y), (_, fit) = (loop_points(static, each) for each in (static.y, static.prediction))
    drawn = _few(u.size, _SHOWN)
    x = np.arange(found.u.size, dtype=np.float64) if found.t is None else found.t
    return {
        "input": str(log.input),
        "output": str(log.output),
        "u": _listed(found.u[shown]),
        "y": _listed(found.y[shown]),
        "fit": _listed(found.prediction[shown]),
        "loop": {
            "u": _listed(u[drawn]),
            "y": _listed(y[drawn]),
            "fit": _listed(fit[drawn]),
            "joined": drawn.size == u.size,
        },
        "rows": x[shown].tolist(),
        "clock": "row" if found.t is None else str(log.time),
        "held": float(x[np.argmax(found.held_out)]) if found.held_out.any() else None,
        "levels": plane.levels.tolist(),
        "weights": [_listed(row[: k + 1]) for k, row in enumerate(plane.weights)],
        "range": list(plane.range),
        "scores": {
            "fit": found.nrmse,
            "holdout": found.holdout_nrmse,
            "lag": found.lag,
            "samples": int(found.fitted.sum()),
            "unknowns": found.unknowns,
            "seconds": seconds,
        },
        "table": found.summary(),
        "choices": list(map(on_page, found.chosen)),
        "advice": list(map(on_page, found.advice)),
        "warnings": list(map(on_page, found.warnings)),
    }


def _model(folder: str) -> modelfile.ModelFile:
    """Return the identified model in a folder."""
    file = Path(folder) / MODEL
    if not file.is_file():
        raise ParameterError("there is no model yet; identify one first")
    return _loaded(str(file), file.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _loaded(file: str, changed: int) -> modelfile.ModelFile:
    return modelfile.read(file)


def _preisach(known: modelfile.ModelFile) -> Preisach:
    assert isinstance(known.operator, Preisach)  # the only kind that the page identifies
    return known.operator


def _few(count: int, most: int) -> npt.NDArray[np.intp]:
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.intp))


def _listed(values: npt.ArrayLike) -> list[float | None]:
    return [_number(x) for x in np.asarray(values, dtype=np.float64)]


def _number(x: float) -> float | None:
    return float(f"{x:.6g}") if np.isfinite(x) else None

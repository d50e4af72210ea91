"""Identify one specimen from the bytes of its record, in a worker."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.errors import MinorloopError, RecordError
from minorloop.fleet.manifest import Specimen
from minorloop.fleet.results import one_line
from minorloop.lab.records import Record
from minorloop.operators.preisach import Preisach

Found = Mapping[str, Any]
"""A model and its scores, or the reason for a failure under ``error``."""


@dataclass(frozen=True)
class Task:
    """One specimen to identify."""

    specimen: Specimen
    """The specimen."""
    data: bytes
    """Content of the file of its record."""
    options: Mapping[str, Any]
    """Of `minorloop.identify`."""


def identify_one(task: Task, scratch: Path) -> Found:
    """Identify the model of a specimen and its scores; errors are returned as text.

    Parameters
    ----------
    task : Task
        What to identify.
    scratch : Path
        Name of a temporary file for the record.
    """
    from minorloop.identification.pipeline import Options

    began = time.perf_counter()
    try:
        log = _log(task, scratch)
        result = Options.of(task.options).identify(log)
        model = result.model
        return {
            "model": model,
            "input": str(log.input),
            "output": str(log.output),
            "lag": result.lag_of_model,
            "lag_seconds": result.lag_seconds,
            "nrmse": float(result.nrmse),
            "nrmse_holdout": result.holdout_nrmse,
            "excited": result.excited_fraction,
            "opening": opening(model),
            "samples": int(result.samples),
            "warnings": result.warnings,
            "advice": result.advice,
            "chosen": result.chosen,
            "seconds": time.perf_counter() - began,
        }
    except Exception as error:
        kind = "" if isinstance(error, MinorloopError) else f"{type(error).__name__}: "
        return {"error": one_line(f"{kind}{error}")}


def opening(model: Preisach) -> float:
    """Return the widest gap between the two major branches, as a share of the range."""
    up = model.simulate(model.levels)
    down = model.simulate(model.levels[::-1], "positive")[::-1]
    width = float(np.ptp(model.range))
    return float(np.abs(down - up).max()) / width if width else 0.0


def load_kernels() -> None:
    """Compile and load the kernels by identifying a small record."""
    from minorloop.identification import Plane, Smooth, identify

    u = np.resize([0.0, 1.0, 0.25, 0.75, 0.5], 60)
    identify(u, u + 0.1 * (np.arange(60) % 2), Plane(2), prior=Smooth())


def _log(task: Task, scratch: Path) -> Record:
    from minorloop.identification import read

    one = task.specimen
    try:
        with scratch.open("xb") as file:
            file.write(task.data)
        return read(scratch, **one.columns)
    except RecordError as error:
        text = one.shown_error(error).replace(str(scratch), str(one.file))
        raise RecordError(text) from None
    finally:
        scratch.unlink(missing_ok=True)

"""Identify one specimen from the bytes of its record, in a worker."""

import hashlib
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from minorloop import modelfile
from minorloop.errors import MinorloopError, RecordError
from minorloop.fleet.manifest import Specimen
from minorloop.fleet.summary import Outcome
from minorloop.lab.records import Record
from minorloop.operators.preisach import Preisach

Found: TypeAlias = tuple[Outcome, bytes | None]
"""Result of a specimen, and the content of its model file if it has a model."""


@dataclass(frozen=True)
class Task:
    """One specimen to identify."""

    specimen: Specimen
    """The specimen."""
    data: bytes
    """Content of the file of its record."""
    options: Mapping[str, Any]
    """Options of `minorloop.identify`."""

    @property
    def sha256(self) -> str:
        """Digest of the record."""
        return hashlib.sha256(self.data).hexdigest()

    def failed(self, reason: str) -> Found:
        """Return a result without a model, with the reason."""
        return self.specimen.outcome(error=reason, sha256=self.sha256), None


def identify_one(task: Task, scratch: Path) -> Found:
    """Identify the model of a specimen and its scores; errors are returned as text.

    ``scratch`` is the name of a temporary folder for the record and the model.
    """
    from minorloop.identification.pipeline import Options

    began = time.perf_counter()
    try:
        log = _log(task, scratch)
        result = Options.of(task.options).identify(log)
        low, high = map(float, result.model.range)
        outcome = task.specimen.outcome(
            nrmse=float(result.nrmse),
            nrmse_holdout=result.holdout_nrmse,
            excited=result.excited_fraction,
            low=low,
            high=high,
            opening=opening(result.model),
            samples=int(result.samples),
            seconds=time.perf_counter() - began,
            sha256=task.sha256,
            warning="; ".join(result.warnings),
            advice="; ".join(result.advice),
            chosen="; ".join(result.chosen),
        )
        origin = modelfile.Provenance(data=task.specimen.file.name, sha256=outcome.sha256)
        result.save(scratch / "model.json", provenance=origin)
        data = (scratch / "model.json").read_bytes()
        return replace(outcome, model=hashlib.sha256(data).hexdigest()), data
    except Exception as error:
        kind = "" if isinstance(error, MinorloopError) else f"{type(error).__name__}: "
        return task.failed(f"{kind}{error}")
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


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
    copy = scratch / f"record{one.file.suffix}"
    scratch.mkdir()
    copy.write_bytes(task.data)
    try:
        return read(copy, **one.columns)
    except RecordError as error:
        text = one.shown_error(error).replace(str(copy), str(one.file))
        raise RecordError(text) from None

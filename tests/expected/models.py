"""Cases of the library: every kind of model as a file, its predictions, inverse and exports."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import minorloop as ml
from expected import inputs
from expected.case import Case
from minorloop.errors import MinorloopError
from minorloop.operators.generalised_prandtl_ishlinskii import DeadZones
from minorloop_head.heated_wire import HeatedWire

_RNG = np.random.default_rng(1000)
_LEVELS = np.linspace(-1, 1, 9)
_WEIGHTS = np.tril(_RNG.uniform(0, 1, (8, 8)))
_SMALL = np.tril(_RNG.uniform(0, 0.1, (8, 8)))
_PLAYS = ml.PrandtlIshlinskii([0.0, 0.1, 0.5], [1.0, 0.4, 0.3], 0.25)
_LAG = ml.Linear([0.3], [1.0, -0.7], 0.01, 0.02)
MODELS: Mapping[str, Any] = {
    "preisach": ml.Preisach(_LEVELS, _WEIGHTS, 0.3, slope=0.2),
    "reversible": ml.Preisach(_LEVELS, _WEIGHTS, 0.3, "unipolar", "reversible"),
    "relays": ml.RelayModel(_LEVELS[:8], _WEIGHTS, -0.5, "unipolar"),
    "plays": _PLAYS,
    "generalised_plays": ml.GeneralisedPrandtlIshlinskii(
        _PLAYS, DeadZones([-1.0, 0.0, 2.0], [0.1, 1.0, 0.5]), 3.0
    ),
    "polynomial": ml.Polynomial([0.1, 0.9, 0.3], -1.0, 1.0),
    "cascade": ml.Cascade(ml.Preisach(_LEVELS, _WEIGHTS), _LAG, "operator"),
    "linear": _LAG,
    "heated_wire": HeatedWire(ml.Preisach(_LEVELS, _WEIGHTS), 0.3, 0.1),
    "after_effect": ml.AfterEffect(
        ml.Preisach(_LEVELS, _WEIGHTS), 0.0, 0.0, [0.1, 3.0], [_SMALL, _SMALL]
    ),
    "oscillator": ml.Oscillator(2.0, 0.5, [50.0, 0.0], ml.BoucWen(50.0, 0.8, -1.1, 1.0)),
}

_TIMED = (ml.AfterEffect, ml.Cascade, ml.Linear, ml.Oscillator, HeatedWire)


def _file(model: Any) -> list[str]:
    ml.save(model, "model.json", input="voltage [V]", output="length [um]", force=True)
    text = Path("model.json").read_text(encoding="utf-8").splitlines()
    return [line for line in text if '"created"' not in line and '"minorloop"' not in line]


def _or_error(call: Any, *arguments: Any) -> Any:
    """Return what a call gives, or the error that it raises."""
    try:
        return call(*arguments)
    except (MinorloopError, AttributeError, TypeError) as error:
        return f"{type(error).__name__}: {error}"


def _kept() -> Any:
    """Return the file of each model, its output along a walk, and inputs for some targets."""
    u, t = inputs.walk(240, 1002), np.arange(240) * 0.01
    targets = np.array([0.1, 0.3, -0.05, 0.5, 0.2])
    found = {}
    for name, model in MODELS.items():
        timed = isinstance(model, _TIMED)
        low, high = getattr(model, "range", (0.0, 1.0))
        wanted = low + (high - low) * targets if np.isfinite(high - low) else targets
        found[name] = {
            "file": _file(model),
            "output": _or_error(model.simulate, *((t, u) if timed else (u,))),
            "range": [low, high],
        }
        if hasattr(model, "invert"):
            found[name]["inverse"] = _or_error(
                model.invert, *((t[: wanted.size] * 100, wanted) if timed else (wanted,))
            )
    return found


def texts(folder: Path) -> dict[str, Any]:
    """Return the lines and the digest of each file in a folder."""
    return {
        path.relative_to(folder).as_posix(): {
            "lines": len(path.read_text(encoding="utf-8").splitlines()),
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        }
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _exported() -> Any:
    """Return the C of each model that can be exported, and what its self-test prints."""
    from minorloop.export.c99 import export_c

    found: dict[str, Any] = {}
    for name, model in MODELS.items():
        for float32 in (False, True):
            folder = Path(f"{name}{'32' * float32}")
            written = _or_error(lambda m=model, f=folder, s=float32: export_c(m, f, float32=s))
            if isinstance(written, str):
                found[folder.name] = written
                continue
            found[folder.name] = texts(folder) | {"self_test": _self_test(folder)}
    return found


def _self_test(folder: Path) -> str:
    if shutil.which("gcc") is None:
        return "no gcc"
    sources = [path.name for path in sorted(folder.glob("*.c"))]
    build = ["gcc", "-std=c99", "-O1", *sources, "-lm", "-o", "self_test"]
    subprocess.run(build, cwd=folder, check=True, capture_output=True)
    run = subprocess.run(
        [folder.resolve() / "self_test"], capture_output=True, text=True, check=True, timeout=60
    )
    return run.stdout


CASES = (Case("models", _kept), Case("exports", _exported, left_out=("*.self_test",)))

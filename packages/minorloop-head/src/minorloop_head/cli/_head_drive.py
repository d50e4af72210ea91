"""Output of ``head drive``, also of an unfinished drive."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.errors import MinorloopError

if TYPE_CHECKING:
    from minorloop_head.procedures.drive_faults import DriveFault
    from minorloop_head.procedures.steer import SteeredHead

_MEANS = "degrees, means of the last fifth of each hold"


class UnfinishedDrive:
    """Keeps and shows the record of a drive that an error or a signal ended.

    ``save``: file to be written; ``force``: whether it may be replaced; ``as_json``: whether it is
    shown as an object beside that of the error.
    """

    def __init__(self, save: Path | None, force: bool, as_json: bool = False) -> None:
        self._save, self._force, self._said = save, force, ""
        self._as_json = as_json
        self._found: SteeredHead | None = None

    def __call__(self, found: SteeredHead, safe: bool) -> None:
        """Keep the record; ``safe`` says whether the head confirmed that it is safe."""
        self._found = found
        kept = "nothing is kept without --save"
        if self._save is not None:
            _save_drive(found, self._save, self._force)
            kept = f"the record is kept in {self._save}"
        self._said = f"the drive ended after {found.t[-1]:.1f} s, and {kept}"
        if safe:
            self._said += "; the head has confirmed that it is safe"

    @contextmanager
    def said(self) -> Iterator[None]:
        """Show the record, and name the kept file, if the work inside ends early."""
        try:
            yield
        except (KeyboardInterrupt, MinorloopError) as error:
            if isinstance(error, KeyboardInterrupt) and not self._said:
                self._said = "the drive has not begun, and nothing is kept"
            if self._said:
                typer.echo(self._said, err=True)
            if self._found is not None:
                if self._as_json:
                    _common.print_beside_error({"unfinished": _numbers(self._found)})
                else:
                    _show(self._found, f"{_MEANS}, or of the drive in it")
                _show_warnings(self._found)
            raise


def _save_drive(found: SteeredHead, path: Path, force: bool) -> None:
    """Write the record of all ticks as a table."""
    import numpy as np

    table = {"time [s]": np.round(found.t, 6)}
    for k, axis in enumerate(("pan", "tilt")):
        table |= {f"wanted {axis} [deg]": found.wanted[:, k]}
        table |= {f"{axis} [deg]": found.read[:, k], f"{axis} [A]": found.current[:, k]}
    for k, axis in enumerate(("pan", "tilt")):
        table |= {f"{axis} by the model [deg]": found.modelled[:, k]}
        table |= {f"{axis} used": found.used[:, k].astype(float)}
    _common.write_csv(path, table, force=force)


def finish_drive(result: SteeredHead, save: Path | None, force: bool, as_json: bool) -> None:
    """Save a drive, print the angles at the end of each hold, and warn of problems."""
    if save is not None:
        _save_drive(result, save, force)
    if as_json:
        _common.print_json(_numbers(result))
    else:
        _show(result, _MEANS)
    _show_warnings(result)


def _show_warnings(result: SteeredHead) -> None:
    """Print the problems on stderr, one per line."""
    for said in result.warnings:
        typer.echo(f"warning: {said}", err=True)


def _rms(result: SteeredHead) -> float:
    """Return the error in degrees where readings were used, NaN if none was."""
    import numpy as np

    off = (result.reached - result.targets).ravel()
    off = off[np.isfinite(off)]
    return float(np.sqrt(np.mean(off**2))) if off.size else math.nan


def _numbers(result: SteeredHead) -> dict[str, Any]:
    """Return the numbers of a drive for JSON."""
    import numpy as np

    return {
        "targets_deg": result.targets,
        "reached_deg": result.reached,
        "rms_deg": _rms(result),
        "readings_used": np.isfinite(result.reached),
        "by_model_deg": result.expected,
        "unreachable": result.unreachable,
        "missed": result.missed,
        "unconfirmed": result.unconfirmed,
        "faults": [_fault(each) for each in result.faults],
    }


def _show(result: SteeredHead, title: str) -> None:
    """Print the angles and their error as a table."""
    import numpy as np

    known = np.isfinite(result.reached)
    shown = np.where(known, result.reached, result.expected)
    rows = [
        (
            *(f"{each:.2f}" for each in result.targets[n]),
            *(f"{shown[n, k]:.2f}{'' if known[n, k] else ' (model)'}" for k in range(2)),
        )
        for n in range(len(shown))
    ]
    columns = ("pan wanted", "tilt wanted", "pan", "tilt")
    _common.print_table(columns, rows, title)
    if not known.any():
        typer.echo("(model): by the model; no reading was used, so that no error is known")
        return
    typer.echo(f"error {_rms(result):.2f} deg rms, by the readings")
    if not known.all():
        typer.echo(
            "(model): by the model, because readings were missing or not used; the error is of the "
            f"other {known.sum()} of {known.size} angles"
        )


def _fault(fault: DriveFault) -> dict[str, Any]:
    """Return a fault of a drive by name."""
    units = {"began": "began_s", "lasted": "lasted_s"}
    return {units.get(name, name): value for name, value in asdict(fault).items()}

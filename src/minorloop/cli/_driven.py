"""What ``head drive`` prints and saves, also of a drive that was not finished."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.errors import MinorloopError

if TYPE_CHECKING:
    from minorloop.head.procedures.drive_faults import DriveFault
    from minorloop.head.procedures.steer import SteeredHead


class UnfinishedDrive:
    """Keeps what a drive measured before an error or a signal ended it, and says so.

    Parameters
    ----------
    save : Path, optional
        File to be written.
    force : bool
        Whether it may be replaced.
    """

    def __init__(self, save: Path | None, force: bool) -> None:
        self._save, self._force, self._said = save, force, ""

    def __call__(self, found: SteeredHead, safe: bool) -> None:
        """Keep what was measured; ``safe`` tells whether the head confirmed that it is."""
        kept = "nothing is kept without --save"
        if self._save is not None:
            save_drive(found, self._save, self._force)
            kept = f"what was measured is kept in {self._save}"
        self._said = f"the drive ended after {found.t[-1]:.1f} s, and {kept}"
        if safe:
            self._said += "; the head has confirmed that it is safe"

    @contextmanager
    def said(self) -> Iterator[None]:
        """Say what is kept if an error or a signal ends the work inside."""
        try:
            yield
        except (KeyboardInterrupt, MinorloopError) as error:
            if isinstance(error, KeyboardInterrupt) and not self._said:
                self._said = "the drive has not begun, and nothing is kept"
            if self._said:
                typer.echo(self._said, err=True)
            raise


def save_drive(found: SteeredHead, path: Path, force: bool) -> None:
    """Write what was measured in each tick, as a table."""
    table = {"time [s]": found.t}
    for k, axis in enumerate(("pan", "tilt")):
        table |= {f"wanted {axis} [deg]": found.wanted[:, k]}
        table |= {f"{axis} [deg]": found.read[:, k], f"{axis} [A]": found.current[:, k]}
    for k, axis in enumerate(("pan", "tilt")):
        table |= {f"{axis} by the model [deg]": found.modelled[:, k]}
        table |= {f"{axis} used": found.used[:, k].astype(float)}
    _common.write_csv(path, table, force=force)


def show_drive(result: SteeredHead, as_json: bool) -> None:
    """Print the angles at the end of each hold, and their error where readings were used."""
    import numpy as np

    known = np.isfinite(result.reached)
    off = (result.reached - result.targets)[known]
    rms = float(np.sqrt(np.mean(off**2))) if off.size else math.nan
    if as_json:
        content = {"targets_deg": result.targets, "reached_deg": result.reached, "rms_deg": rms}
        content |= {"readings_used": known, "by_model_deg": result.expected}
        content |= {"unreachable": result.unreachable, "missed": result.missed}
        content |= {"unconfirmed": result.unconfirmed}
        _common.print_json({**content, "faults": [_fault(each) for each in result.faults]})
        return
    shown = np.where(known, result.reached, result.expected)
    rows = [
        (
            *(f"{each:.2f}" for each in result.targets[n]),
            *(f"{shown[n, k]:.2f}{'' if known[n, k] else ' (model)'}" for k in range(2)),
        )
        for n in range(len(shown))
    ]
    columns = ("pan wanted", "tilt wanted", "pan", "tilt")
    _common.print_table(columns, rows, "degrees at the end of each hold")
    typer.echo(f"error {rms:.2f} deg rms")
    if not known.all():
        typer.echo(
            "(model): by the model, because readings were missing or not used; the error is of the "
            f"other {known.sum()} of {known.size} angles"
        )


def _fault(fault: DriveFault) -> dict[str, Any]:
    """Return a fault of a drive by name."""
    return {
        "axis": fault.axis,
        "began_s": fault.began,
        "lasted_s": fault.lasted,
        "times": fault.times,
        "what": fault.what,
        "cooled": fault.cooled,
        "over": fault.over,
        "late": fault.late,
    }

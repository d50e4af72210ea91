"""Report of a drive: targets and what was achieved."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from minorloop.drawing.layout import new_figure
from minorloop.drive import DriveResult
from minorloop.errors import counted
from minorloop.report import Picture, Report, Table


def drive_report(
    result: DriveResult, run: Mapping[str, Any], warnings: Sequence[str] = ()
) -> Report:
    """Return a report of a drive: the targets, the outputs achieved, and the errors.

    ``result``: of the drive; ``run``: actuator, input and output of the run by name, as the command
    line prints them; ``warnings``: of the run.
    """
    score, output = result.summary(), run["output"]
    rms = "nothing was measured" if score["rms"] is None else f"{score['rms']:.3g} rms"
    report = Report(
        f"{counted(len(result.arrivals), 'target')} on {run['actuator']}",
        f"Error: {rms}, in the unit of {output}. In saturation the sensor read "
        f"{result.offset:+.4g} more than the model; targets and outputs here count from the zero "
        "that was chosen for the drive.",
    )
    columns = ("target", str(run["input"]), "achieved", "error", "sd", "holds", "last hold")
    report.add(
        "Targets",
        pictures=[Picture(_draw_drive(result, output), "Targets, achieved outputs, and errors.")],
        table=Table(columns, result.rows),
        notes=list(warnings),
    )
    return report


def _draw_drive(result: DriveResult, output: str) -> Any:
    """Draw targets and achieved outputs in order, and the errors with two standard deviations.

    ``output`` is the name and unit of the output.
    """
    number = np.arange(1, len(result.arrivals) + 1)
    targets = [arrival.target for arrival in result.arrivals]
    achieved = [arrival.achieved for arrival in result.arrivals]
    doubt = [2 * arrival.sd for arrival in result.arrivals]
    figure, (above, below) = new_figure(1, 2)
    above.plot(number, targets, "_", color="black", markersize=14, label="target")
    above.plot(number, achieved, "o", color="C0", markersize=4, label="achieved")
    above.set(xlabel="target number", ylabel=output)
    above.legend()
    below.axhline(0, color="black", linewidth=0.8)
    below.errorbar(number, result.errors, yerr=doubt, fmt="o", color="C0", markersize=4, capsize=2)
    below.set(xlabel="target number", ylabel=f"error of {output}")
    return figure

"""The report of the study of a fast stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.report import Picture, Report, Table
from minorloop.twins.stage import RATE, TRAVEL
from papers.claims import claim_table, specimens
from papers.drawing import every_specimen, new_figure
from papers.stage import CLAIMS, FREQUENCIES, TITLE

if TYPE_CHECKING:
    from papers.stage import StageStudy

_INVERSES = {
    "without_time": ("inverse of the hysteresis alone", "C3", "s"),
    "dynamics": ("inverse with resonance and creep", "C0", "o"),
}
"""Name, colour and mark of both inverses."""
_SHOWN, _PERIODS = 100, 3
"""Frequency in Hz of the sine that is drawn against time, and its last periods."""


def study_report(
    study: StageStudy, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> Report:
    """Return the page; see the other studies for the parameters."""
    with_it, without = (figures[name]["hz_100"] for name in ("dynamics", "without_time"))
    report = Report(
        TITLE,
        f"At 100 Hz the inverse with resonance and creep is off by {with_it:.2%} of the range rms, "
        f"and that of the hysteresis alone by {without:.2%}; {specimens(runs)}.",
    )
    report.add(
        "What was found",
        text=(
            "The stage has many plays with pinning that no Preisach operator describes, creep of "
            "three time constants, a resonance near 300 Hz, and a sensor with a noise of 10 nm. "
            "Operator, resonance and creep are identified from 5.3 s of sines of falling "
            "amplitude; the operator of the other inverse from the sine of 1 Hz among them. No "
            "reading is used while the stage follows its targets, sines between 4 and 32 um of 40.",
        ),
        table=claim_table(CLAIMS, figures),
        pictures=[Picture(draw_errors(figures), "Error in open loop against frequency.")],
    )
    report.add(
        f"The sine of {_SHOWN} Hz",
        pictures=[Picture(draw_sine(study), "Targets, and what both inverses miss.")],
    )
    report.add("What was identified", table=Table(("", ""), study.found.rows))
    pictures = every_specimen(CLAIMS, runs, study.seed)
    if pictures:
        report.add("Every specimen", pictures=pictures)
    return report


def draw_errors(figures: Mapping[str, Any]) -> Any:
    """Draw the rms errors of both inverses over the range against frequency."""
    figure, axes = new_figure(1, 1, height=3.8)
    for name, (words, colour, mark) in _INVERSES.items():
        errors = [100 * figures[name][f"hz_{frequency}"] for frequency in FREQUENCIES]
        axes.loglog(FREQUENCIES, errors, f"{mark}-", color=colour, label=words)
    axes.set(xlabel="frequency of the target [Hz]", ylabel="rms error [% of range]")
    axes.grid(alpha=0.25, which="both")
    axes.legend(frameon=False)
    return figure


def draw_sine(study: StageStudy) -> Any:
    """Draw the last periods of one sine, and the errors of both inverses."""
    figure, (above, below) = new_figure(2, 1, height=5.0, sharex=True)
    one = study.tracked[_SHOWN]
    last = slice(-round(_PERIODS * RATE / _SHOWN), None)
    t = 1e3 * np.arange(one.targets[last].size) / RATE
    above.plot(t, one.targets[last], color="0.3", lw=2.5, alpha=0.5, label="target")
    for name, (words, colour, _) in _INVERSES.items():
        error = getattr(one, name)[last]
        above.plot(t, one.targets[last] + error, color=colour, lw=1, label=words)
        below.plot(t, 100 * error / TRAVEL, color=colour, lw=1)
    above.set(ylabel="position [um]")
    below.set(xlabel="time [ms]", ylabel="error [% of range]")
    above.legend(frameon=False, fontsize=9)
    return figure

"""Draw the figures of the README: ``make figures``."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from minorloop.drawing.operators import draw_density
from minorloop.positioning import Positioning, run_positioning
from papers import benchmark, design, stage
from papers.catheter import head
from papers.catheter.head_report import draw_steps
from papers.catheter.head_static import identify_head
from papers.design import draw_curves
from papers.harness import for_each, medians

FOLDER = Path(__file__).parent.parent / "docs" / "figures"


def draw(result: Positioning) -> Figure:
    figure = Figure(figsize=(11.5, 3.6), layout="constrained")
    loop, plane, errors = figure.subplots(1, 3, width_ratios=(1.05, 1.0, 1.25))
    model = result.identification.model
    places = np.linspace(0, result.voltages.size - 1, 12 * result.voltages.size)
    fine = np.interp(places, np.arange(result.voltages.size), result.voltages)
    loop.plot(fine, model.simulate(fine), color="C0", lw=0.9, label="model")
    loop.plot(result.voltages, result.settled, "o", ms=3, color="C1", label="measured")
    loop.set(xlabel="voltage [V]", ylabel="curvature [1/m]", title="Loops, measured and modelled")
    loop.grid(alpha=0.25)
    loop.legend(frameon=False)
    draw_density(plane, model, input_label="voltage [V]", output_label="curvature [1/m]")
    place = np.arange(result.targets.size) + 1
    for shift, name, drive, colour in (
        (-0.2, "Preisach inverse", result.preisach, "C0"),
        (0.2, "quadratic inverse", result.quadratic, "C3"),
    ):
        label = f"{name}, {drive.rms:.2f} 1/m rms"
        errors.bar(place + shift, drive.errors, width=0.38, color=colour, label=label)
    errors.axhline(0.0, color="0.3", lw=0.8)
    errors.set(xlabel="target", ylabel="error [1/m]", title="Open-loop positioning error")
    errors.set_xticks(place)
    errors.grid(alpha=0.25)
    errors.legend(frameon=False, fontsize="small")
    return figure


def figures_of(seed: int) -> dict[str, object]:
    return design.run_study(seed).figures()


def figures_of_stage(seed: int) -> dict[str, object]:
    return stage.run_study(seed).figures()


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    draw(run_positioning(0)).savefig(FOLDER / "positioning.png", dpi=100)
    runs = list(for_each(figures_of, 10, 0))
    steps = head.run_steps(0, head.every_control(*identify_head(0)))
    draw_steps(steps).savefig(FOLDER / "head.png", dpi=100)
    runs_of_stage = list(for_each(figures_of_stage, 20, 0))
    stage.draw_errors(medians(runs_of_stage)).savefig(FOLDER / "stage.png", dpi=100)
    benchmark.draw_law(benchmark.run_study(0)).savefig(FOLDER / "benchmark.png", dpi=100)
    draw_curves(runs).savefig(FOLDER / "design.png", dpi=100)

"""Figures of operators and inversions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.drawing.layout import new_figure
from minorloop.lab.headers import split_header
from minorloop.operators.plane import cell_areas

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from minorloop.operators.inversion import Inversion
    from minorloop.operators.operator import Operator
    from minorloop.operators.preisach import Preisach

_NESTED_LOOPS = 4
"""Loops, the major one included: more would overlap."""


def draw_preisach(
    model: Preisach, *, input_label: str = "input", output_label: str = "output"
) -> Any:
    """Draw the density on the plane beside nested minor loops."""
    figure, (left, right) = new_figure(1, 2, 4.2, 9.6, grid=False)
    draw_density(left, model, input_label=input_label, output_label=output_label)
    draw_loops(right, model)
    right.set(xlabel=input_label, ylabel=output_label, title="Major and minor loops")
    return figure


def draw_density(
    axes: Axes, model: Preisach, *, input_label: str = "input", output_label: str = "output"
) -> Any:
    """Draw the density on the Preisach plane with its colour bar, and return the mesh.

    Colours follow the square root of the density unless weights are negative, so that small
    densities far from the diagonal are visible too.
    """
    from matplotlib.colors import Normalize, PowerNorm

    density = model.weights / np.where(cell_areas(model.levels) > 0, cell_areas(model.levels), 1.0)
    below = np.tril(np.ones(density.shape, dtype=bool))
    top = float(np.abs(density[below]).max()) or 1.0
    signed = bool((model.weights < 0).any())
    mesh = axes.pcolormesh(
        model.levels,
        model.levels,
        np.ma.masked_where(~below, density),
        cmap="RdBu_r" if signed else "viridis",
        norm=Normalize(-top, top) if signed else PowerNorm(0.5, 0.0, top),
        rasterized=True,
    )
    clip_to_plane(axes, mesh, model)
    bar = axes.figure.colorbar(mesh, ax=axes)
    of_input, of_output = (split_header(label)[1] for label in (input_label, output_label))
    of_input = of_input if of_input.isalpha() else f"({of_input})"
    unit = f" [{of_output} / {of_input}²]" if of_output and of_input != "()" else ""
    bar.set_label(f"density{unit}")
    axes.plot(model.levels[[0, -1]], model.levels[[0, -1]], color="0.3", linewidth=0.8)
    axes.set(
        xlabel=f"threshold down β, {input_label}",
        ylabel=f"threshold up α, {input_label}",
        title="Preisach plane",
        aspect="equal",
    )
    return mesh


def clip_to_plane(axes: Axes, mesh: Any, model: Preisach) -> None:
    """Clip a mesh to alpha >= beta: cells on the diagonal are triangles."""
    from matplotlib.patches import Polygon

    low, high = model.levels[[0, -1]]
    corners = [(low, low), (low, high), (high, high)]
    mesh.set_clip_path(Polygon(corners, transform=axes.transData))


def draw_operator(model: Any) -> Any:
    """Draw nested loops of an operator over the inputs that its parameters describe."""
    figure, axes = new_figure(width=4.8)
    draw_loops(axes, model)
    axes.set(xlabel="input", ylabel="output", title="Major and minor loops")
    return figure


def input_range(model: Any) -> tuple[float, float]:
    """Return the range of inputs of a model; for plays, which have none, one that moves all."""
    if hasattr(model, "levels"):
        return float(model.levels[0]), float(model.levels[-1])
    if hasattr(model, "low"):
        return float(model.low), float(model.high)
    radii = getattr(model, "plays", model).radii
    # Amplitude over the largest slack: all plays move; about that of the record, by default
    reach = 1.1 * float(radii[-1]) or 1.0
    return -reach, reach


def draw_loops(axes: Axes, model: Operator) -> None:
    """Draw the major loop, and closed minor loops nested in it."""
    low, high = input_range(model)
    middle, half = (low + high) / 2, (high - low) / 2
    for turn in range(_NESTED_LOOPS):
        amplitude = half * (1 - turn / _NESTED_LOOPS)
        rise = np.linspace(middle - amplitude, middle + amplitude, 200)
        u = np.concatenate([rise[-1:], rise[::-1], rise, rise[::-1]])
        y = model.simulate(u)
        loop = slice(1, None) if turn else slice(0, None)
        axes.plot(u[loop], y[loop], color="C0", linewidth=1.6 if turn == 0 else 0.9)
    axes.grid(alpha=0.25)


def draw_inversion(
    inversion: Inversion, *, input_label: str = "input", output_label: str = "output"
) -> Any:
    """Draw targets with outputs above, and inputs below."""
    figure, (upper, lower) = new_figure(2, 1, 5.0, 8.0, sharex=True)
    index = np.arange(inversion.u.size)
    upper.plot(index, inversion.targets, "o", color="C1", mfc="none", label="target")
    upper.step(index, inversion.y, where="mid", color="C0", label="output of the model")
    missed = ~inversion.reachable
    upper.plot(index[missed], inversion.targets[missed], "x", color="C3", label="out of reach")
    upper.set_ylabel(output_label)
    upper.legend(frameon=False)
    lower.step(index, inversion.u, where="mid", color="0.25")
    lower.set(xlabel="target number", ylabel=input_label)
    return figure

"""Figures of identifications."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, IntArray
from minorloop.drawing.layout import new_figure
from minorloop.drawing.operators import clip_to_plane, draw_density
from minorloop.errors import counted
from minorloop.identification.bands import PER_DEVIATION
from minorloop.identification.residuals import amplitudes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from minorloop.identification.bands import Prediction
    from minorloop.identification.excitation import ExcitationReport
    from minorloop.identification.plane_result import Identification
    from minorloop.identification.result import Fit
    from minorloop.scoring import ModelScore


_MOST_DRAWN = 20_000
"""Samples of the loop in a notebook, and of the residual: more take seconds to draw."""
_FEW = 400
"""Number of samples up to which points are large, and the model is drawn between them too."""
_PARTS, _FEWEST_OF_PART, _FEWEST = 12, 5, 30
"""Parts of equal width for which the residual is averaged, and least samples of one and of all."""
_SAID, _EQUAL = 0.9, 0.02
"""Amplitudes or rates count as equal if this share of them lies in this part of their median."""
_DOTS: dict[str, Any] = {"ms": 3.5, "color": "C1"}
_VEIL = 0.7
"""Opacity of the grey over cells that a prior determines."""
_CELLS = 400
"""Cells of an axis; only one dot is drawn in each cell."""


def draw_identification(
    result: Identification,
    *,
    input_label: str = "input",
    output_label: str = "output",
    part: Literal["all", "curves", "talk"] = "all",
) -> Any:
    """Draw loop, plane and record, and the residual in time, by amplitude and by rate.

    ``result``: the identification; ``input_label`` and ``output_label``: name and unit of input and
    output; ``part`` {"all", "curves", "talk"}: all of this, the errors of each curve, or loop and
    plane with large letters for a screen.
    """
    labels = {"input_label": input_label, "output_label": output_label}
    if part == "curves":
        return _draw_curves(result)
    if part == "talk":
        return _draw_talk(result, **labels)
    time = result.t
    figure, axes = new_figure(3, 2, 11.5, 10.5, grid=False)
    figure.get_layout_engine().set(h_pad=0.1, w_pad=0.1)
    clock = np.arange(result.y.size, dtype=np.float64) if time is None else time
    _draw_loop(axes[0, 0], result, input_label, output_label)
    draw_density(axes[0, 1], result.model, **labels)
    _grey_unexcited(axes[0, 1], result)
    _draw_record(axes[1, 0], result, output_label, clock)
    _draw_residual(axes[1, 1], result, clock)
    _draw_residual_parts(axes[2], result, input_label, time)
    for axis in axes[1]:
        axis.set_xlabel("sample" if time is None else "time [s]")
    return figure


def draw_loop_and_plane(
    result: Identification, *, input_label: str = "input", output_label: str = "output"
) -> Any:
    """Draw the loop of the last samples and the plane only: small and quick, for notebooks."""
    figure, (left, right) = new_figure(1, 2, 4.2, 9.6, grid=False)
    _draw_loop(left, result, input_label, output_label, _MOST_DRAWN)
    if result.u.size > _MOST_DRAWN:
        left.set_title(f"Loop, last {_MOST_DRAWN} samples")
    draw_density(right, result.model, input_label=input_label, output_label=output_label)
    _grey_unexcited(right, result)
    return figure


def _draw_talk(result: Identification, **labels: str) -> Any:
    """Draw loop and plane large enough for a screen, with the error in the title."""
    from matplotlib import rc_context

    with rc_context({"font.size": 17, "lines.linewidth": 2}):
        figure = draw_loop_and_plane(result, **labels)
        figure.set_size_inches(13.3, 6.2)
        held = result.holdout_nrmse
        title = f"error {result.nrmse:.2%} of range on fitted rows"
        if held is not None:
            title = f"error {held:.2%} of range on rows that were not fitted"
        figure.suptitle(title, size=22)
    return figure


def _draw_loop(
    axes: Axes, result: Identification, input_label: str, output_label: str, most: int = 0
) -> None:
    """Draw the loop, or only that of the last ``most`` samples if that is not 0."""
    u, y = (part[-most:] for part in loop_points(result, result.y))
    if result.u.size <= _FEW and not result.lag and result.curves.begins.size == 1:
        axes.plot(u, y, "o", ms=4, color="C1", label="measured", zorder=3)
        inputs = _interpolated(result.u)
        shown: dict[str, Any] = {"lw": 0.8, "color": "C0", "rasterized": True}
        axes.plot(inputs, result.predict(inputs), label="model", **shown)
    else:
        _plot_dots(axes, u, y, label="measured", **_DOTS)
        u, modelled = (part[-most:] for part in loop_points(result, result.prediction))
        _plot_dots(axes, u, modelled, ls="-", label="model", ms=0.6, lw=0.5, color="C0")
    at = "" if not result.lag else f" {counted(result.lag, 'sample')} before"
    axes.set(xlabel=input_label + at, ylabel=output_label, title="Loop")
    axes.legend(frameon=False, loc="upper left")
    axes.grid(alpha=0.25)


def draw_score(
    result: ModelScore,
    *,
    input_label: str = "input",
    output_label: str = "output",
    part: Literal["all", "curves"] = "all",
) -> Any:
    """Draw loop and record, measured and predicted, and the residual by the input and in time.

    Parameters are as of `draw_identification`.
    """
    if part == "curves":
        return _draw_curves(result)
    figure, axes = new_figure(2, 2, 8.0, 10.5)
    figure.get_layout_engine().set(h_pad=0.1, w_pad=0.1)
    t, begins = result.simulation.t, result.curves.begins[1:]
    clock = np.arange(result.y.size, dtype=np.float64) if t is None else t
    line: dict[str, Any] = {"lw": 0.8, "color": "C0", "rasterized": True}
    dots: dict[str, Any] = {"ms": 7 if result.y.size <= _FEW else 3.5, "color": "C1"}
    record = np.insert(clock, begins, np.nan), np.insert(result.prediction, begins, np.nan)
    for one, measured, predicted, title in (
        (axes[0, 0], loop_points(result, result.y), loop_points(result, result.prediction), "Loop"),
        (axes[0, 1], (clock, result.y), record, "Record"),
    ):
        _plot_dots(one, *measured, label="measured", **dots)
        one.plot(*predicted, label="predicted", **line)
        one.set(ylabel=output_label, title=title)
        _show_legend_below(one)
    share = 100 * result.error / result.span
    for one, x, title in ((axes[1, 0], result.u, "by input"), (axes[1, 1], clock, "in time")):
        _plot_dots(one, x, share, ms=_size(x), color="C0")
        one.axhline(0.0, color="0.3", lw=0.8)
        one.set(ylabel="residual, % of range", title=f"Residual {title}: predicted less measured")
    _shade_startup(axes[1, 1], result, share, clock)
    if result.bands is not None:
        reach = 100 * result.bands.half_width / result.span
        band: dict[str, Any] = {"color": "C0", "alpha": 0.15, "lw": 0, "label": "90 % band"}
        axes[1, 1].fill_between(clock[result.band_rows], -reach, reach, **band)
    if axes[1, 1].get_legend_handles_labels()[0]:
        _show_legend_below(axes[1, 1])
    for side, label in enumerate((input_label, "sample" if t is None else "time [s]")):
        for one in axes[:, side]:
            one.set_xlabel(label)
    return figure


def loop_points(
    result: Fit[Any] | ModelScore, outputs: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return inputs and outputs with NaN where nothing was measured, between curves and at jumps.

    A line through them joins only samples that were measured one after the other.

    ``result``: the fit or score of the outputs; ``outputs`` (T,): measured, or of the model.
    """
    y = np.where(result.scored, outputs, np.nan)[result.lag :]
    u = result.u[: y.size]
    begins = result.curves.begins - result.lag
    begins = np.union1d(begins[(begins > 0) & (begins < y.size)], _jumps(u))
    return np.insert(u, begins, np.nan), np.insert(y, begins, np.nan)


def _jumps(u: FloatArray) -> IntArray:
    """Return the samples before which the input jumps, as between curves with few labels."""
    steps = np.abs(np.diff(u))
    usual = float(np.median(steps[steps > 0])) if steps.any() else 0.0
    # An input jumps if it changes by more than this many usual steps and this share of its range
    return np.flatnonzero(steps > max(20 * usual, 0.05 * float(np.ptp(u)))) + 1


def _interpolated(u: FloatArray, points: int = 12) -> FloatArray:
    """Return inputs with others between them, linearly interpolated."""
    places = np.linspace(0, u.size - 1, (u.size - 1) * points + 1)
    return np.interp(places, np.arange(u.size), u)


def _grey_unexcited(axes: Axes, result: Identification) -> None:
    from matplotlib.colors import ListedColormap

    levels = result.model.levels
    unexcited = np.tril(~result.excited)
    if not unexcited.any():
        return
    shade = np.ma.masked_where(~unexcited, np.ones(unexcited.shape))
    grey = ListedColormap(["0.85"])
    # The assumptions of a prior there stay visible.
    alpha = 1.0 if result.posterior is None else _VEIL
    mesh = axes.pcolormesh(levels, levels, shade, cmap=grey, alpha=alpha, rasterized=True)
    clip_to_plane(axes, mesh, result.model)
    axes.set_title("Preisach plane (grey: not excited)")


def _draw_record(axes: Axes, result: Identification, output_label: str, clock: FloatArray) -> None:
    index = np.arange(result.y.size)
    dots: dict[str, Any] = {"ms": 7, "color": "C1"} if index.size <= _FEW else _DOTS
    _plot_dots(axes, clock, result.y, label="measured", **dots)
    begins = result.curves.begins[1:]
    modelled = np.insert(clock, begins, np.nan), np.insert(result.prediction, begins, np.nan)
    axes.plot(*modelled, lw=0.8, color="C0", label="model", rasterized=True)
    plain = not result.lag and result.curves.begins.size == 1
    if result.posterior is not None and 1 < index.size <= _FEW and plain:
        # Between samples too, where bands are wide.
        between = result.predict(_interpolated(result.u), bands=0.9)
        places = np.interp(np.linspace(0, index[-1], between.u.size), index, clock)
        axes.fill_between(places, between.lower, between.upper, color="C0", alpha=0.2, lw=0)
    _scale_to_fitted(axes, result.y, result)
    _shade_held_out(axes, result, clock)
    axes.set(ylabel=output_label, title="Record")
    axes.grid(alpha=0.25)
    _show_legend_below(axes)


def _residual(result: Identification) -> tuple[FloatArray, float]:
    """Return model less measured in % of the range of the fitted output, and that range."""
    unit = float(np.ptp(result.y[result.fitted])) or 1.0
    return 100 * (result.prediction - result.y) / unit, unit


def _draw_residual(axes: Axes, result: Identification, clock: FloatArray) -> None:
    residual, unit = _residual(result)
    _plot_dots(axes, clock, residual, ms=_size(clock), color="C0")
    # Number of samples whose bands are drawn: more cost time without showing more
    shown = np.unique(np.linspace(0, clock.size - 1, 1000).astype(np.int64))
    reach = 100 * PER_DEVIATION * result.deviation(shown) / unit
    axes.fill_between(clock[shown], -reach, reach, color="C0", alpha=0.15, lw=0, label="90 % band")
    axes.axhline(0.0, color="0.3", lw=0.8)
    # Wider bands are cut, so that the residual stays visible.
    largest = 1.5 * float(np.nanmax(np.abs(residual[result.scored]))) or 1.0
    axes.set_ylim(-largest, largest)
    _scale_to_fitted(axes, residual, result)
    _shade_held_out(axes, result, clock)
    _shade_startup(axes, result, residual, clock)
    axes.set(ylabel="residual, % of fitted range", title="Residual in time: model less measured")
    axes.grid(alpha=0.25)
    _show_legend_below(axes)


def _draw_residual_parts(
    axes: npt.NDArray[Any], result: Identification, input_label: str, time: FloatArray | None
) -> None:
    """Draw the residual by the size of the loop, and by the change of the input."""
    each = "change from sample to sample" if time is None else "change per second"
    residual, _ = _residual(result)
    u = result.curves.delayed(result.u, result.lag)
    known = np.flatnonzero(result.scored & np.isfinite(residual))
    startup = result.residual.startup
    known = known[known >= (startup.rows if startup else 0)]
    for one, feature, label, title in (
        (axes[0], amplitudes(u), "height of the branch", "amplitude"),
        (axes[1], _rates(u, time), each, "rate"),
    ):
        x, size = feature[known], np.abs(residual[known])
        _plot_dots(one, x, size, ms=_size(x), color="0.7", label="samples")
        if known.size >= _FEWEST:
            _draw_rms(one, x, size)
            _say_if_equal(one, x, title)
        one.set(
            xlabel=f"{label}, {input_label}",
            ylabel="|residual|, % of fitted range",
            title=f"Residual by {title} of the input",
        )
        one.set_ylim(bottom=0)
        one.grid(alpha=0.25)
        one.legend(framealpha=0.9, loc="upper right")


def _draw_rms(axes: Axes, x: FloatArray, size: FloatArray) -> None:
    """Draw the rms over intervals of equal width, at their mean x, up to its 99th percentile."""
    # The few samples beyond it, as between curves, are not shown.
    low, high = np.quantile(x, [0.0, 0.99])
    edges = np.linspace(low, high, _PARTS + 1)
    shown = x <= high
    place = np.searchsorted(edges[1:-1], x[shown])
    count = np.bincount(place, minlength=_PARTS)
    mean = np.bincount(place, size[shown] ** 2, _PARTS) / np.maximum(count, 1)
    enough = count >= _FEWEST_OF_PART
    middles = np.bincount(place, x[shown], _PARTS) / np.maximum(count, 1)
    axes.plot(middles[enough], np.sqrt(mean[enough]), "o-", ms=4, color="C0", label="rms")
    margin = 0.03 * (high - low) or 1.0
    axes.set_xlim(low - margin, high + margin)


def _say_if_equal(axes: Axes, x: FloatArray, title: str) -> None:
    """Say that nearly all samples have one amplitude or rate, and show the axis from 0."""
    low, middle, high = np.quantile(x, [0.05, 0.5, 0.95])
    if middle > 0 and high - low <= _EQUAL * middle:
        axes.set_xlim(0, 2 * middle)
        said = f"{_SAID:.0%} of the samples have the same {title}"
        axes.text(0.03, 0.95, said, transform=axes.transAxes, va="top", fontsize="small")


def _rates(u: FloatArray, time: FloatArray | None) -> FloatArray:
    """Return the changes of the input (T,), per second where times are known."""
    changes = np.abs(np.diff(u, prepend=u[0]))
    if time is None:
        return changes
    steps = np.diff(time, prepend=time[0])
    return np.divide(changes, steps, out=np.zeros_like(changes), where=steps > 0)


def _plot_dots(axes: Axes, x: FloatArray, y: FloatArray, ls: str = "", **style: Any) -> None:
    """Plot points; of many, only those that can be distinguished."""
    shown = _distinct(x, y) if x.size > _MOST_DRAWN else None
    axes.plot(x, y, ls=ls, marker=".", markevery=shown, rasterized=True, **style)


def _distinct(x: FloatArray, y: FloatArray) -> list[int]:
    """Return one sample of each cell of a grid over the points, and all samples far from them."""
    samples = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    inside, cell = np.ones(samples.size, dtype=np.bool_), np.zeros(samples.size, dtype=np.int64)
    for values in (x[samples], y[samples]):
        low, high = np.quantile(values, [0.01, 0.99])
        place = (values - low) / ((high - low) or 1.0) + 0.5
        inside &= (place >= 0) & (place < 2)
        cell = 2 * _CELLS * cell + (_CELLS * np.clip(place, 0, 2 - 1 / _CELLS)).astype(np.int64)
    last = np.zeros((2 * _CELLS) ** 2, dtype=np.int64)
    last[cell[inside]] = samples[inside]
    kept: list[int] = samples[~inside | (last[cell] == samples)].tolist()
    return kept


def _size(values: FloatArray) -> float:
    """Return the size of dots, by the number of samples."""
    return 7.0 if values.size <= _FEW else 2.0


def _shade_startup(
    axes: Axes, result: Identification | ModelScore, residual: FloatArray, clock: FloatArray
) -> None:
    """Shade a start-up, and scale the axis to the later rows."""
    startup = result.residual.startup
    if startup is not None:
        later = np.abs(residual[startup.rows :])
        reach = 1.2 * float(np.nanmax(later))
        axes.set_ylim(-reach, reach)
        axes.axvspan(
            clock[0], clock[startup.rows], color="C3", alpha=0.2, label="start-up, not to scale"
        )


def _scale_to_fitted(axes: Axes, values: FloatArray, result: Identification) -> None:
    """Scale an axis to rows that were fitted or held out, and say how many others lie outside."""
    kept = values[result.fitted | result.held_out]
    low, high = float(np.nanmin(kept)), float(np.nanmax(kept))
    outside = int(np.count_nonzero((values < low) | (values > high)))
    if outside:
        margin = 0.1 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)
        said = f"{counted(outside, 'row')} outside, not fitted"
        axes.text(0.03, 0.03, said, transform=axes.transAxes, fontsize="small")


def _shade_held_out(axes: Axes, result: Identification, clock: FloatArray) -> None:
    held = np.flatnonzero(result.held_out)
    if held.size:
        axes.axvspan(clock[held[0]], clock[held[-1]], color="C1", alpha=0.12, label="held out")


def _show_legend_below(axes: Axes) -> None:
    """Show the legend in a row below the data, which it would hide elsewhere."""
    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.15 * (high - low), high)
    axes.legend(framealpha=0.9, loc="lower center", ncols=3)


def _draw_curves(result: Identification | ModelScore) -> Any:
    """Draw the root-mean-square and the largest error of each curve."""
    curves = result.curve_accuracy
    figure, axes = new_figure()
    number = np.arange(len(curves))
    axes.plot(number, [100 * one.accuracy.nrmse for one in curves], ".-", label="rms")
    largest = [100 * abs(one.accuracy.worst) for one in curves]
    axes.plot(number, largest, ".", color="0.6", label="largest")
    if any(one.left_out is not None for one in curves):
        off = [np.nan if one.left_out is None else 100 * one.left_out for one in curves]
        axes.plot(number, off, ".-", color="C1", label="rms of a fit without its group")
    axes.set(xlabel="curve", ylabel="error, % of range")
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False)
    return figure


def draw_excitation(report: ExcitationReport) -> Any:
    """Draw the excited cells by their band numbers."""
    from matplotlib.colors import ListedColormap

    figure, axes = new_figure(height=4.6, width=4.8, grid=False)
    bands = len(report.excited)
    below = np.tril(np.ones((bands, bands), dtype=bool))
    shown = np.ma.masked_where(~below, report.excited.astype(float))
    edges = np.arange(bands + 1)
    colours = ListedColormap(["0.85", "C0"])
    axes.pcolormesh(edges, edges, shown, cmap=colours, vmin=0, vmax=1, edgecolor="w", lw=0.4)
    axes.set(
        xlabel="band of the threshold down β",
        ylabel="band of the threshold up α",
        title=f"{report.excited_fraction:.0%} of the cells excited",
        aspect="equal",
    )
    return figure


def draw_prediction(
    result: Prediction, *, input_label: str = "input", output_label: str = "output"
) -> Any:
    """Draw outputs with bands, sample by sample and against the input."""
    figure, (left, right) = new_figure(1, 2, 3.8, sharey=True)
    sample = np.arange(result.y.size)
    label = f"{result.probability:.0%} band"
    left.fill_between(sample, result.lower, result.upper, color="C0", alpha=0.25, lw=0, label=label)
    left.plot(sample, result.y, color="C0", lw=1.0, label="predicted")
    spread = np.vstack([result.half_width, result.half_width])
    right.errorbar(result.u, result.y, spread, fmt="o", ms=3, lw=0.8, color="C0", alpha=0.7)
    left.set(xlabel="sample", ylabel=output_label)
    right.set(xlabel=input_label)
    left.legend(frameon=False)
    return figure

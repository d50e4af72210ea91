"""The ionic polymer paper, reproduced on the twin.

Chen, Tan and Shahinpoor (Quasi-static positioning of ionic polymer-metal composite actuators,
2005) measure a strip quasi-statically, identify a Preisach operator, position the strip with its
inverse, and add linear dynamics. They leave open how to follow the slow drift that they observed.
This study does all of it on one specimen, with two more models for comparison, and reaches the
targets at the end of short holds.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, Levels, uniform_levels
from minorloop.connect import connect
from minorloop.dynamics.cascade import Cascade
from minorloop.identification import Viscosity, excitation, identify
from minorloop.identification.baseline import nrmse
from minorloop.identification.frequency import FrequencyResponse, decibels
from minorloop.identification.recursive import Recursive
from minorloop.identification.representability import representability
from minorloop.identification.sine_response import Preamble, frequency_response
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import FURTHER, hold_each
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel
from minorloop.positioning import ExperimentProtocol, Positioning, drive, run_positioning
from minorloop.report import Table
from minorloop.twins.ipmc import Ipmc
from minorloop.twins.ipmc_laser import NOISE
from papers.drawing import ABOVE, HOUR, draw, panel
from papers.facts import identify_settled, twin_facts
from papers.harness import Results, Study, rms

VOLTAGE, BANDS, SETTLED = 1.2, 10, 200.0
"""Largest voltage in V, bands of the models, and seconds of a settled hold."""
FREQUENCIES = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0)
HALF_HERTZ, HERTZ = 0.5, 1.0
SWEEP_PERIOD = 40.0
"""Period of the trajectory in seconds."""
SHORT, TARGETS = 10.0, 14
"""Seconds of a hold that is too short to settle, and number of targets at the ends of these."""


def run_study(seed: int) -> Results:
    """Carry out the whole study on the specimen of a seed.

    ``uniform`` is the paper's experiment with its model, ``ours`` the same with a reversible part
    on the diagonal; ``responses`` are those behind both models. All further results use ours.
    """
    laser = ExperimentProtocol(laser=True)
    uniform = run_positioning(seed, NOISE, replace(laser, diagonal="uniform"))
    ours = run_positioning(seed, NOISE, laser)
    fine = run_positioning(seed, NOISE, replace(laser, bands=20))
    plays = GeneralisedPrandtlIshlinskii.fit(uniform.voltages, uniform.settled)
    inputs = plays.invert(uniform.targets, unreachable="clip").u
    driven = drive(seed, NOISE, laser, inputs, uniform.targets, 3)
    drives = {
        "uniform": uniform.preisach,
        "ours": ours.preisach,
        "plays": driven,
        "quadratic": uniform.quadratic,
    }
    models = {"uniform": uniform.identification.model, "ours": ours.identification.model}
    voltages = np.append(-laser.voltage, uniform.preisach.voltages)
    apart = models["ours"].simulate(voltages) - models["uniform"].simulate(voltages)
    responses = _responses(seed, models)
    dynamics = responses["ours"].fit()
    sweep = _sweep(seed, Cascade(models["ours"], dynamics.model))
    tracking = run_tracking(seed)
    repetition = _repetition(seed, laser)
    short_holds = run_short_holds(seed)
    facts = strip_facts()
    found = repetition.found
    figures = {
        "twin": facts,
        "positioning": {
            **_ratios(uniform),
            **{f"rms_{name}": one.rms for name, one in drives.items()},
            **{f"max_{name}": one.worst for name, one in drives.items()},
            "between_levels": rms(apart[1:]),
            "first_target": abs(ours.preisach.errors[0]),
            "later_targets": rms(ours.preisach.errors[1:]),
        },
        "positioning_ours": _ratios(ours),
        "positioning_fine": _ratios(fine),
        **{f"response_{name}": _spreads(one) for name, one in responses.items()},
        "dynamics": {
            "order": dynamics.model.order,
            "relative_error": dynamics.error,
            **sweep.figures(),
        },
        "recursive": tracking.figures(),
        "representability": {
            "congruency": found.congruency,
            "wiping_out": found.wiping_out,
            "floor": found.floor,
            **{f"{name}_nrmse": value for name, value in repetition.nrmse.items()},
        },
        "short_holds": short_holds.figures(),
    }
    return Results(
        figures, seed=seed, facts=facts, major=_major_loop(seed, laser), uniform=uniform, ours=ours,
        drives=drives, responses=responses, dynamics=dynamics, sweep=sweep, tracking=tracking,
        repetition=repetition, short_holds=short_holds,
    )  # fmt: skip


def strip_facts() -> dict[str, Any]:
    """Return the measured properties of the nominal strip, as of `twin_facts`."""
    grid = uniform_levels(-VOLTAGE, VOLTAGE, BANDS)
    return twin_facts(Ipmc, grid, SETTLED, loop=(0.1, 0.6), excursion=-0.24)


def _ratios(result: Positioning) -> dict[str, float]:
    ratio = result.quadratic.rms / result.preisach.rms
    return {
        "rms_ratio_min": ratio,
        "rms_ratio_median": ratio,
        "coverage_mean": result.coverage,
    }


def _spreads(response: FrequencyResponse) -> dict[str, float]:
    """Return the differences between the two amplitudes, before and after the operator."""
    low, at_one = response.gain_spread(high=HALF_HERTZ), response.gain_spread(HERTZ, HERTZ)
    before, after = response.phase_spread(high=HALF_HERTZ)
    return {
        "ratio_below_half_hz": low.ratio,
        "before_db": low.before,
        "after_db": low.after,
        "ratio_at_one_hz": at_one.ratio,
        "phase_before_deg": before,
        "phase_after_deg": after,
    }


def _strip(seed: int, experiment: int, noise: float = 0.025) -> Ipmc:
    """Return a specimen with a curvature sensor; every experiment has its own noise.

    ``noise`` is in 1/m; without it, it is that of the laser, converted.
    """
    noise_seed = seed + FURTHER * experiment
    strip = connect("twin:ipmc", specimen=seed, noise=noise, seed=noise_seed)
    assert isinstance(strip, Ipmc)  # the only twin with waveforms here
    return strip


def _major_loop(seed: int, setup: ExperimentProtocol) -> Record:
    """Return the record of Fig 4: up and down, every step held."""
    grid = uniform_levels(-setup.voltage, setup.voltage, setup.bands)
    u = np.concatenate([grid, grid[-2::-1]])
    return hold_each(_strip(seed, 4), u, setup.hold, setup.sample_interval)[0]


def _responses(seed: int, models: dict[str, Preisach]) -> dict[str, FrequencyResponse]:
    """Measure the sines once, and return the gains behind each model."""
    measured: dict[int, Record] = {}

    def driven(experiments: Iterator[int]) -> Callable[[FloatArray, FloatArray], Record]:
        def drive_strip(t: FloatArray, u: FloatArray) -> Record:
            number = next(experiments)
            if number not in measured:
                measured[number] = _strip(seed, number).drive(t, u)
            return measured[number]

        return drive_strip

    return {
        name: frequency_response(
            driven(itertools.count(100)),
            FREQUENCIES,
            (0.7, 1.0),
            preamble=Preamble(-VOLTAGE, SETTLED),
            settling=300.0,  # five times the slowest time constant of the strip
            operator=model,
        )
        for name, model in models.items()
    }


def _sweep(seed: int, cascade: Cascade) -> Results:
    """Follow a sine in curvature with growing amplitude, with both inverses.

    Figures are rms errors in 1/m over the second half, with the inverse of the operator alone and
    with that of the cascade.
    """
    t = np.arange(0.0, 4 * SWEEP_PERIOD, 0.05)
    rest = float(cascade.operator.simulate([-1.2, 0.0])[-1])
    swell = np.minimum(t / SWEEP_PERIOD, 1.0)
    targets = rest + 5.0 * swell * np.sin(2 * np.pi * t / SWEEP_PERIOD)
    start = cascade.operator.step("negative", -1.2)[1]
    inversion = cascade.invert(t, targets, start, before=0.0, unreachable="clip")
    alone = cascade.operator.invert(targets, cascade.operator.step(start, 0.0)[1], "clip").u
    records = []
    for experiment, inputs in enumerate((alone, inversion.u), start=5):
        strip = _strip(seed, experiment)
        strip.apply(-1.2, 400.0, 400.0)
        strip.apply(0.0, 400.0, 400.0)
        records.append(strip.drive(t, np.clip(inputs, -1.2, 1.2)))
    late = slice(t.size // 2, None)
    names, targets = ("rms_operator", "rms_cascade"), inversion.targets
    errors = [rms(record.y[late] - targets[late]) for record in records]
    figures = dict(zip(names, errors, strict=True))
    return Results(figures, inversion=inversion, alone=records[0], cascade=records[1])


def _repetition(seed: int, setup: ExperimentProtocol) -> Results:
    """Measure two staircases and random levels, in which memories and branches repeat.

    The results have the errors of three models on this record.
    """
    grid = uniform_levels(-setup.voltage, setup.voltage, setup.bands)
    stairs = excitation.decaying_staircase(grid)
    random = np.random.default_rng(seed).choice(grid, 60)
    u = np.concatenate([stairs, stairs, random])
    _, y = hold_each(_strip(seed, 7), u, setup.hold, setup.sample_interval)
    fit = identify_settled(u, y, levels=grid)
    plays = GeneralisedPrandtlIshlinskii.fit(u, y)
    quadratic = np.polyval(np.polyfit(u, y, 2), u)
    errors = {
        "preisach": fit.nrmse,
        "plays": nrmse(plays.simulate(u) - y, y),
        "quadratic": nrmse(quadratic - y, y),
    }
    return Results({}, found=representability(u, y), nrmse=errors)


def run_tracking(seed: int) -> Results:
    """Follow a fading strip through three staircases and then random voltages.

    The recursion is compared with a batch fit to the most recent samples, repeated at every sample.
    The exponential window has the same mean age as that batch, so that both use the same history.

    ``measured`` (n,) has its outputs in 1/m over the scored part, ``predicted`` the predictions
    from earlier samples: ``recursive``, ``batch``, and ``fixed`` of a model identified once before.
    """
    grid = uniform_levels(-VOLTAGE, VOLTAGE, BANDS)
    stairs = excitation.decaying_staircase(grid)
    random = np.random.default_rng(seed).uniform(-VOLTAGE, VOLTAGE, stairs.size // 2)
    u = np.concatenate([stairs, stairs, stairs, random])
    strip = Ipmc(seed, 0.05, seed, drift=-0.02)  # the loss of bending an hour
    _, y = hold_each(strip, u, SETTLED)
    strip.safe()
    scored = slice(2 * stairs.size, u.size)
    once = identify_settled(u[: stairs.size], y[: stairs.size], levels=grid)
    predicted = {
        "recursive": _recursive_predictions(grid, u, y, stairs.size)[scored],
        "batch": _batch_predictions(grid, u, y, stairs.size, scored.start),
        "fixed": once.model.simulate(u)[scored],
    }
    errors = {name: rms(each - y[scored]) for name, each in predicted.items()}
    figures = {
        f"twin_over_{other}": errors["recursive"] / errors[other] for other in ("batch", "fixed")
    }
    return Results(figures, measured=y[scored], predicted=predicted)


def _recursive_predictions(grid: Levels, u: FloatArray, y: FloatArray, window: int) -> FloatArray:
    """Return the prediction of each sample before the update with it."""
    age = window / 2  # the forgetting factor that gives samples this mean age
    recursion = Recursive(grid, forgetting=age / (age + 1), diagonal="reversible")
    state, predicted = recursion.begin(), np.empty_like(y)
    for k in range(u.size):
        predicted[k] = recursion.model(state).step(state.memory, u[k])[0]
        state = recursion.update(state, u[k], y[k])
    return predicted


def _batch_predictions(
    grid: Levels, u: FloatArray, y: FloatArray, window: int, first: int
) -> FloatArray:
    """Return the prediction of each sample by a fit to the window before it."""
    predicted = np.empty(u.size - first)
    for k in range(first, u.size):
        recent = y[:k].copy()
        recent[: k - window] = np.nan
        fit = identify_settled(u[:k], recent, levels=grid)
        predicted[k - first] = fit.model.simulate(u[: k + 1])[-1]
    return predicted


def run_short_holds(seed: int) -> Results:
    """Identify one strip, and drive it to targets at the end of short holds with three inverses.

    One staircase with settled holds and one with short ones give a plane with a generic spectrum of
    creep. ``targets`` (n,) are curvatures in 1/m; ``errors`` those of the reading at the end of
    each short hold, by the model of the inverse: ``creep``; ``settled``, of the settled values of
    the long holds; and ``early``, of values at the end of short holds.
    """
    grid, noise = uniform_levels(-VOLTAGE, VOLTAGE, BANDS), 0.03
    voltages = excitation.decaying_staircase(grid)
    strip = _settled_strip(seed, 20, noise)  # the experiments before are above
    long, short = _held(strip, voltages, SETTLED), _held(strip, voltages, SHORT)
    record = Record.joined([*long, *short])
    creeping = identify(
        Record(record.u, record.y, record.t), Viscosity(grid, creep="spectrum", rate=False)
    ).model
    quick = _held(_settled_strip(seed, 21, noise), voltages, SHORT)
    settled, early = (
        identify_settled(voltages, _ends(holds), levels=grid).model for holds in (long, quick)
    )
    targets = np.random.default_rng(seed).uniform(-7.5, 7.5, TARGETS)
    inputs = {
        "creep": creeping.invert(SHORT * np.arange(1, TARGETS + 1), targets, unreachable="clip").u,
        "settled": settled.invert(targets, unreachable="clip").u,
        "early": early.invert(targets, unreachable="clip").u,
    }
    errors = {
        name: _ends(_held(_settled_strip(seed, 22, 0.0), u, SHORT)) - targets
        for name, u in inputs.items()
    }
    ends = {f"rms_{name}": rms(each) for name, each in errors.items()}
    ratio = ends["rms_settled"] / ends["rms_creep"]
    saved = targets.size * (SETTLED - SHORT) / 60
    figures = {**ends, "ratio": ratio, "ratio_min": ratio, "minutes_saved": saved}
    return Results(figures, targets=targets, errors=errors)


def _settled_strip(seed: int, experiment: int, noise: float) -> Ipmc:
    """Return a specimen that has settled at the least voltage."""
    strip = _strip(seed, experiment, noise)
    strip.apply(-VOLTAGE, 2 * SETTLED, 1.0)
    return strip


def _held(strip: Ipmc, inputs: FloatArray, hold: float) -> list[Record]:
    return [strip.apply(float(np.clip(u, -VOLTAGE, VOLTAGE)), hold, 1.0) for u in inputs]


def _ends(holds: list[Record]) -> FloatArray:
    """(n,) last samples of holds."""
    return np.array([hold.y[-1] for hold in holds])


MODELS = {
    "uniform": "Preisach, uniform cells, L = 10 (the paper's)",
    "ours": "Preisach, reversible diagonal, L = 10 (ours)",
    "plays": "plays and dead zones",
    "quadratic": "quadratic (the paper's)",
}
FIG_10 = ("wanted", "inverse of the operator", "voltage", "strip", "curvature")
FIG_15 = ("voltage u", "operator", "w", "linear dynamics G(s)", "curvature y")

_DISCRETE = 4
"""Bands of Fig 6."""


def names(study: Results, *_: Any) -> dict[str, Any]:
    """Return spreads of gains of the drawn specimen."""
    responses = study.responses
    return {
        "spread": {name: one.gain_spread(high=HALF_HERTZ) for name, one in responses.items()},
        "phases_apart": responses["uniform"].phase_spread(high=HALF_HERTZ),
    }


def drives_table(study: Results) -> Table:
    """Return the errors of the inverses at the targets, in 1/m."""
    found = study.drives
    rows = [
        (text, f"{found[name].rms:.3f}", f"{found[name].worst:.3f}")
        for name, text in MODELS.items()
    ]
    return Table(("inverse of", "rms error, 1/m", "largest, 1/m"), rows)


def unavoidable(repetition: Results) -> float:
    """Return the share of the squared error that no Preisach model can avoid."""
    return float(repetition.found.floor / repetition.nrmse["preisach"]) ** 2


def draw_short_holds(found: Results) -> Any:
    """Draw the errors at the end of short holds."""
    looks = {
        "settled": ("settled values", "C3 s 6"),
        "early": ("values after 10 s", "0.6 ^ 6"),
        "creep": ("with creep", "C0 o 6"),
    }
    number = np.arange(1, found.targets.size + 1)
    lines = [(number, found.errors[name], look, words) for name, (words, look) in looks.items()]
    return draw(panel("target", "error at the end of 10 s [1/m]", *lines, legend=ABOVE), height=3.6)


def draw_major(study: Results) -> Any:
    """Draw Fig 4: the inputs in time, and the loop."""
    record = study.major
    settled = np.append(np.flatnonzero(np.diff(record.u)), len(record) - 1)
    loop = (record.u[settled], record.y[settled], "C1 o-")
    return draw(
        panel("time [h]", "voltage [V]", (record.t / HOUR, record.u, "C0 - 0.9"), title="(a)"),
        panel("voltage [V]", "settled curvature [1/m]", loop, title="(b)"),
        columns=2,
    )


def draw_plane() -> Any:
    """Draw Fig 5, a relay, and Fig 6, cells with the relays that are on after some inputs."""
    up = np.linspace(-1.2, 1.2, 241)
    loop = np.concatenate([up, up[::-1]])
    relay = RelayModel(np.array((-0.5, 0.5)), np.array([[0.0, 0.0], [1.0, 0.0]]))
    fine = RelayModel(up, np.zeros((up.size, up.size)))
    edges, on = uniform_levels(-1.2, 1.2, _DISCRETE), fine.states((-1.2, 0.8, -0.4, 0.3))
    middle = (edges[1:] + edges[:-1]) / 2

    def cells(axes: Any) -> None:
        there = np.tri(up.size, dtype=bool)
        shown = np.where(there, 0.25 + 0.5 * on, np.nan)
        axes.pcolormesh(up, up, shown, cmap="Blues", vmin=0, vmax=1.2, rasterized=True)
        for number, (i, j) in enumerate(zip(*np.tril_indices(_DISCRETE), strict=True), start=1):
            place = (middle[j] - 0.1, middle[i] + 0.1) if i == j else (middle[j], middle[i])
            axes.text(*place, f"{number}", ha="center", va="center")
        for edge in edges:
            axes.plot([-1.2, edge, edge], [edge, edge, 1.2], color="0.3", lw=0.7)
        axes.plot(up[[0, -1]], up[[0, -1]], color="0.3", lw=0.7)

    return draw(
        panel(
            "input u [V]", "output of a relay", (loop, relay.simulate(loop), "C0"),
            title="Fig 5: beta = -0.5 V, alpha = 0.5 V", yticks=(-1, 1),
        ),
        panel(
            "threshold down, beta [V]", "threshold up, alpha [V]", cells, aspect="equal",
            title="Fig 6: cells for L = 4; dark: on",
        ),
        columns=2, height=3.8,
    )  # fmt: skip


def draw_blocks(words: Any) -> Any:
    """Draw two blocks with their signals: (signal, block, signal, block, signal)."""

    def blocks(axes: Any) -> None:
        axes.set_axis_off()
        axes.set(xlim=(0, 5), ylim=(0, 1))
        for number, text in enumerate(words):
            frame = {"boxstyle": "square,pad=0.8", "fc": "white"} if number % 2 else None
            axes.text(number + 0.5, 0.5 if number % 2 else 0.62, text, ha="center", bbox=frame,
                      va="center" if number % 2 else "bottom")  # fmt: skip
            if not number % 2:
                look = {"arrowstyle": "->"}
                axes.annotate("", (number + 0.92, 0.5), (number + 0.08, 0.5), arrowprops=look)

    return draw(blocks, height=1.2)


def draw_response(study: Results) -> Any:
    """Draw Fig 16: gains before (a) and after the operator (b), and behind ours with the fit."""
    dynamics, panels = study.dynamics.model, []
    paper, ours = study.responses["uniform"], study.responses["ours"]
    fine = np.geomspace(paper.frequencies[0], paper.frequencies[-1], 200)
    fit = (fine, decibels(dynamics.response(fine)), "0.3 --", f"G(s), order {dynamics.order}")
    for title, unit, gains, more in (
        ("(a) voltage to curvature", "dB re 1/(m V)", paper.plant, ()),
        ("(b) operator to curvature", "dB", paper.after, ()),
        ("ours: (b) and G(s)", "dB", ours.after, (fit,)),
    ):
        lines = [
            (paper.frequencies, decibels(row), f"C{number} o- 0.9", f"{amplitude:g} V")
            for number, (amplitude, row) in enumerate(zip(paper.amplitudes, gains, strict=True))
        ]
        frame: dict[str, Any] = {"title": title, "xscale": "log"}
        panels.append(panel("frequency [Hz]", f"gain [{unit}]", *lines, *more, **frame))
    return draw(*panels, columns=3, height=3.4)


def draw_sweep(study: Results) -> Any:
    """Draw the sine of growing amplitude: target, and result of both inverses."""
    sweep = study.sweep
    t, targets = sweep.inversion.t, sweep.inversion.targets
    alone, both = sweep.alone.y, sweep.cascade.y
    return draw(
        panel(
            "", "curvature [1/m]", (t, targets, "0.2 -- 1.4", "target"),
            (t, alone, "C3", "inverse of the operator alone"),
            (t, both, "C0", "inverse of the cascade"), legend=ABOVE,
        ),
        panel("time [s]", "error [1/m]", (t, alone - targets, "C3"), (t, both - targets, "C0")),
        height=5.0, sharex=True,
    )  # fmt: skip


def draw_tracking(study: Results) -> Any:
    """Draw the errors of one-step predictions on the fading strip."""
    found, lines = study.tracking, []
    for words, name, colour in (
        ("identified once", "fixed", "C3"),
        ("batch on recent holds", "batch", "C2"),
        ("recursive", "recursive", "C0"),
    ):
        error = found.predicted[name] - found.measured
        hold = np.arange(error.size) + 1
        lines.append((hold, error, colour, f"{words}: {rms(error):.2f} 1/m rms"))
    return draw(panel("hold", "predicted minus measured [1/m]", *lines, legend=ABOVE), height=3.6)


STUDY = Study(
    "ipmc", "Quasi-static positioning of an ionic polymer strip", run_study, page=__name__
)

"""The polyaniline fibre paper, reproduced on the twin.

Sohn and colleagues (Modeling hysteresis and step response of a carbon-nanotube-reinforced
electroactive actuator) identify the weights of relays, dots, by first-order reversal curves and the
transition between settled lengths by an ARX model of a single step, and combine the two. They
explain their error on downward steps by the single step. So this study also measures a downward
step.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, uniform_levels
from minorloop.connect import connect
from minorloop.drawing.operators import draw_density
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.trajectory import Trajectory
from minorloop.identification import excitation
from minorloop.identification.arx import arx, step_response
from minorloop.identification.baseline import nrmse
from minorloop.identification.linear_fit import StepResponse
from minorloop.lab.actuator import Actuator
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import FURTHER, hold_each, settled_value
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.relays import RelayModel
from minorloop.report import Table
from minorloop.twins.fibre import Fibre
from papers.drawing import ABOVE, COLOURS, MINUTE, bars, draw, panel
from papers.facts import identify_settled, twin_facts
from papers.harness import Results, Study, rms

LOW, HIGH, BANDS, HOLD = 0.20, 0.65, 9, 300.0
VALIDATION = (0.45, 0.28, 0.34, 0.20, 0.60, 0.36, 0.54)
"""The seven voltages of the paper, in V."""
LEVELS = np.array([0.20, 0.28, 0.34, 0.36, 0.40, 0.45, 0.50, 0.54, 0.60, 0.65])
"""Levels of the dots: those of the seven voltages and of the step, as many as at every 0.05 V. The
paper does not state its levels; only inputs on levels switch a dot."""
NOISE = 1.0
"""Standard deviation of the measured length, in um: that of a good laser extensometer."""


def run_steady(seed: int) -> Results:
    """Identify one specimen, predict the seven voltages, and drive it to targets.

    ``models`` are the identified ones, all from reversal curves: relays, ``square`` by the paper's
    system and ``dots`` by constrained least squares, ``uniform`` cells, ``curves`` with a
    reversible diagonal, and rivals. ``record`` and ``validation`` (7,) are the lengths in um along
    `VALIDATION`; ``predictions`` (7,) are by model, with ``square_even`` and ``dots_even`` of
    relays on every 0.05 V, with inputs moved to the nearest level; ``targets`` (n,) and
    ``achieved`` (n,) are by inverse. Figures are errors as fractions of full scale, which is the
    range of the settled length over the reversal curves, and rms errors of the inverses in um.
    """
    even = uniform_levels(LOW, HIGH, BANDS)
    settled = _settled(seed, 0, excitation.reversal_curves(even))
    on_levels = _settled(seed, 9, excitation.reversal_curves(LEVELS))
    models: dict[str, Any] = {
        "square": RelayModel.fit(*on_levels, LEVELS, signed=True),
        "dots": RelayModel.fit(*on_levels, LEVELS),
        "uniform": identify_settled(*settled, levels=even, diagonal="uniform").model,
        # Part of the doping responds to the smallest reversal at once.
        "curves": identify_settled(*settled, levels=even).model,
        "plays": GeneralisedPrandtlIshlinskii.fit(*settled),
        "polynomial": Polynomial.fit(*settled, degree=3, low=LOW, high=HIGH),
    }
    record, validation = hold_each(fibre_at_rest(seed, 2), VALIDATION, HOLD)
    predictions = {name: model.simulate(VALIDATION) for name, model in models.items()}
    for name in ("square", "dots"):
        relays = RelayModel.fit(*settled, even, signed=name == "square")
        nearest = np.abs(even - np.array(VALIDATION)[:, None]).argmin(axis=1)
        predictions[f"{name}_even"] = relays.simulate(even[nearest])
    low, high = models["curves"].range
    edge = 0.1 * (high - low)  # by trial
    targets = np.random.default_rng(seed).uniform(low + edge, high - edge, 14)
    achieved = {}
    for experiment, name in enumerate(("curves", "plays", "polynomial"), start=3):
        wanted = models[name].invert(targets, unreachable="clip").u
        fibre = fibre_at_rest(seed, experiment)
        _, achieved[name] = hold_each(fibre, np.clip(wanted, LOW, HIGH), HOLD)
    steady, span = {}, float(np.ptp(settled[1]))
    for name, predicted in predictions.items():
        error = (predicted - validation) / span
        steady[f"{name}_nrmse"], steady[f"{name}_max"] = rms(error), float(np.abs(error).max())
    inverse = {f"rms_{name}": rms(y - targets) for name, y in achieved.items()}
    inverse["rms_ratio"] = inverse["rms_polynomial"] / inverse["rms_curves"]
    return Results(
        {"steady": steady, "inverse": inverse}, models=models, record=record,
        validation=validation, predictions=predictions, targets=targets, achieved=achieved,
    )  # fmt: skip


def new_fibre(seed: int, experiment: int) -> Actuator:
    """Return a specimen with a noisy sensor; every experiment has its own noise."""
    noise_seed = seed + FURTHER * experiment
    return connect("twin:fibre", specimen=seed, noise=NOISE, seed=noise_seed)


def fibre_at_rest(seed: int, experiment: int) -> Actuator:
    """Return the fibre settled at the lowest voltage: negative saturation."""
    fibre = new_fibre(seed, experiment)
    fibre.apply(LOW, HOLD, 1.0)
    return fibre


def _settled(seed: int, experiment: int, voltages: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return voltages and their settled lengths."""
    return voltages, hold_each(new_fibre(seed, experiment), voltages, HOLD)[1]


STEPS = (0.40, 0.45, 0.50, 0.45)
"""Voltages of the step experiment in V: the paper's step, one to score it on, and one down."""
REST, INTERVAL = 600.0, 1.0
MARKER = ("u4", "u6", "u2", "u4")
MARKER_LEVELS = 6


def run_study(seed: int) -> Results:
    """Carry the whole study out on the specimen of a seed.

    ``steps`` are the holds at `STEPS`; ``fit`` is the ARX model of the first, ``responses`` the
    unit steps up and down; ``single``, ``updown`` and ``ours`` (T,) the outputs of the joined
    models in um at the times of the record of the seven voltages, the first two with its relays.
    """
    steady, fibre = run_steady(seed), fibre_at_rest(seed, 7)
    steps = [fibre.apply(u, HOLD if k else REST, INTERVAL) for k, u in enumerate(STEPS)]
    fit = arx(*_joined(steps[0], steps[1]))
    down = step_response(*_joined(steps[2], steps[3])).falling
    up = step_response(*_joined(steps[0], steps[1])).rising
    assert down is not None
    assert up is not None
    t, u, y = steady.record.t, steady.record.u, steady.record.y
    single, updown, ours = (
        Trajectory(steady.models[name], up.model, falling).simulate(t, u, before=LOW)
        for name, falling in (("square", None), ("square", down.model), ("curves", down.model))
    )
    facts = fibre_facts()
    free_run = _averaged(fit.model.step_response(steps[2].t - steps[1].t[-1]))
    measured = _averaged(unit_step(steps[1], steps[2]))
    one_way, both_ways, with_ours = (nrmse(joined - y, y) for joined in (single, updown, ours))
    figures = {
        "twin": facts,
        **steady.figures(),
        "trajectory": {
            "single_nrmse": one_way,
            "updown_nrmse": both_ways,
            "ours_nrmse": with_ours,
            "updown_over_single": both_ways / one_way,
        },
        "arx": {"free_run_nrmse": nrmse(free_run - measured, measured), "order": fit.model.order},
    }
    return Results(
        figures, seed=seed, facts=facts, steady=steady, steps=steps, fit=fit,
        responses=StepResponse(up, down), single=single, updown=updown, ours=ours,
    )  # fmt: skip


def fibre_facts() -> dict[str, Any]:
    """Return the measured properties of the nominal fibre, as of `twin_facts`, and its times."""
    grid = uniform_levels(LOW, HIGH, BANDS)
    found = twin_facts(Fibre, grid, HOLD, loop=(0.35, 0.45), excursion=0.35)
    return {**found, **_times(Fibre())}


def marker_diagrams() -> list[tuple[str, FloatArray]]:
    """Return the inputs of the paper's example, Fig 2, and the relays that are on after each.

    Relays (N, N) are by ``[alpha, beta]``: 1 on, -1 off, NaN where there is none.
    """
    levels = np.arange(1.0, MARKER_LEVELS + 1)
    there = np.tri(MARKER_LEVELS)
    model = RelayModel(levels, there, relay="unipolar")
    inputs = [float(name[1:]) for name in MARKER]
    states = [2 * model.states(inputs[: count + 1]) - 1 for count in range(len(MARKER))]
    return [
        (name, np.where(there > 0, on, np.nan)) for name, on in zip(MARKER, states, strict=True)
    ]


def unit_step(before: Record, after: Record) -> FloatArray:
    """(T,) the hold ``after``, scaled to 0 at the settled end of ``before`` and 1 at its own."""
    span = float(np.ptp(np.concatenate([before.y, after.y])))
    rest, end = settled_value(before, span), settled_value(after, span)
    return np.asarray((after.y - rest) / (end - rest))


def _averaged(y: FloatArray) -> FloatArray:
    """Means over ten samples: the noise of a sample is 3 % of a step, that of the mean 1 %."""
    return np.asarray(y[: y.size // 10 * 10].reshape(-1, 10).mean(axis=1))


def _joined(before: Record, after: Record) -> tuple[FloatArray, FloatArray, FloatArray]:
    record = Record.joined([before, after])
    return record.t, record.u, record.y


def _times(fibre: Fibre) -> dict[str, float]:
    """Seconds to 63 % and 95 % of steps up and down to 0.45 V."""
    found = {}
    for name, begin in (("up", 0.40), ("down", 0.50)):
        fibre.reset()
        held = fibre.apply(begin, REST, INTERVAL)
        share = unit_step(held, fibre.apply(0.45, REST, INTERVAL))
        for percent in (63, 95):
            found[f"{name}_t{percent}_s"] = float(np.argmax(share >= percent / 100) + 1) * INTERVAL
    return found


_NAMES = {
    "square": ("dots, square system", "C4"),
    "dots": ("dots, constrained", "C9"),
    "uniform": ("uniform cells", "C7"),
    "curves": ("ours: reversible diagonal", "C0"),
    "plays": ("play operators", COLOURS["plays"]),
    "polynomial": ("cubic", COLOURS["polynomial"]),
}
_LENGTH = "change of length [um]"


def voltages_table(steady: Results) -> Table:
    """Return measured and predicted lengths at the seven voltages."""
    lengths = np.array([VALIDATION, steady.validation, *map(steady.predictions.get, _NAMES)]).T
    rows = [(f"{voltage:.2f}", *(f"{each:.1f}" for each in row)) for voltage, *row in lengths]
    words = (words for words, _ in _NAMES.values())
    return Table(("voltage, V", "measured, um", *words), rows)


def times_of(model: Linear) -> str:
    """Return the time constants of a model as a list."""
    return ", ".join(f"{value:.1f}" for value in model.time_constants)


def draw_marker() -> Any:
    """Draw Fig 2: four diagrams of relays, filled where on, and the marker."""
    levels = np.arange(1.0, MARKER_LEVELS + 1)
    alpha, beta = np.meshgrid(levels, levels, indexing="ij")
    ticks, around = [f"u{k:.0f}" for k in levels], (0.4, MARKER_LEVELS + 0.6)
    frame = {"xticks": levels, "xticklabels": ticks, "yticks": levels, "yticklabels": ticks}
    panels = []
    for letter, (name, on) in zip("abcd", marker_diagrams(), strict=True):
        now = float(name[1:])
        panels.append(
            panel(
                "beta", "alpha" if letter == "a" else "",
                (beta[on > 0], alpha[on > 0], "C0 o 8"), (beta[on < 0], alpha[on < 0], "0.75 o 4"),
                (now, now, "C1 s 5"), title=f"({letter}) {name}", aspect="equal",
                xlim=around, ylim=around, **frame,
            )
        )  # fmt: skip
    return draw(*panels, columns=4, height=2.9, sharey=True)


def draw_prediction(study: Results) -> Any:
    """Draw Fig 3: the loop of the dots and the path of the seven, and lengths in time."""
    steady, model = study.steady, study.steady.models["square"]
    loop, way = np.concatenate([LEVELS, LEVELS[::-1]]), (LOW, *VALIDATION)
    t, ends = _minutes(steady), HOLD / MINUTE * np.arange(1, len(VALIDATION) + 1)
    dots, outlined = (steady.predictions["square"], "C0 o 6", "predicted"), {"loc": "lower right"}
    return draw(
        panel(
            "voltage [V]", _LENGTH, (loop, model.simulate(loop), "0.6 - 2.5", "major loop"),
            (way, model.simulate(way), "C0 - 1.0", "path"), (VALIDATION, *dots),
            (VALIDATION, steady.validation, "C1 x 6", "measured"), title="(a)", legend=outlined,
        ),
        panel(
            "time [min]", _LENGTH, (t, steady.record.y, "C1 - 1.2", "measured"), (ends, *dots),
            title="(b)", legend=outlined,
        ),
        columns=2, height=4.0,
    )  # fmt: skip


def _minutes(steady: Results) -> Any:
    return (steady.record.t - steady.record.t[0]) / MINUTE


def draw_ours(study: Results) -> Any:
    """Draw loop and density of cells with a reversible diagonal."""
    model = study.steady.models["curves"]
    loop, way = (_between(ends, 40) for ends in ([LOW, HIGH, LOW], [LOW, *VALIDATION]))
    left = panel(
        "voltage [V]", _LENGTH, (loop, model.simulate(loop), "0.6 - 2.5", "major loop"),
        (way, model.simulate(way), "C0 - 1.0", "path"),
        (VALIDATION, study.steady.validation, "C1 x 6", "measured"), legend={"loc": "lower right"},
    )  # fmt: skip
    density = partial(
        draw_density, model=model, input_label="voltage [V]", output_label="length [um]"
    )
    return draw(left, density, columns=2, height=4.0)


def _between(corners: Any, points: int) -> FloatArray:
    return np.concatenate([np.linspace(a, b, points) for a, b in pairwise(corners)])


def draw_errors(study: Results) -> Any:
    """Draw the errors of four models at the seven voltages."""
    steady, place = study.steady, np.arange(len(VALIDATION)) + 1
    shown = ("square", "uniform", "curves", "polynomial")
    errors = {name: steady.predictions[name] - steady.validation for name in shown}
    groups = {
        f"{_NAMES[name][0]}: {rms(error):.1f} um rms": (error, _NAMES[name][1])
        for name, error in errors.items()
    }
    volts = [f"{voltage:g}" for voltage in VALIDATION]
    labels = "voltage [V], in this order", "predicted minus measured [um]"
    return draw(bars(*labels, groups, xticks=place, xticklabels=volts))


def draw_inverse(study: Results) -> Any:
    """Draw the inverse as a map from length to voltage, and the errors of driving with it."""
    steady, model = study.steady, study.steady.models["curves"]
    low, high = model.range
    corners = [low, high, low, 0.7 * high + 0.3 * low, 0.4 * high + 0.6 * low, high]
    wanted = _between(corners, 60)
    names = {"curves": "Preisach", "plays": "plays", "polynomial": "cubic"}
    groups = {
        f"{words} inverse": (steady.achieved[name] - steady.targets, _NAMES[name][1])
        for name, words in names.items()
    }
    left = panel(
        "length wanted [um]", "voltage [V]", (wanted, model.invert(wanted).u, "C0"),
        title="Inverse hysteresis", ylim=(LOW - 0.02, HIGH + 0.02),
    )  # fmt: skip
    return draw(left, bars("target", "achieved minus target [um]", groups), columns=2)


def draw_step(study: Results) -> Any:
    """Draw the step as the paper does: measured length, input, and unit step of the model."""
    rest, up = study.steps[:2]
    near = rest.t > rest.t[-1] - 60.0
    t, y, u = (
        np.concatenate([getattr(rest, name)[near], getattr(up, name)]) for name in ("t", "y", "u")
    )
    after, words = up.t - rest.t[-1], "time since the step [s]"
    step = (after, study.fit.model.step_response(after), "C0 - 1.2")
    return draw(
        panel(words, _LENGTH, (t - rest.t[-1], y, "C1"), title="(a)"),
        panel(words, "voltage [V]", (t - rest.t[-1], u, "0.3"), title="(b)"),
        panel(words, "unit step of the ARX model", step, title="(c)"),
        columns=3, height=3.0,
    )  # fmt: skip


def draw_steps(study: Results) -> Any:
    """Draw the measured unit steps with the models: two up, and one down."""
    rest, up, second, down = study.steps
    t, responses = up.t - rest.t[-1], study.responses
    rising, falling = responses.rising.model, responses.falling.model
    lines = (
        (t, unit_step(second, down), "C3 - 0.6", "0.50 to 0.45 V, fitted"),
        (t, unit_step(rest, up), "C1 - 0.8", "0.40 to 0.45 V, fitted"),
        (t, unit_step(up, second), "0.6 - 0.8", "0.45 to 0.50 V, not fitted"),
        (t, rising.step_response(t), "0.1 - 1.5", "models, up and down"),
        (t, falling.step_response(t), "0.1 - 1.5"),
    )
    frame: dict[str, Any] = {"legend": {"loc": "lower right"}}
    return draw(panel("time since the step [s]", "share of the settled change", *lines, **frame))


def draw_trajectory(study: Results) -> Any:
    """Draw Fig 5: the measured length, predicted settled values, the joined models, and errors."""
    steady, t = study.steady, _minutes(study.steady)
    ends = HOLD / MINUTE * np.arange(1, len(VALIDATION) + 1)
    joined = ((study.single, "C3", "one response"), (study.updown, "C0", "one each way"))
    return draw(
        panel(
            "", _LENGTH, (t, steady.record.y, "0.7 - 2.5", "measured"),
            *((t, *each) for each in joined),
            (ends, steady.predictions["square"], "0.1 o 6", "settled, predicted"),
            legend={**ABOVE, "ncols": 4},
        ),
        panel(
            "time [min]", "model less measured [um]",
            *((t, values - steady.record.y, colour) for values, colour, _ in joined),
        ),
        height=5.2, sharex=True,
    )  # fmt: skip


STUDY = Study(
    "fibre", "Hysteresis and step response of a polyaniline fibre", run_study, page=__name__
)

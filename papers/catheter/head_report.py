"""The report of the catheter head study: the paper's figures drawn for the twin, and more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.drawing.operators import draw_density
from minorloop.report import Picture, Report, Table
from minorloop_head.twins.surroundings import Cooling
from papers.catheter.head import (
    CLAIMS,
    DEFAULT,
    IMPOSSIBLE,
    OLD,
    PERIODS,
    RAMP_AT,
    TARGETS,
    TITLE,
)
from papers.catheter.head_camera_report import add_camera
from papers.catheter.head_loop import DISTURBED, HIGHEST, HOTTEST, TICK, HeadRun
from papers.catheter.head_ramps import CASES, NAMED
from papers.catheter.head_rivals_report import (
    STEP,
    WORDS,
    ControllerFigure,
    rivals_table,
    where_better,
)
from papers.catheter.head_static import CURRENT
from papers.catheter.paper_sections_report import add_sections
from papers.catheter.servo_integral_report import add_integral
from papers.catheter.sight_report import add_sight
from papers.claims import claim_table, specimens
from papers.drawing import every_specimen, new_figure

if TYPE_CHECKING:
    from papers.catheter.head import HeadStudy

_COLOURS = {
    "observer": "C0",
    "feedforward": "C7",
    "pi": "C3",
    "internal_model": "C1",
    "adaptive": "C2",
    "feedforward_pi": "C4",
    "model_reference": "C9",
}
_ROUNDING = 1e-9
"""Error of an inverse in percent of the range that is of the floating-point numbers only."""
RIVALS = (
    *STEP,
    ControllerFigure("disturbed_settle_s", "settling when disturbed", "s", 1, least=TICK),
    ControllerFigure("disturbed_rms_deg", "steady rms when disturbed", "deg"),
    ControllerFigure("ambient_ramp_max_deg", "worst with ambient +10 K", "deg"),
    ControllerFigure("circle_rms_deg", f"circle in {PERIODS[1]:g} s, rms", "deg"),
    ControllerFigure("energy_A2s", "energy", "A²s", 1),
)
"""Figures of the controllers in the table of Fig 10."""


def study_report(
    study: HeadStudy, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> Report:
    """Return the report.

    Parameters
    ----------
    study : HeadStudy
        The first specimen, which is drawn.
    figures : mapping
        Over all specimens.
    runs : sequence of mapping
        The figures of each specimen.
    """
    steps, pi = figures["steps"], figures["rivals"]["pi"]
    report = Report(
        TITLE,
        f"The experiments of Boudjabi, Ferreira and Krupa on {specimens(runs)}; figures are drawn "
        f"for that of seed {study.seed}. Steps of 20 to 40 degrees settle in "
        f"{steps['settle_s']:.1f} s with the inverse operator and an observer of the heating "
        f"power, in {pi['settle_s']:.1f} s with PI control without a model.",
    )
    _add_overview(report, study, figures, runs)
    add_sections(report, figures, _drawn(study))
    _add_static(report, study, figures)
    _add_inverse(report, study, figures)
    _add_open_loop(report, study, figures)
    _add_steps(report, study, figures)
    _add_disturbed(report, study, figures)
    _add_circles(report, study, figures)
    add_camera(report, study.camera, figures, study.runs, study.seed)
    _add_limits(report, study)
    _add_planning(report, study, figures)
    add_sight(report, study.sight, figures, study.seed)
    add_integral(report, study.integral, figures["integral"], study.seed)
    return report


def _add_overview(
    report: Report, study: HeadStudy, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> None:
    facts, clock = study.facts, figures["realtime"]
    report.add(
        "What was found",
        text=(
            "The head is a twin, a simulation of heat, phase transformation and springs with no "
            "Preisach operator in it. Each specimen has its own material, springs and pulleys, "
            "within 10 % of nominal. Figures are medians over specimens of the worst case of "
            "each. A step has settled within 2 % of its target, or 0.3 degrees where that is "
            "more. Angles are scored without the noise of the sensor. Settling, overshoot and "
            "steady rms are those of pan, the axis that steps; a circle is scored by the distance "
            'from the wanted point, both axes together. In all tables, "not reached" means that '
            'it did not happen before the end of a run, and "none" that there was nothing to '
            "count.",
            f"One control step of both axes took {clock['step_ms_median']:.2f} ms in the median, "
            f"and 999 of 1000 steps took at most {clock['step_ms_p999']:.2f} ms. The loop has "
            f"{1e3 * TICK:.0f} ms. These times depend on the machine that runs the study and on "
            "what else it does meanwhile, so that no bound is set.",
            "Three printed formulas of the paper cannot be used as they are. With relays of 0 "
            "and 1 the density is the mixed derivative of the reversal values, without the "
            "factor 1/2 that belongs to relays of -1 and +1. The sums of Eqs. (5) and (6) end "
            "with the last minimum m(n-1), and lack the output of the cold wire. And 1.2 V over "
            "20 ohm are 60 mA, not the 400 mA of the text; the command of 1.2 V stands for "
            "400 mA here.",
        ),
        table=claim_table(CLAIMS, figures),
        pictures=every_specimen(CLAIMS, runs, study.seed),
    )
    report.add(
        "The twin",
        text=f"At nominal parameters 400 mA turn it to {facts['angle_at_400mA_deg']:.0f} degrees "
        f"at {facts['hottest_C']:.0f} degrees Celsius and {facts['stress_MPa']:.0f} MPa, which is "
        "more than the 172 MPa that makers advise for long life. It comes 63 % of the way up in "
        f"{facts['heat_t63_s']:.1f} s and of the way down in {facts['cool_t63_s']:.1f} s.",
    )


def _drawn(study: HeadStudy) -> dict[str, dict[str, float]]:
    """Return how the steps of each controller settle, and the time of a step of the loop in ms."""
    found = {}
    for name in WORDS:
        runs = [study.runs[f"step {target:g}", name] for target in TARGETS]
        took = np.concatenate([run.step_seconds[1:] for run in runs])
        settled = [run.settle for run in runs]
        found[name] = {
            "least": min(settled),
            "most": max(settled),
            "step_ms": 1e3 * float(np.median(took)),
        }
    return found


def _add_static(report: Report, study: HeadStudy, over_all: Mapping[str, Any]) -> None:
    figures, arbitrary = over_all["static"], over_all["arbitrary"]
    wire = study.static.wires[0].model
    report.add(
        "Figs 2 and 5: the loop, and what the models make of it",
        text="The paper measures reversal curves on a mesh of 0.1 V. The wire moves over less "
        "than half of that range, so that most of the mesh is spent where nothing happens. Here "
        "it is measured on that mesh, and again on few levels placed where it moves, with the "
        "heating power as the input. There a decaying staircase follows the reversal curves, "
        f"{study.static.wires[0].steady.u.size} settled holds in all where the mesh has "
        f"{study.static.paper.u.size}, since the minor loops of a wire depend on more of its past "
        "than those of an operator do. After commands that no model was fitted to, the rms error "
        f"is {figures['rms_deg']:.2f} degrees for the operator on power, "
        f"{figures['mesh_rms_deg']:.2f} for the mesh with its interpolation, and "
        f"{figures['dots_rms_deg']:.2f} for the same mesh with one relay at each of its points "
        f"and no interpolation, as in the fibre paper. The heating lag is {wire.lag:.1f} s while "
        "the wire does not move; the latent heat makes it "
        f"{wire.lag + wire.latent * _mean_slope(wire):.1f} s on average while it does. Of the "
        f"random holds, {figures['moving_holds']:.0f} of {study.static.inputs.size} lie between "
        f"the ends of the stroke; there it errs by {figures['moving_rms_deg']:.2f} degrees rms. "
        "Fig 5 has an arbitrary input over time. Under one with "
        f"{arbitrary['minor_loops']:.0f} minor loops of the angle the operator on power "
        f"with its lag errs by {arbitrary['rms_deg']:.2f} degrees rms, and by "
        f"{arbitrary['moving_rms_deg']:.2f} in the {arbitrary['moving_share']:.0%} of the time in "
        "which the wire moves; the mesh behind a linear lag of the command errs by "
        f"{arbitrary['mesh_rms_deg']:.2f} and {arbitrary['mesh_moving_rms_deg']:.2f}. The angle "
        "is that of a sensor at the joint.",
        pictures=[
            Picture(
                draw_loops(study),
                "Fig 2: the major loop with reversal curves, and the density on power. "
                f"{_sensed(study)}",
            ),
            Picture(
                draw_arbitrary(study),
                "Fig 5: actual and predicted angle under an arbitrary input. " + _sensed(study),
            ),
            Picture(
                draw_predictions(study),
                f"Angle after each of the random holds, and errors. {_sensed(study)}",
            ),
        ],
    )


def _add_inverse(report: Report, study: HeadStudy, figures: Mapping[str, Any]) -> None:
    stepping, exact = figures["stepping_inverse"], figures["exact_inverse"]
    report.add(
        "Fig 6: the stepping inverse against the exact one",
        text="The paper raises or lowers the command by 0.1 V until its model has passed the "
        "target, so that it errs by up to a step; in its chart the wrong output is tested, and "
        "nothing stops it at the end of the range. Made safe, it errs by "
        f"{stepping['rms_pct']:.1f} % of the range rms on its own model. The exact inverse "
        f"{_to_rounding(exact['rms_pct'])}. Driving the wire, {stepping['driven_rms_deg']:.1f} and "
        f"{exact['driven_rms_deg']:.1f} degrees rms remain.",
        pictures=[
            Picture(
                draw_inverse(study), f"Errors at random targets, model and wire. {_sensed(study)}"
            )
        ],
    )


def _add_open_loop(report: Report, study: HeadStudy, figures: Mapping[str, Any]) -> None:
    ramps, lag = figures["fig8"], figures["fig8"]["lag_s"]
    own = {key: value for key, value in ramps.items() if not isinstance(value, Mapping)}
    rows = []
    for name, case in CASES.items():
        of = own if name == NAMED else ramps[name]
        rows.append(
            (
                case.words,
                f"{of['first_rise_deg']:.2f}",
                f"{of['error_first_ramp_deg']:.2f}",
                f"{of['error_last_ramp_deg']:.2f}",
                f"{of['last_fall_deg']:.2f}",
                f"{of['ratio']:.1f}",
                f"{_after_start(study, name):.1f}",
            )
        )
    columns = (
        "case",
        "first ramp, rising half",
        "first ramp",
        "tenth ramp",
        "tenth ramp, falling half",
        "tenth over first",
        f"tenth over second, seed {study.seed}",
    )
    share = Cooling().share
    report.add(
        "Fig 8: ramps in open loop",
        text="The paper drives ramps by the inverse of a linear transfer function of the heating "
        "and by the stepping inverse. The first rising ramp is followed; at the end of the input, "
        "after a long operation, a significant error is left. It blames strong dynamical effects "
        "and the variable dynamics of the heating. The same chain drives the twin, whose heating "
        "varies as that of a wire in a head does: latent heat, resistance of the phases, "
        "convection that grows with the temperature of the wire and with its bending, and a body "
        f"of the head that the wire warms, by {own['body_K']:.1f} K after twenty minutes. That "
        f"{100 * share:.0f} % of the surroundings of a wire are this body is assumed, and with it "
        "the size of the error; the paper does not give it. The "
        f"model has none of this, but one lag of {lag:.1f} s of the command. The first ramp begins "
        "cold, so that the tenth over the first is not 1 without the body either: it is "
        f"{ramps['constant']['ratio']:.2f} with latent heat and resistance alone and "
        f"{ramps['film']['ratio']:.2f} with convection, beside {own['ratio']:.2f} with the body. "
        "The tenth over the second is without the cold start: "
        f"{_after_start(study, 'constant'):.2f}, {_after_start(study, 'film'):.2f} and "
        f"{_after_start(study, NAMED):.2f} on the specimen that is drawn. Without a slow variable "
        "of the heating a wire forgets its state within a ramp, and equal ramps repeat. "
        "Ramps that get faster can become worse without one. "
        "A room that warms is not the paper's cause. The steps of the inverse are 0.1 V across the "
        "20 ohm of the paper, 5 mA; with steps of 0.1 V of the command, 33 mA, the steps are most "
        "of the error. In closed loop two of the ramps are "
        f"{own['closed_deg']:.2f} degrees rms off. Errors in degrees rms; medians over all "
        "specimens but for the last column. Settled holds in open loop are "
        f"{figures['open_loop']['rms_deg']:.1f} degrees rms off in steady surroundings, and "
        f"{figures['open_loop_plus_10K']['rms_deg']:.0f} in air that is 10 K warmer than when the "
        "wire was identified.",
        table=Table(columns, rows),
        pictures=[
            Picture(
                draw_ramps(study),
                f"Fig 8: reference and actual angle, errors, body of the head. {_sensed(study)}",
            )
        ],
    )


def _after_start(study: HeadStudy, case: str) -> float:
    """Return the rms error of the tenth ramp over that of the second, which begins warm."""
    ramps = np.sqrt(np.mean(study.ramps[case].rms ** 2, axis=1))
    return float(ramps[-1] / ramps[1])


def _add_steps(report: Report, study: HeadStudy, figures: Mapping[str, Any]) -> None:
    report.add(
        "Fig 10: steps, with the inverse operator and without",
        text=(
            "All run at 25 Hz on readings that are 40 ms old with 0.05 degrees of noise, through "
            "the same guard. The paper's internal model takes the lag to follow the operator; the "
            "heat in fact precedes it, and what a step needs depends on where in the loop it "
            "begins. The observer follows the heating power itself and asks the inverse operator "
            "how much is missing: this is the use of the operator. PI alone must wait for "
            "its integral to cross the width of the loop. Two more laws are those of other "
            "authors whom the paper cites: the inverse as feedforward with PI feedback (Ge and "
            "Jouaneh, 1997), and a reference model whose gains adapt around the inverse (Song and "
            "Li, 1999).",
            "The first three figures of a controller are the worst of the steps of "
            f"{_listed(TARGETS)} degrees. The energy is the integral of the squared current over "
            f"these steps. Disturbed is the step of {TARGETS[-1]:g} degrees alone, the worst of "
            "four surroundings; the rows with four other surroundings in the first table are of "
            "all three steps. Medians over all specimens.",
            where_better(RIVALS, figures["rivals"], DEFAULT),
        ),
        table=rivals_table(RIVALS, figures["rivals"]),
        pictures=[
            Picture(
                draw_steps(study.runs),
                f"Fig 10: angle and current of three steps. {_sensed(study)}",
            )
        ],
    )


def _add_disturbed(report: Report, study: HeadStudy, figures: Mapping[str, Any]) -> None:
    aged = figures["aged"]
    report.add(
        "Other surroundings",
        text="What the paper leaves open: ambient and convection that are not those of the "
        "identification, and an ambient that rises by 10 K within 10 s. On wires that have aged "
        "by a whole life, 10 % less stroke and 5 K, the second half of a staircase is "
        f"{aged['observer_rms_deg']:.2f} degrees rms off with the observer and "
        f"{aged['adaptive_rms_deg']:.2f} with the adaptive model: ageing mostly changes the "
        "bias, which the observer compensates anyway.",
        pictures=[
            Picture(
                draw_disturbed(study),
                f"Steps in other surroundings, and the rising ambient. {_sensed(study)}",
            ),
            Picture(
                draw_aged(study),
                f"Aged wires: errors of the observer with and without learning. {_sensed(study)}",
            ),
        ],
    )


def _add_circles(report: Report, study: HeadStudy, figures: Mapping[str, Any]) -> None:
    speeds = ", ".join(
        f"{figures[key]['rms_deg']:.2f} in {key[7:-1]} s"
        for key in sorted(
            (k for k in figures if k.startswith("circle")), key=lambda k: -float(k[7:-1])
        )
    )
    report.add(
        "Fig 11: circles",
        text="Both axes at once, 10 degrees about (25, 25). Distance from the wanted point, "
        f"degrees rms: {speeds}. A wire is heated as fast as the current allows, but cools only "
        "as fast as the air takes the heat: this limits the speed of a circle.",
        pictures=[Picture(draw_circles(study), f"Fig 11: pan against tilt. {_sensed(study)}")],
    )


def _add_limits(report: Report, study: HeadStudy) -> None:
    columns = ("controller", "runs", "highest current, A", "hottest, C", "highest stress, MPa")
    rows = []
    for name, words in WORDS.items():
        own = [run for (_, who), run in study.runs.items() if who == name]
        rows.append(
            (
                words,
                str(len(own)),
                f"{max(float(run.current.max()) for run in own):.3f}",
                f"{max(float(run.truth.hottest.max()) for run in own):.0f}",
                f"{max(float(run.truth.stress.max()) for run in own) / 1e6:.0f}",
            )
        )
    report.add(
        "Limits, lost sensors, and targets out of reach",
        text=f"No run may exceed {HIGHEST} A or {HOTTEST:.0f} degrees Celsius, with a sensor that "
        "sticks or is lost, and where little cools the wire, as well. At the end of its stroke the "
        "angle does not tell how hot a wire is; there it is not heated on. The controller cannot "
        "measure the temperature and uses the higher of two estimates; the score uses the truth of "
        "the twin. A target that cannot be reached is given up with its cause: flooded without a "
        "sleeve the wire hardly warms, in air of -10 degrees most specimens do not turn all the "
        "way.",
        table=Table(columns, rows),
        pictures=[
            Picture(
                draw_hopeless(study),
                f"Targets out of reach: angle, current, verdict. {_sensed(study)}",
            )
        ],
    )


def _add_planning(report: Report, study: HeadStudy, over_all: Mapping[str, Any]) -> None:
    figures = over_all["planning"]
    report.add(
        "Planning ahead",
        text="Where targets fall faster than the wire cools, a plan that knows them cools early. "
        f"Its squared error is {figures['cost_ratio']:.2f} of that of the inverse, target by "
        f"target, on the model, and {figures['driven_cost_ratio']:.2f} on the wire.",
        pictures=[
            Picture(
                draw_plan(study),
                f"A planned sequence and the inverse one, driven; seed {study.seed}.",
            )
        ],
    )


def draw_loops(study: HeadStudy) -> Any:
    """Draw reversal curves of the mesh, and the density of the operator on power."""
    figure, (left, right) = new_figure(1, 2, height=4.2)
    paper = study.static.paper
    left.plot(paper.u, paper.y, ".", ms=4, color="C1", label="measured, settled")
    for top in paper.model.levels[4:]:
        way = np.concatenate([np.linspace(0.0, top, 120), np.linspace(top, 0.0, 120)])
        label = "mesh, interpolated" if top == paper.model.levels[-1] else None
        left.plot(way, paper.model.simulate(way), color="C0", lw=0.5, alpha=0.7, label=label)
    left.set(xlabel="command [V]", ylabel="angle [deg]", title="mesh of 0.1 V")
    left.legend(frameon=False)
    right.grid(False)
    draw_density(
        right,
        study.static.wires[0].model.operator,
        input_label="effective power [A²]",
        output_label="angle [deg]",
    )
    right.set_title("operator on heating power")
    return figure


def draw_predictions(study: HeadStudy) -> Any:
    """Draw measured and predicted angles after random commands."""
    figure, (upper, lower) = new_figure(2, 1, height=5.0, sharex=True)
    static = study.static
    place = np.arange(static.inputs.size) + 1
    upper.plot(place, static.settled, "o", ms=6, color="0.6", label="measured")
    names = {
        "power": ("on power", "C0"),
        "mesh": ("mesh", "C1"),
        "dots": ("mesh, one relay a point", "C3"),
    }
    for name, (words, colour) in names.items():
        predicted = static.predictions[name]
        upper.plot(place, predicted, "_", ms=9, mew=1.6, color=colour, label=words)
        lower.plot(place, predicted - static.settled, "o-", ms=3, lw=0.7, color=colour)
    upper.set(ylabel="angle [deg]")
    upper.legend(frameon=False, ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.2))
    lower.set(xlabel="random command, in this order", ylabel="predicted less measured [deg]")
    return figure


def draw_arbitrary(study: HeadStudy) -> Any:
    """Draw command, actual and predicted angle, and errors under the arbitrary input."""
    figure, (upper, middle, lower) = new_figure(
        3, 1, height=6.5, sharex=True, height_ratios=(1, 3, 2)
    )
    found = study.static.arbitrary
    upper.plot(found.t, found.command, color="0.3", lw=0.8)
    middle.plot(found.t, found.angle, color="0.6", lw=2.5, label="actual")
    names = {"power": ("predicted, on power", "C0"), "mesh": ("predicted, mesh", "C1")}
    for name, (words, colour) in names.items():
        predicted = found.predicted[name]
        middle.plot(found.t, predicted, color=colour, lw=0.9, label=words)
        lower.plot(found.t, predicted - found.angle, color=colour, lw=0.8)
    upper.set(ylabel="command [V]")
    middle.set(ylabel="angle [deg]")
    middle.legend(frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, 1.2))
    lower.set(xlabel="time [s]", ylabel="predicted less actual [deg]")
    return figure


def draw_inverse(study: HeadStudy) -> Any:
    """Draw errors of the two inverses on the model and on the wire."""
    figure, axes = new_figure(1, 2, height=3.6, sharey=True)
    static = study.static
    for one, title, ways in (
        (axes[0], "on the identified model", {"stepping": static.stepping, "exact": static.exact}),
        (axes[1], "on the wire", static.driven),
    ):
        for name, colour in (("stepping", "C3"), ("exact", "C0")):
            one.plot(
                static.targets, ways[name] - static.targets, "o", ms=4, color=colour, label=name
            )
        one.axhline(0.0, color="0.3", lw=0.8)
        one.set(xlabel="target [deg]", title=title)
    axes[0].set_ylabel("error [deg]")
    axes[0].legend(frameon=False)
    return figure


def draw_ramps(study: HeadStudy) -> Any:
    """Draw ramps in open loop: angle, errors of three cases, and the temperature of the body."""
    figure, (upper, middle, lower) = new_figure(
        3, 1, height=7.0, sharex=True, height_ratios=(3, 3, 1)
    )
    named = study.ramps[NAMED]
    upper.plot(named.t, named.wanted, color="0.2", lw=0.8, ls="--", label="reference")
    upper.plot(named.t, named.angle, color="C0", lw=1.0, label="actual")
    words = {
        NAMED: "varying heating, with a body",
        "constant": "latent heat and resistance alone",
        "room": "room warms by 6 K",
    }
    for (name, label), colour in zip(words.items(), ("C0", "C7", "C3"), strict=True):
        run = study.ramps[name]
        middle.plot(run.t, run.error, color=colour, lw=0.8, label=label)
    lower.plot(np.append(0.0, named.ends[1:]), np.append(20.0, named.body), ".-", color="C1")
    upper.set(ylabel="angle [deg]")
    middle.set(ylabel="error [deg]")
    lower.set(xlabel="time [s]", ylabel="body [C]")
    for one in (upper, middle):
        one.legend(frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, 1.2))
    return figure


def draw_steps(runs: Mapping[tuple[str, str], HeadRun]) -> Any:
    """Draw the steps of `run_steps` with every controller: angles above, currents below."""
    figure, axes = new_figure(2, 3, height=5.6, sharex=True, sharey="row")
    for column, target in enumerate(TARGETS):
        for name, words in reversed(WORDS.items()):  # the default is drawn last, on top
            run = runs[f"step {target:g}", name]
            colour = _COLOURS[name]
            axes[0, column].plot(run.t, run.truth.angle[:, 0], color=colour, lw=1.1, label=words)
            axes[1, column].plot(run.t, run.current[:, 0], color=colour, lw=0.8)
        axes[0, column].axhline(target, color="0.2", lw=0.8, ls="--")
        axes[0, column].set_title(f"{target:g} degrees")
        axes[1, column].set_xlabel("time [s]")
    axes[0, 0].set_ylabel("angle [deg]")
    axes[1, 0].set_ylabel("current [A]")
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), ncols=4, loc="outside upper center", frameon=False
    )
    return figure


def draw_disturbed(study: HeadStudy) -> Any:
    """Draw steps of 40 degrees in other surroundings, and the error while the ambient rises."""
    figure, (left, right) = new_figure(1, 2, height=3.8)
    for place, where in enumerate(DISTURBED):
        run = study.runs[f"{where}, step {TARGETS[-1]:g}", DEFAULT]
        left.plot(run.t, run.truth.angle[:, 0], color=f"C{place}", lw=1.1, label=where)
    left.axhline(TARGETS[-1], color="0.2", lw=0.8, ls="--")
    left.set(xlabel="time [s]", ylabel="angle [deg]", title=WORDS[DEFAULT])
    left.legend(frameon=False)
    for name in (DEFAULT, "internal_model", "pi"):
        run = study.runs["ambient ramp", name]
        late = run.t > RAMP_AT - 5
        right.plot(run.t[late], run.error[late, 0], color=_COLOURS[name], label=WORDS[name])
    right.axvspan(RAMP_AT, RAMP_AT + 10, color="C3", alpha=0.12, label="ambient rises 10 K")
    right.set(xlabel="time [s]", ylabel="error [deg]")
    right.legend(frameon=False)
    return figure


def draw_aged(study: HeadStudy) -> Any:
    """Draw errors on aged wires."""
    figure, axes = new_figure(height=3.0)
    for name in OLD:
        run = study.runs["aged", name]
        axes.plot(run.t, run.error[:, 0], color=_COLOURS[name], lw=0.9, label=WORDS[name])
    axes.set(xlabel="time [s]", ylabel="error [deg]", ylim=(-3, 3))
    axes.legend(frameon=False)
    return figure


def draw_circles(study: HeadStudy) -> Any:
    """Draw circles, wanted and driven."""
    periods = [key for key in study.figures() if key.startswith("circle")]
    chosen = [f"{PERIODS[0]:g}", f"{PERIODS[1]:g}", periods[-1][7:-1]]
    figure, axes = new_figure(1, 3, height=3.6, sharex=True, sharey=True)
    for one, period in zip(axes, chosen, strict=True):
        run = study.runs[f"circle {period} s", DEFAULT]
        late = run.t > run.t[-1] - 2 * float(period)
        one.plot(*run.wanted[late].T, color="0.2", lw=0.8, ls="--", label="wanted")
        one.plot(*run.truth.angle[late].T, color="C0", lw=1.1, label="driven")
        one.set(xlabel="pan [deg]", title=f"{period} s a turn", aspect="equal")
    axes[0].set_ylabel("tilt [deg]")
    axes[0].legend(frameon=False)
    return figure


def draw_hopeless(study: HeadStudy) -> Any:
    """Draw runs with impossible targets."""
    figure, axes = new_figure(2, len(IMPOSSIBLE), height=5.0, sharex=True, sharey="row")
    for column, what in enumerate(IMPOSSIBLE):
        run = study.runs[what, DEFAULT]
        axes[0, column].plot(run.t, run.truth.angle[:, 0], color="C0", label="angle")
        axes[0, column].plot(run.t, run.wanted[:, 0], color="0.2", lw=0.8, ls="--", label="target")
        axes[1, column].plot(run.t, run.current[:, 0], color="C1")
        axes[0, column].set_title(what)
        axes[1, column].set_xlabel("time [s]")
        for alarm in run.alarms:
            for row in range(2):
                axes[row, column].axvline(alarm.t, color="C3", lw=1.0)
            words = f"{alarm.verdict.reason},\nafter {alarm.t:.1f} s"
            axes[0, column].text(
                alarm.t + 0.3, 4, words, color="C3", bbox={"fc": "white", "ec": "none", "pad": 1}
            )
        if not run.alarms:
            axes[0, column].text(
                0.5, 45, f"no alarm: in the end it comes\nto {study.reach[what]:.0f} degrees"
            )
    axes[0, 0].set_ylabel("angle [deg]")
    axes[1, 0].set_ylabel("current [A]")
    axes[0, 0].legend(frameon=False, loc="center right")
    return figure


def draw_plan(study: HeadStudy) -> Any:
    """Draw angles and currents of a planned sequence and of the inverse."""
    figure, (upper, lower) = new_figure(2, 1, height=5.0, sharex=True)
    for plan, angle, words, colour in zip(
        study.plan, study.planned, ("planned", "inverse"), ("C0", "C3"), strict=True
    ):
        t = plan.interval * np.arange(1, angle.size + 1)
        upper.plot(t, angle, color=colour, lw=1.2, label=words)
        lower.step(t, np.minimum(plan.current, CURRENT), where="pre", color=colour, lw=1.0)
    upper.plot(t, plan.targets, ".", ms=3, color="0.2", label="targets")
    upper.set(ylabel="angle [deg]")
    upper.legend(frameon=False)
    lower.set(xlabel="time [s]", ylabel="current [A]")
    return figure


def _sensed(study: HeadStudy) -> str:
    """Return for a caption which sensor gives the angles, and of which specimen."""
    return f"Sensor at the joint, seed {study.seed}."


def _listed(values: Sequence[float]) -> str:
    """Return numbers as a list in words."""
    *first, last = (f"{each:g}" for each in values)
    return f"{', '.join(first)} and {last}"


def _to_rounding(rms: float) -> str:
    """Return in words by how much of the range in percent an exact inverse errs."""
    return "is exact to rounding" if rms < _ROUNDING else f"errs by {rms:.2g} %"


def _mean_slope(wire: Any) -> float:
    low, high = wire.operator.range
    return float((high - low) / np.ptp(wire.operator.levels))

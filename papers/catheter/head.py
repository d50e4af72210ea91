"""The catheter head paper, end to end, on the twin.

Boudjabi, Ferreira and Krupa (Modeling and vision-based control of a micro catheter head for
teleoperated in-pipe inspection, IEEE ICRA 2003) identify a Preisach model of a shape-memory wire
from reversal curves, invert it by stepping, and control the head by an internal model around that
inverse. They find that errors in open loop grow with time, and do not treat changing surroundings.
Here the head is identified, driven in open and closed loop by seven controllers, disturbed, and
driven to unreachable targets; then its camera tracks picked points.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.control.controller import Controller
from minorloop_head.control.head import HeadControl, head_control
from minorloop_head.heated_wire import HeatedWire
from minorloop_head.twins.head import Head
from minorloop_head.twins.sensor import SimulatedFault
from minorloop_head.twins.surroundings import Course, Surroundings
from minorloop_head.twins.wire import Wire
from papers.catheter import inspection_servo
from papers.catheter.control.internal_model import InternalModel, robust_margins
from papers.catheter.control.laws import LAWS, slow_pole
from papers.catheter.head_camera import run_camera
from papers.catheter.head_loop import (
    DELAY,
    DISTURBED,
    NOISE,
    TICK,
    HeadRun,
    Reference,
    circle,
    constant,
    controller_figures,
    ramps,
    run_loop,
    stairs,
    step_figures,
)
from papers.catheter.head_ramps import HIGH, LOW, PERIOD, run_ramps
from papers.catheter.head_static import CURRENT, HOLD, run_static
from papers.catheter.scoring import truth
from papers.catheter.sight import gather_sight, run_sight
from papers.catheter.unreachable import CLEARLY, cause_found, true_reach
from papers.harness import Results, mean, medians, rms

DEFAULT, SLOW_POLE = "observer", "slow pole"
TARGETS = (20.0, 30.0, 40.0)
"""Steps in degrees, those of the paper."""
STEP_SECONDS = 30.0
"""Duration of a step: more than twice the allowed time to settle."""
RAMPS_SECONDS = 2 * PERIOD
"""Duration of two of the slow ramps in closed loop."""
RAMP_AT, RAMP_SECONDS = 40.0, 90.0
"""Time of the rise of the ambient, long after the step has settled, and end of that run, in s."""
RAMP = Surroundings(ambient=Course(20.0, 30.0, at=RAMP_AT, duration=10.0))
PERIODS = (60.0, 30.0)
"""Periods in seconds of the circles whose error is limited; all controllers run the faster one."""
FASTER = (20.0, 15.0, 10.0)
"""Shorter periods in seconds, down to where the wires cool too slowly to follow."""
CIRCLE_WAIT = 20.0
"""Wait at the first point of a circle in seconds: longer than the allowed time of a step."""
TURNS = 2
"""Turns of a circle: the first begins from rest, the second shows whether the error stays."""
OPEN_HOLD, OPEN_TARGETS = 25.0, 14
"""Targets in open loop: hold in s, of more than three time constants; and number, by trial."""
IMPOSSIBLE = {
    "flooded, no sleeve": (Surroundings(convection=1000.0), "convection too high"),
    "ambient -10 C": (Surroundings(ambient=-10.0), "ambient too cold"),
}
"""Surroundings in which some specimens reach nearly their whole stroke: the truth decides with
`CLEARLY` whether a target is out of reach."""
IMPOSSIBLE_SECONDS = 20.0
HOT = {
    "little cooling": Surroundings(convection=30.0, ambient=30.0),
    "hot": Surroundings(ambient=60.0),
}
HOT_SECONDS = 15.0
FAULT_AT, FAULT_SECONDS = 12.0, 25.0
OLD, OLD_HOLD, OLD_TARGETS = (DEFAULT, "adaptive"), 12.0, 20
"""Controllers, hold in s and number of targets of a head whose wires have aged."""
LATER, LATER_SECONDS = (1.0, 1.25, 1.5, 1.75, 2.0), 60.0
"""Delays of the sensor over the longest with which the internal model is predicted to be
stable, and duration of these runs in s."""
Key: TypeAlias = tuple[str, str]
"""Names of an experiment and of the controller in it."""
Experiment: TypeAlias = tuple[str, Iterable[str], Reference, float, dict[str, Any]]
"""Its name, those of the controllers, targets, seconds, and options of `run_loop`."""


def run_study(seed: int, told: Callable[[str], None] = lambda part: None) -> Results:
    """Run the whole study on the specimen of a seed.

    ``facts`` are of the nominal twin; ``runs`` all closed and open loops by the name of the
    experiment and the controller; ``reach`` is the true angle under full current, in degrees, in
    runs in other surroundings or with aged wires; ``ramps`` are those of Fig 8 by case; ``sight``
    results of tracking; ``integral`` a point held with the integral of Eq. (10) and without;
    ``camera`` the head without sensors at its joints.
    """
    began = time.perf_counter()
    static = run_static(seed)
    told("identification")
    wires = (static.wires[0].model, static.wires[1].model)
    controls = every_control(wires, static.coupling)
    slow = {SLOW_POLE: head_control(slow_pole, wires, coupling=static.coupling)}
    runs = _run(seed, controls | slow, _experiments(seed, controls | slow))
    surroundings = {what: around for what, (around, _) in IMPOSSIBLE.items()}
    for where, around in DISTURBED.items():
        surroundings |= {f"{where}, step {x:g}": around for x in TARGETS}
    reach = {what: true_reach(seed, around) for what, around in surroundings.items()}
    reach["aged"] = true_reach(seed, ageing=1.0)
    robust = _later_sensors(seed, controls["internal_model"].axes[0].controller)
    told("closed loops")
    driven = run_ramps(seed)
    told("ramps")
    sight = run_sight(seed, controls[DEFAULT])
    told("sight")
    integral = inspection_servo.run_integral(seed)
    told("integral")
    camera = run_camera(seed, static.inputs, static.settled, static.arbitrary)
    told("camera alone")
    facts, closed = head_facts(), runs["ramps", DEFAULT]
    figures = {
        "twin": facts,
        **static.figures(),
        **loop_figures(runs),
        "fig8": {
            **driven["as it is"].figures(),
            **{name: driven[name].figures() for name in ("faster", "body")},
            "closed_deg": rms(closed.error[closed.t > CIRCLE_WAIT, 0]),
        },
        "unreachable": unreachable_figures(runs, reach),
        "limits": {"violations": sum(run.violations for run in (*runs.values(), *camera.runs))},
        "robust": robust,
        "camera": camera.figures(),
        **gather_sight([sight]),
        **integral.figures(),
        "sight": sight,
        "seconds": time.perf_counter() - began,
    }
    return Results(
        figures, seed=seed, facts=facts, static=static, runs=runs, reach=reach, ramps=driven,
        sight=sight, integral=integral, camera=camera,
    )  # fmt: skip


def every_control(
    wires: tuple[HeatedWire, HeatedWire], coupling: FloatArray
) -> dict[str, HeadControl]:
    """Return the control of a head by every law."""
    return {name: head_control(law, wires, coupling=coupling) for name, law in LAWS.items()}


def run_steps(seed: int, controls: Mapping[str, HeadControl]) -> dict[Key, HeadRun]:
    """Run the steps of the paper with every controller, in steady surroundings."""
    every = _experiments(seed, controls)
    return _run(seed, controls, (each for each in every if each[0].startswith("step ")))


def loop_figures(runs: Mapping[Key, HeadRun]) -> dict[str, Any]:
    """Return the figures of steps, staircases, circles and a rising ambient."""

    def steps(name: str, *where: str, targets: Sequence[float] = TARGETS) -> list[HeadRun]:
        return [runs[", ".join((*where, f"step {x:g}")), name] for x in targets]

    def held(what: str) -> dict[str, float]:
        """Return the rms error at the ends of the holds of a staircase, in degrees."""
        hold = round(OPEN_HOLD / TICK)
        return {"rms_deg": rms(runs[what, "feedforward"].error[hold - 1 :: hold, 0])}

    def warmed(name: str) -> float:
        run = runs["ambient ramp", name]
        return float(np.abs(run.error[run.t > RAMP_AT, 0]).max())

    def late(run: HeadRun) -> float:
        """Return the rms error of the second half of a staircase, 4 s after each target."""
        return rms(run.error[(run.t % OLD_HOLD > 4.0) & (run.t > run.t[-1] / 2), 0])

    def circled(period: float, name: str = DEFAULT) -> dict[str, float]:
        """Return the errors of a circle, both axes together."""
        run = runs[f"circle {period:g} s", name]
        distance = np.linalg.norm(run.error[run.t > CIRCLE_WAIT], axis=1)
        return {"rms_deg": rms(distance), "max_deg": float(distance.max())}

    def rival(name: str) -> dict[str, float]:
        disturbed = [run for each in DISTURBED for run in steps(name, each, targets=TARGETS[-1:])]
        return {
            **controller_figures(steps(name), disturbed),
            "ambient_ramp_max_deg": warmed(name),
            "circle_rms_deg": circled(PERIODS[1], name)["rms_deg"],
        }

    own = [run for (_, name), run in runs.items() if name == DEFAULT]
    took = np.concatenate([run.step_seconds[1:] for run in own]) * 1e3
    slow, without = (step_figures(steps(name)) for name in (SLOW_POLE, "internal_model"))
    return {
        "steps": step_figures(steps(DEFAULT)),
        "rivals": {name: rival(name) for name in LAWS},
        "steps_disturbed": step_figures(
            [run for each in DISTURBED for run in steps(DEFAULT, each)]
        ),
        "fig9": {**slow, "ratio": slow["settle_s"] / without["settle_s"]},
        "open_loop": held("stairs"),
        "open_loop_plus_10K": held("stairs, warmer"),
        "ambient_ramp": {"max_deg": warmed(DEFAULT)},
        "aged": {f"{name}_rms_deg": late(runs["aged", name]) for name in OLD},
        "realtime": {
            "step_ms_median": float(np.median(took)),
            "step_ms_p999": float(np.quantile(took, 0.999)),
        },
        **{f"circle_{period:g}s": circled(period) for period in (*PERIODS, *FASTER)},
    }


def unreachable_figures(
    runs: Mapping[Key, HeadRun], reaches: Mapping[str, float]
) -> dict[str, Any]:
    """Return the number of given up targets out of reach, with times and reasons; false alarms."""
    found, causes, false = [], [], 0
    for (what, _), run in runs.items():
        reach = reaches.get(what, np.inf)
        alarms = [alarm for alarm in run.alarms if alarm.axis == 0]
        if what in IMPOSSIBLE and run.wanted[-1, 0] - reach > CLEARLY:
            found.append(alarms[0].t if alarms else np.inf)
            causes += [cause_found(each.verdict, IMPOSSIBLE[what][1]) for each in alarms[:1]]
        false += sum(alarm.verdict.reference <= reach for alarm in alarms)
        false += len(run.alarms) - len(alarms)
    return {
        "cases": len(found),
        "detected": bool(np.isfinite(found).all()),
        "after_s": max(found),
        "cause_right": float(np.mean([right for right in causes if right is not None])),
        "cause_open": float(np.mean([right is None for right in causes])),
        "false_alarms": false,
    }


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return medians over specimens, but sums of violations and of false alarms.

    For targets out of reach it is the share of specimens in which all were found. Results of the
    camera are scored over all points and pictures.
    """
    found = medians([{k: v for k, v in run.items() if k != "sight"} for run in runs])
    found |= gather_sight([run["sight"] for run in runs])
    found["unreachable"]["detected"] = mean([run["unreachable"]["detected"] for run in runs])
    right = [run["unreachable"]["cause_right"] for run in runs]
    found["unreachable"]["cause_right"] = float(np.nanmean(right))
    found["unreachable"]["after_max_s"] = max(run["unreachable"]["after_s"] for run in runs)
    for part, key in (("unreachable", "false_alarms"), ("limits", "violations")):
        found[part][key] = sum(run[part][key] for run in runs)
    return found


def head_facts() -> dict[str, float]:
    """Return angle and times to 63 % of the nominal wire at 0.4 A."""
    wire = Wire(log_truth=True)
    interval = 0.05
    up = wire.apply(CURRENT, 2 * HOLD, interval)
    down = wire.apply(0.0, 2 * HOLD, interval)
    full = float(up.y[-1])
    return {
        "angle_at_400mA_deg": full,
        "heat_t63_s": float(np.argmax(up.y >= 0.63 * full) + 1) * interval,
        "cool_t63_s": float(np.argmax(down.y <= 0.37 * full) + 1) * interval,
        "hottest_C": float(truth(wire).hottest[0]),
        "stress_MPa": float(truth(wire).stress[0]) / 1e6,
    }


def _run(
    seed: int, controls: Mapping[str, HeadControl], experiments: Iterable[Experiment]
) -> dict[Key, HeadRun]:
    """Run experiments on one specimen."""
    return {
        (what, name): run_loop(controls[name], way, seconds, specimen=seed, seed=seed, **options)
        for what, names, way, seconds, options in experiments
        for name in names
    }


def _experiments(seed: int, controls: Mapping[str, HeadControl]) -> Iterator[Experiment]:
    """Yield the experiments of a specimen; the internal model with the paper's G(s) only steps."""
    laws = [name for name in controls if name != SLOW_POLE]
    for target in TARGETS:
        way = constant(target)
        yield f"step {target:g}", controls, way, STEP_SECONDS, {}
        for where, around in DISTURBED.items():
            own = laws if target == TARGETS[-1] else [DEFAULT]
            options = {"surroundings": around}
            yield f"{where}, step {target:g}", own, way, STEP_SECONDS, options
    # Nearly all of the identified stroke of both axes, in degrees.
    pan, tilt = (0.95 * axis.observer.wire.operator.range[1] for axis in controls[DEFAULT].axes)
    rng = np.random.default_rng([seed, 8])
    targets = np.minimum(rng.uniform(5.0, 50.0, OPEN_TARGETS), pan).tolist()
    old = stairs(rng.uniform(10.0, 45.0, OLD_TARGETS).tolist(), OLD_HOLD)
    yield "aged", OLD, old, OLD_HOLD * OLD_TARGETS, {"ageing": 1.0}
    warmer = {"surroundings": Surroundings(ambient=30.0)}
    for what, options in (("stairs", {}), ("stairs, warmer", warmer)):
        way, span = stairs(targets, OPEN_HOLD), OPEN_HOLD * OPEN_TARGETS
        yield what, ["feedforward"], way, span, options
    yield "ramps", [DEFAULT], ramps(LOW, HIGH, PERIOD), RAMPS_SECONDS, {}
    yield "ambient ramp", laws, constant(30.0), RAMP_SECONDS, {"surroundings": RAMP}
    for period in (*PERIODS, *FASTER):
        own, way = laws if period == PERIODS[1] else [DEFAULT], circle(period, before=CIRCLE_WAIT)
        yield f"circle {period:g} s", own, way, CIRCLE_WAIT + TURNS * period, {}
    for kind in ("stuck", "lost"):
        faults = [SimulatedFault("pan", kind, FAULT_AT), SimulatedFault("tilt", kind, 2.0)]
        yield f"sensor {kind}", laws, constant(40.0, 40.0), FAULT_SECONDS, {"faults": faults}
    for what, around in HOT.items():
        yield what, laws, constant(pan, tilt), HOT_SECONDS, {"surroundings": around}
    for what, (around, _) in IMPOSSIBLE.items():
        closed = [name for name in laws if name != "feedforward"]
        yield what, closed, constant(pan), IMPOSSIBLE_SECONDS, {"surroundings": around}


def _later_sensors(seed: int, law: Controller | None) -> dict[str, float]:
    """Drive a wire by the internal model with sensors of a longer delay than that of the model.

    It has no guard, which would detect late readings. Returns the predicted edges of stability, and
    the longest delay in s with a stable loop. A loop is unstable if its angle moves by more than 2
    degrees in the last 15 s. A stable one moves by less, and beyond the edge by ten.
    """
    assert isinstance(law, InternalModel)
    edges = robust_margins(law)
    predicted, measured = DELAY + edges.delay, DELAY
    for share in LATER:
        head = Head(seed, NOISE, seed, tick=TICK, delay=share * predicted, log_truth=True)
        state, read = law.begin(), 0.0
        for _ in range(round(LATER_SECONDS / TICK)):
            current, state = law.step(state, 30.0, read)
            read = float(np.asarray(head.exchange(np.array([current, 0.0])))[0])
        end = np.asarray(truth(head).angle)[-round(15.0 / TICK) :, 0]
        if np.ptp(end) > 2.0:
            break
        measured = share * predicted
    return {
        "predicted_edge": predicted,
        "measured_edge": measured,
        "measured_ratio": measured / predicted,
        "gain": edges.gain,
        "lag": edges.lag,
    }

"""The catheter head paper, end to end, on the twin.

Boudjabi, Ferreira and Krupa (Modeling and vision-based control of a micro catheter head for
teleoperated in-pipe inspection, IEEE ICRA 2003) identify a Preisach model of a shape-memory wire
from reversal curves, invert it by stepping, and control the head by an internal model around that
inverse. They find that open loop errs more and more, and leave changing surroundings open. Here
the head is identified, driven in open and closed loop by seven controllers, disturbed, and given
targets that it cannot reach; then its camera tracks what was picked.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, product
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
from papers.catheter.control.internal_model import InternalModel
from papers.catheter.control.laws import LAWS, slow_pole
from papers.catheter.control.robustness import robust_margins
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
from papers.catheter.head_ramps import HIGH, LOW, PERIOD, ramp_figures, run_ramps
from papers.catheter.head_static import CURRENT, HOLD, run_static
from papers.catheter.scoring import truth
from papers.catheter.sight import gather_sight, run_sight
from papers.catheter.unreachable import CLEARLY, cause_found, true_reach
from papers.harness import Results, mean, medians, rms

DEFAULT, SLOW_POLE = "observer", "slow pole"
TARGETS = (20.0, 30.0, 40.0)
"""Steps in degrees, those of the paper."""
STEP_SECONDS = 30.0
"""Duration of a step: more than twice as long as it may take to settle."""
WARMER = Surroundings(ambient=30.0)
RAMPS_SECONDS = 2 * PERIOD
"""Duration of two of the slow ramps in closed loop."""
RAMP_AT, RAMP_SECONDS = 40.0, 90.0
"""Time of the rise of the ambient, long after the step has settled, and end of that run, in s."""
RAMP = Surroundings(ambient=Course(20.0, 30.0, at=RAMP_AT, duration=10.0))
RAMP_TARGET = 30.0
"""Target in degrees while the ambient rises: the middle one of `TARGETS`."""
PERIODS = (60.0, 30.0)
"""Periods in seconds of the circles whose error is limited."""
FASTER = (20.0, 15.0, 10.0)
"""Shorter periods in seconds, down to where the wires cool too slowly to follow."""
RIVALS_CIRCLE = f"circle {PERIODS[1]:g} s"
"""The circle of all controllers, the faster one whose error is limited."""
CIRCLE_WAIT = 20.0
"""Wait at the first point of a circle in seconds: longer than a step may take to settle."""
TURNS = 2
"""Turns of a circle: the first begins from rest, the second shows whether the error stays."""
OPEN_HOLD, OPEN_TARGETS, OPEN_RANGE = 25.0, 14, (5.0, 50.0)
"""Targets in open loop: hold in s, of more than three time constants; how many, by trial; and range
in degrees. Those beyond `STROKE_SHARE` of a specimen's identified stroke are put there."""
IMPOSSIBLE = {
    "flooded, no sleeve": (Surroundings(convection=1000.0), "convection too high"),
    "ambient -10 C": (Surroundings(ambient=-10.0), "ambient too cold"),
}
STROKE_SHARE, IMPOSSIBLE_SECONDS = 0.95, 20.0
"""Target then, as a share of the identified stroke. Some specimens reach it in the cold: the truth
decides whether it is out of reach, by `CLEARLY`."""
HOT = {
    "little cooling": Surroundings(convection=30.0, ambient=30.0),
    "hot": Surroundings(ambient=60.0),
}
HOT_SECONDS = 15.0
FAULT_AT, FAULT_SECONDS = 12.0, 25.0
OLD_HOLD, OLD_TARGETS, OLD_RANGE, OLD_WAIT = 12.0, 20, (10.0, 45.0), 4.0
"""Targets for a head whose wires have aged since it was identified: s, how many, degrees, s."""
OLD = (DEFAULT, "adaptive")
LATER = (1.0, 1.25, 1.5, 1.75, 2.0)
"""Delays of the sensor over the longest with which the internal model is predicted to be
stable."""
LATER_TARGET, LATER_SECONDS, LATER_END, OSCILLATES = 30.0, 60.0, 15.0, 2.0
"""Target in degrees and duration of these runs in s; a loop is unstable if the angle still moves by
so many degrees in the last seconds. A stable one moves by less, and beyond the edge by ten."""
Key: TypeAlias = tuple[str, str]
"""Names of an experiment and of the controller in it."""
Experiment: TypeAlias = tuple[str, str, Reference, float, dict[str, Any]]
"""Its name, that of the controller, targets, seconds, and options of `run_loop`."""


def run_study(seed: int, told: Callable[[str], None] = lambda part: None) -> Results:
    """Run the whole study on the specimen of a seed.

    ``facts`` are of the nominal twin; ``runs`` all closed and open loops by the name of the
    experiment and the controller; ``reach`` is the true angle under full current, in degrees, in
    those in other surroundings or with aged wires; ``ramps`` are those of Fig 8 by case; ``sight``
    what its camera tracks; ``integral`` a point held with the integral of Eq. (10) and without;
    ``camera`` the head without sensors at its joints.
    """
    began = time.perf_counter()
    static = run_static(seed)
    told("identification")
    wires = (static.wires[0].model, static.wires[1].model)
    controls = every_control(wires, static.coupling)
    slow = {SLOW_POLE: head_control(slow_pole, wires, coupling=static.coupling)}
    tried = chain(_fig_9(), _steps(controls), _others(seed, controls), _hard(controls))
    runs, reach = _run(seed, controls | slow, tried), _reaches(seed)
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
    facts = head_facts()
    figures = {
        "twin": facts,
        **static.figures(),
        **loop_figures(runs),
        "fig8": {**ramp_figures(driven), "closed_deg": _closed_ramps(runs)},
        "unreachable": unreachable_figures(runs, reach),
        "limits": _limits(runs, camera.runs),
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
    return _run(seed, controls, (each for each in _steps(controls) if not each[-1]))


def loop_figures(runs: Mapping[Key, HeadRun]) -> dict[str, Any]:
    """Return the figures of steps, staircases, circles and a rising ambient."""
    disturbed = [f"{where}, step {x:g}" for where in DISTURBED for x in TARGETS]
    own = [run for (_, name), run in runs.items() if name == DEFAULT]
    took = np.concatenate([run.step_seconds[1:] for run in own]) * 1e3
    found: dict[str, Any] = {
        "steps": step_figures([runs[f"step {x:g}", DEFAULT] for x in TARGETS]),
        "rivals": {name: _rival(runs, name) for name in LAWS},
        "steps_disturbed": step_figures([runs[each, DEFAULT] for each in disturbed]),
        "fig9": _slow_pole_figures(runs),
        "open_loop": {"rms_deg": _settled_rms(runs["stairs", "feedforward"])},
        "open_loop_plus_10K": {"rms_deg": _settled_rms(runs["stairs, warmer", "feedforward"])},
        "ambient_ramp": {"max_deg": _ramp_worst(runs["ambient ramp", DEFAULT])},
        "aged": {f"{name}_rms_deg": _late_rms(runs["aged", name]) for name in OLD},
        "realtime": {
            "step_ms_median": float(np.median(took)),
            "step_ms_p999": float(np.quantile(took, 0.999)),
        },
    }
    for period in (*PERIODS, *FASTER):
        found[f"circle_{period:g}s"] = _round(runs[f"circle {period:g} s", DEFAULT])
    return found


def _slow_pole_figures(runs: Mapping[Key, HeadRun]) -> dict[str, float]:
    """Return the steps of the internal model with G(s), and settling over that without."""
    with_it, without = (
        step_figures([runs[f"step {x:g}", name] for x in TARGETS])
        for name in (SLOW_POLE, "internal_model")
    )
    return {**with_it, "ratio": with_it["settle_s"] / without["settle_s"]}


def _rival(runs: Mapping[Key, HeadRun], name: str) -> dict[str, float]:
    """Return the figures of one controller; each ran the same steps and disturbances."""
    steps = [runs[f"step {x:g}", name] for x in TARGETS]
    disturbed = [runs[f"{where}, step {TARGETS[-1]:g}", name] for where in DISTURBED]
    return {
        **controller_figures(steps, disturbed),
        "ambient_ramp_max_deg": _ramp_worst(runs["ambient ramp", name]),
        "circle_rms_deg": _round(runs[RIVALS_CIRCLE, name])["rms_deg"],
    }


def _closed_ramps(runs: Mapping[Key, HeadRun]) -> float:
    """Return the rms error of the ramps in closed loop, in degrees."""
    run = runs["ramps", DEFAULT]
    return rms(run.error[run.t > CIRCLE_WAIT, 0])


def unreachable_figures(
    runs: Mapping[Key, HeadRun], reaches: Mapping[str, float]
) -> dict[str, Any]:
    """Return how many targets out of reach were given up, when and why, and the false alarms."""
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


def _limits(runs: Mapping[Key, HeadRun], by_camera: Iterable[HeadRun]) -> dict[str, float]:
    return {
        "violations": sum(run.violations for run in (*runs.values(), *by_camera)),
        "hottest_C": max(float(run.truth.hottest.max()) for run in runs.values()),
        "stress_MPa": max(float(run.truth.stress.max()) for run in runs.values()) / 1e6,
    }


def _reaches(seed: int) -> dict[str, float]:
    """Return the true reach in degrees, by its name, in each run in other surroundings or aged."""
    found = {what: true_reach(seed, around) for what, (around, _) in IMPOSSIBLE.items()}
    found["aged"] = true_reach(seed, ageing=1.0)
    for where, around in DISTURBED.items():
        reach = true_reach(seed, around)
        found |= {f"{where}, step {x:g}": reach for x in TARGETS}
    return found


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return medians over specimens, but sums of violations and of false alarms.

    Of the targets out of reach it is the share of specimens in which all of them were found. What
    the camera sees is scored over all points and pictures.
    """
    found = medians([{k: v for k, v in run.items() if k != "sight"} for run in runs])
    found |= gather_sight([run["sight"] for run in runs])
    found["unreachable"]["detected"] = mean([run["unreachable"]["detected"] for run in runs])
    right = [run["unreachable"]["cause_right"] for run in runs]
    found["unreachable"]["cause_right"] = float(np.nanmean(right))
    found["unreachable"]["after_max_s"] = max(run["unreachable"]["after_s"] for run in runs)
    for part, key in (("unreachable", "false_alarms"), ("limits", "violations")):
        found[part][key] = sum(run[part][key] for run in runs)
    found["limits"]["hottest_C"] = max(run["limits"]["hottest_C"] for run in runs)
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
        (what, name): run_loop(
            name, controls[name], way, seconds, specimen=seed, seed=seed, **options
        )
        for what, name, way, seconds, options in experiments
    }


def _steps(controls: Iterable[str]) -> Iterator[Experiment]:
    """Yield steps with every controller, and the highest one in other surroundings."""
    for target in TARGETS:
        way = constant(target)
        for name in controls:
            yield f"step {target:g}", name, way, STEP_SECONDS, {}
        others = controls if target == TARGETS[-1] else (DEFAULT,)
        for (where, around), name in product(DISTURBED.items(), others):
            what = f"{where}, step {target:g}"
            yield what, name, way, STEP_SECONDS, {"surroundings": around}


def _fig_9() -> Iterator[Experiment]:
    """Yield the steps by the internal model with the paper's G(s)."""
    for target in TARGETS:
        yield f"step {target:g}", SLOW_POLE, constant(target), STEP_SECONDS, {}


def _others(seed: int, controls: Mapping[str, HeadControl]) -> Iterator[Experiment]:
    """Yield aged wires, open loop, slow ramps, a rising ambient, and circles."""
    rng = np.random.default_rng([seed, 8])
    targets = rng.uniform(*OPEN_RANGE, OPEN_TARGETS)
    targets = np.minimum(targets, _nearly_all(controls[DEFAULT])[0]).tolist()
    old = stairs(rng.uniform(*OLD_RANGE, OLD_TARGETS).tolist(), OLD_HOLD)
    for name in OLD:
        yield "aged", name, old, OLD_HOLD * OLD_TARGETS, {"ageing": 1.0}
    way, span = stairs(targets, OPEN_HOLD), OPEN_HOLD * OPEN_TARGETS
    yield "stairs", "feedforward", way, span, {}
    yield "stairs, warmer", "feedforward", way, span, {"surroundings": WARMER}
    yield "ramps", DEFAULT, ramps(LOW, HIGH, PERIOD), RAMPS_SECONDS, {}
    for name in controls:
        way = constant(RAMP_TARGET)
        yield "ambient ramp", name, way, RAMP_SECONDS, {"surroundings": RAMP}
        for period in (*PERIODS, *FASTER):
            what, span = f"circle {period:g} s", CIRCLE_WAIT + TURNS * period
            if name == DEFAULT or what == RIVALS_CIRCLE:
                yield what, name, circle(period, before=CIRCLE_WAIT), span, {}


def _hard(controls: Mapping[str, HeadControl]) -> Iterator[Experiment]:
    """Yield little cooling, faulty sensors and impossible targets with every controller."""
    for name, control in controls.items():
        for kind in ("stuck", "lost"):
            faults = [SimulatedFault("pan", kind, FAULT_AT), SimulatedFault("tilt", kind, 2.0)]
            way = constant(40.0, 40.0)
            yield f"sensor {kind}", name, way, FAULT_SECONDS, {"faults": faults}
        pan, tilt = _nearly_all(control)
        for what, around in HOT.items():
            yield what, name, constant(pan, tilt), HOT_SECONDS, {"surroundings": around}
        if name == "feedforward":
            continue
        for what, (around, _) in IMPOSSIBLE.items():
            yield what, name, constant(pan), IMPOSSIBLE_SECONDS, {"surroundings": around}


def _nearly_all(control: HeadControl) -> list[float]:
    """Return `STROKE_SHARE` of the identified stroke of both axes, in degrees."""
    return [STROKE_SHARE * axis.observer.wire.operator.range[1] for axis in control.axes]


def _later_sensors(seed: int, law: Controller | None) -> dict[str, float]:
    """Drive a wire by the internal model with sensors that are later than it knows.

    It has no guard, which would find such readings late. Returns the predicted edges of stability,
    and the longest delay in s up to which the loop is stable.
    """
    assert isinstance(law, InternalModel)
    edges = robust_margins(law)
    predicted, measured = DELAY + edges.delay, DELAY
    for share in LATER:
        head = Head(seed, NOISE, seed, tick=TICK, delay=share * predicted, log_truth=True)
        state, read = law.begin(), 0.0
        for _ in range(round(LATER_SECONDS / TICK)):
            current, state = law.step(state, LATER_TARGET, read)
            read = float(np.asarray(head.exchange(np.array([current, 0.0])))[0])
        end = np.asarray(truth(head).angle)[-round(LATER_END / TICK) :, 0]
        if np.ptp(end) > OSCILLATES:
            break
        measured = share * predicted
    return {
        "predicted_edge": predicted,
        "measured_edge": measured,
        "measured_ratio": measured / predicted,
        "gain": edges.gain,
        "lag": edges.lag,
    }


def _settled_rms(run: HeadRun) -> float:
    """Return the rms error at the ends of the holds of a staircase, in degrees."""
    hold = round(OPEN_HOLD / TICK)
    return rms(run.error[hold - 1 :: hold, 0])


def _late_rms(run: HeadRun) -> float:
    """Return the rms error of the second half of a staircase, 4 s after each target, in degrees."""
    late = (run.t % OLD_HOLD > OLD_WAIT) & (run.t > run.t[-1] / 2)
    return rms(run.error[late, 0])


def _ramp_worst(run: HeadRun) -> float:
    return float(np.abs(run.error[run.t > RAMP_AT, 0]).max())


def _round(run: HeadRun) -> dict[str, float]:
    """Return the errors of a circle, both axes together."""
    distance = np.linalg.norm(run.error[run.t > CIRCLE_WAIT], axis=1)
    return {"rms_deg": rms(distance), "max_deg": float(distance.max())}

"""Targets about the reach of a wire, in surroundings drawn for each specimen.

Each head is identified, and driven to targets a little beyond its true reach and a little within
it, in surroundings that are too cold or that cool too much.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from minorloop_head.control.head import head_control
from minorloop_head.control.reach import STROKE_SHARE, Reason, Unreachable
from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import Surroundings
from papers.catheter.head_loop import constant, run_loop
from papers.catheter.head_static import CURRENT, HOLD, identify_head
from papers.catheter.scoring import truth
from papers.harness import Results, Study, mean, median

BOTH: Reason = "colder surroundings or stronger cooling"
"""Reason of the guard if the readings do not distinguish the two causes."""
CLEARLY = 5.0
"""Least distance out of reach in degrees at which a target must be found."""


def run_study(seed: int) -> dict[str, Any]:
    """Run the targets of one specimen; the seed draws noise, surroundings and targets too.

    Each of the ``cases`` has the true ``cause``; ``short``, the distance of the target out of
    ``reach``, both in degrees; the first ``alarm`` of the axis; and the number of those of the
    ``others``.

    The ambient, and the convection, of which still air has 75 W/(m^2 K), are such that the reach
    falls between the ends of the stroke. A target is up to 8 degrees beyond it, about `CLEARLY`, or
    up to 3 within it, about the tolerance of the guard, 1 degree. A run takes 30 s: the slowest
    verdict, in the cold, takes 29 s.
    """
    began = time.perf_counter()
    wires, coupling = identify_head(seed)
    control = head_control("observer", wires, coupling=coupling)
    rng = np.random.default_rng([seed, 13])
    top = STROKE_SHARE * wires[0].operator.range[1]
    colder = Surroundings(ambient=float(rng.uniform(-20.0, -8.0)))
    cooled = Surroundings(convection=75.0 * float(rng.uniform(1.4, 2.0)))
    drawn: list[tuple[Reason, Surroundings]] = [
        ("ambient too cold", colder),
        ("convection too high", cooled),
    ]
    cases = []
    for cause, around in drawn:
        reach = true_reach(seed, around)
        for off in (rng.uniform(1.5, 8.0), -rng.uniform(0.5, 3.0)):
            target = min(reach + float(off), top)
            options: dict[str, Any] = {"specimen": seed, "seed": seed, "surroundings": around}
            run = run_loop(control, constant(target), 30.0, **options)
            own = [alarm for alarm in run.alarms if alarm.axis == 0]
            said: dict[str, Any] = {
                "alarm": own[0] if own else None,
                "others": len(run.alarms) - len(own),
            }
            cases.append(Results(cause=cause, short=target - reach, reach=reach, **said))
    return {"cases": tuple(cases), "seconds": time.perf_counter() - began}


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return counts and shares over the cases of all specimens."""
    cases = [case for run in runs for case in run["cases"]]
    clear = [case for case in cases if case.short > CLEARLY]
    near = [case for case in cases if 0.0 < case.short <= CLEARLY]
    within = [case for case in cases if case.short <= 0.0]
    said = [(case, case.alarm) for case in (*clear, *near) if case.alarm is not None]
    causes = [cause_found(alarm.verdict, case.cause) for case, alarm in said]
    return {
        "unreachable": {
            "cases": len(clear),
            "detected": mean([case.alarm is not None for case in clear]),
            "after_max_s": max((c.alarm.t for c in clear if c.alarm is not None), default=np.nan),
            "near_cases": len(near),
            "near_detected": mean([case.alarm is not None for case in near]),
            "reachable_cases": len(within),
            "false_alarms": sum(case.alarm is not None for case in within)
            + sum(case.others for case in cases),
            "given_up": len(said),
            "cause_right": mean([right for right in causes if right is not None]),
            "cause_open": mean([right is None for right in causes]),
            # To the noise of a reading.
            "within_band": mean(
                [
                    alarm.verdict.least - 0.3 <= case.reach <= alarm.verdict.most + 0.3
                    for case, alarm in said
                ]
            ),
        },
        "seconds": median([run["seconds"] for run in runs]),
    }


def cause_found(verdict: Unreachable, cause: str) -> bool | None:
    """Return whether a verdict names a cause; None if it leaves two causes open."""
    return None if verdict.reason == BOTH else verdict.reason == cause


def true_reach(
    seed: int, surroundings: Surroundings | None = None, *, ageing: float = 0.0
) -> float:
    """Return the true angle of the first axis under full current, in degrees."""
    head = Head(seed, surroundings=surroundings, ageing=ageing, log_truth=True)
    head.apply(np.array([CURRENT, 0.0]), 4 * HOLD, HOLD)
    return float(truth(head).angle[-1, 0])


STUDY = Study("unreachable", "Targets about the reach of a head", run_study, gather)

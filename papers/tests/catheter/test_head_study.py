import re
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from minorloop_head.control.heating import identify_coupling
from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import Course, Surroundings
from minorloop_head.vision import wall_refinement
from papers.catheter import (
    head,
    head_camera,
    head_report,
    head_static,
    inspection_servo,
    sight,
    tracking_trials,
)
from papers.catheter.head_loop import constant, run_loop
from papers.catheter.inspection_servo import integral_results
from papers.catheter.picture_sensor import PictureSensor
from papers.harness import Results
from servo_runs import held_points


@pytest.fixture(scope="module")
def study():
    """The study on one specimen, with fewer targets and surroundings, and shorter runs."""
    ramp = Surroundings(ambient=Course(20.0, 30.0, at=10.0, duration=10.0))
    shorter = {
        "OPEN_TARGETS": 2, "OLD_TARGETS": 2, "FASTER": (), "STEP_SECONDS": 16.0,
        "FAULT_AT": 6.0, "FAULT_SECONDS": 9.0, "RAMPS_SECONDS": 40.0,
        "RAMP_SECONDS": 22.0, "RAMP_AT": 10.0, "RAMP": ramp,
        "LATER": (1.0,), "LATER_SECONDS": 40.0, "CIRCLE_WAIT": 8.0, "TURNS": 0.5,
        "IMPOSSIBLE_SECONDS": 11.0, "HOT_SECONDS": 10.0, "TARGETS": (20.0, 40.0),
        "DISTURBED": {"ambient 10 C": head.DISTURBED["ambient 10 C"]},
        "HOT": {"hot": head.HOT["hot"]},
    }  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        for name, value in shorter.items():
            patch.setattr(head, name, value)
        for name in ("DISTURBED", "RAMP_AT", "TARGETS"):
            patch.setattr(head_report, name, shorter[name])
        # The wires of one specimen are the same for its control, its sight and its camera.
        patch.setattr(head_static, "_wire", cache(head_static._wire))
        patch.setattr(wall_refinement, "_ROUNDS", 1)
        walls = {name: tracking_trials.WALLS[name] for name in ("drawn", "repeated")}
        patch.setattr(tracking_trials, "WALLS", walls)
        patch.setattr(tracking_trials, "FRAMES", 16)
        patch.setattr(sight, "ATTITUDE_SECONDS", 3.0)
        by_camera = {
            "LAWS": ("observer", "internal_model"), "STEPS": (20.0,), "STEP_SECONDS": 10.0,
            "WAIT": 4.0, "identify_seen": seen_wires,
            "run_circle": circled,
        }  # fmt: skip
        for name, value in by_camera.items():
            patch.setattr(head_camera, name, value)
        patch.setattr(
            inspection_servo, "run_integral", lambda seed: integral_results(held_points())
        )
        yield head.run_study(1)


def seen_wires(seed):
    """Wires identified by sensors, which takes less time than pictures."""
    found, moves = zip(*(head_static._wire(seed, axis) for axis in range(2)), strict=True)
    view = PictureSensor(Head(seed), seed).survey()
    wires, coupling = [one.model for one in found], identify_coupling(moves)
    return Results(wires=wires, coupling=coupling, view=view)


def circled(seed, control, circle, camera):
    """A circle that is not driven."""
    run = run_loop(control, constant(0.0), 0.2, specimen=seed, seed=seed)
    around = np.stack([4 * np.cos(run.t), 4 * np.sin(run.t)], axis=1)
    return Results(t=run.t, wanted=around, reached=around + 0.1, rms=0.1 * 2**0.5, run=run)


@pytest.fixture(scope="module")
def figures(study):
    return head.gather([study.figures()])


def test_an_alarm_is_false_only_where_the_target_is_within_the_true_reach():
    what = next(iter(head.IMPOSSIBLE))
    alarm = SimpleNamespace(axis=0, t=9.0, verdict=SimpleNamespace(reason="", reference=40.0))
    run = lambda *alarms: SimpleNamespace(wanted=np.array([[40.0, 0.0]]), alarms=alarms)  # noqa: E731
    runs = {
        (what, "observer"): run(alarm),
        ("convection 90, step 40", "observer"): run(alarm),
        ("convection 65, step 40", "observer"): run(alarm),
        ("step 40", "observer"): run(alarm),
        ("aged", "observer"): SimpleNamespace(wanted=np.array([[20.0, 0.0]]), alarms=(alarm,)),
    }
    reach = {what: 30.0, "convection 90, step 40": 37.6, "convection 65, step 40": 42.0, "aged": 39}
    found = head.unreachable_figures(runs, reach)
    assert (found["cases"], found["false_alarms"]) == (1, 2)
    assert found["after_s"] == 9.0


@pytest.mark.whole
@pytest.mark.usefixtures("without_pictures")
def test_the_report_has_every_figure(study, figures):
    page = head_report.STUDY.report(study, figures, [figures, figures]).html()
    order = [page.index(f"<h2>Fig {number}") for number in (*range(2, 13), 14)]
    assert order == sorted(order)
    assert page.count("<img") >= 11
    for said in ("20 to 25 mm across", "no bound is set"):
        assert said in page
    assert not re.search(r"<td[^>]*>(nan|inf)</td>", page)


class Full:
    """A control that always gives full current, whatever is read."""

    def begin(self):
        quiet = SimpleNamespace(unreachable=None)
        return SimpleNamespace(axes=(quiet, quiet), log=())

    def step(self, state, wanted, y, *, t):
        return np.array([0.4, 0.4]), state


def test_a_wire_that_gets_too_hot_is_counted():
    hot = Surroundings(ambient=90.0)
    run = run_loop(Full(), constant(30.0), 60.0, specimen=None, seed=0, surroundings=hot)
    assert run.truth.hottest.max() > 150.0
    assert run.violations == 2
    assert run.settle == np.inf
    assert run.overshoot > 50.0
    assert run.steady > 25.0

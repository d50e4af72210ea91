import math
from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.control.head import head_control
from minorloop_head.control.observer import PowerObserver
from minorloop_head.control.reach import ReachState, ReachWatch, Trial, Unreachable
from minorloop_head.twins.surroundings import Surroundings
from minorloop_head.twins.wire import Wire
from papers.catheter.head_loop import constant, run_loop
from wires import TICK, angle, identified, identified_head, made_up


def watched(
    reference, *, ambient=20.0, cooling=1.0, seconds=15.0, stuck=False, specimen=None, wire=None
):
    """Verdict on a cold twin that is heated fully, and the time of the first one."""
    wire = wire or identified().model
    watch, observer = ReachWatch(wire=wire), PowerObserver(wire=wire)
    around = Surroundings(ambient=ambient, convection=75.0 * cooling)
    plant = Wire(specimen, noise=0.05, seed=1, surroundings=around)
    state, estimate, rng = ReachState(), observer.found(), np.random.default_rng(0)
    seen = angle(plant)
    for k in range(round(seconds / TICK)):
        current = 0.4 if stuck or angle(plant) < reference else 0.0
        reading = 0.05 * rng.normal() if stuck else seen
        seen = plant.exchange(current)
        estimate = observer.update(estimate, current, reading)
        state = watch.step(state, reference, reading, current, estimate)
        if state.verdict is not None:
            return state.verdict, TICK * (k + 1)
    return None, math.inf


def test_a_target_that_is_a_little_out_of_reach_is_found_while_the_wire_still_moves():
    verdict, _ = watched(29.2, ambient=-16.0, seconds=30.0)
    assert verdict.reason == "ambient too cold"
    assert verdict.least < 22.0 < 24.7 < verdict.most  # It ends at 24.7 degrees.


@pytest.mark.whole
def test_a_cold_head_whose_identified_branch_rises_too_late_is_not_given_up():
    # Its holds ended 3.5 degrees short where it turns most; it reaches 43.4 degrees in the end.
    wires, coupling = identified_head(95544)
    run = run_loop(
        head_control("observer", wires, coupling=coupling),
        constant(42.83),
        25.0,
        specimen=95544,
        seed=95544,
        surroundings=Surroundings(ambient=-17.7527),
    )
    assert run.alarms == ()


def test_a_wire_that_no_hypothesis_explains_is_not_given_up_while_it_turns():
    wire = identified().model
    watch, observer = ReachWatch(wire=wire), PowerObserver(wire=wire)
    end, state, estimate = 0.95 * wire.operator.range[1], ReachState(), observer.found()
    for k in range(round(6.0 / TICK)):
        # It is hot from the start, and slower towards its end.
        reading = end * np.interp(k * TICK, (0.0, 1.0, 2.0, 3.0, 6.0), (0.0, 0.28, 0.54, 0.77, 1.0))
        estimate = observer.update(estimate, 0.4, reading)
        state = watch.step(state, end, reading, 0.4, estimate)
        assert state.verdict is None


def test_weight_on_wires_that_never_turn_is_no_evidence_until_one_turns():
    watch = ReachWatch(wire=made_up())
    bank = watch._hypotheses.begin(PowerObserver(wire=made_up()).found(), moving=False)
    trial = Trial(bank, 0.0, 0.0, seconds=9.6, full=9.6)
    final = watch._hypotheses.final(bank, 0.0, watch.highest)
    contradicted = np.where(final > 15.0, 20.0, 0.0)
    assert watch._verdict(replace(trial, bank=replace(bank, cost=contradicted)), 20.0, 0.0)
    bank = replace(bank, cost=np.where((final > 17.5) & (final < 17.8), 0.0, contradicted))
    assert watch._hypotheses.weights(bank)[final > 15.0].sum() < 1.0 - watch.certainty
    assert watch._verdict(replace(trial, bank=bank), 20.0, 0.0) is None


def test_both_causes_are_named_where_readings_do_not_tell_them_apart():
    watch = ReachWatch(wire=made_up())
    bank = watch._hypotheses.begin(PowerObserver(wire=made_up()).found(), moving=False)
    trial = Trial(bank, 0.0, 0.0, seconds=9.6)
    colder = watch._hypotheses.colder == 1
    alike = np.where(colder, 1.0 / colder.sum(), 1.0 / (~colder).sum())
    assert watch._reason(trial, alike, 0.0, late=False) is None
    assert watch._reason(trial, alike, 0.0, late=True) == "colder surroundings or stronger cooling"
    told = replace(trial, evidence=20.0)
    assert watch._reason(told, alike, 0.0, late=True) == "ambient too cold"


def test_a_verdict_stands_until_the_target_or_time_changes():
    wire = made_up()
    watch = ReachWatch(wire=wire, retry=2.0)
    estimate = PowerObserver(wire=wire).found()
    verdict, _ = watched(40.0, cooling=13.0)
    state = ReachState(verdict=verdict)
    assert watch.step(state, 40.0, 0.0, 0.0, estimate).verdict is verdict
    assert watch.step(state, 45.0, 0.0, 0.0, estimate).verdict is verdict
    assert watch.step(state, verdict.reach - 2.0, 0.0, 0.0, estimate).verdict is None
    for _ in range(52):
        state = watch.step(state, 40.0, 0.0, 0.0, estimate)
    assert state.verdict is None


@pytest.mark.parametrize(("reading", "kept"), [(9.0, True), (12.5, False), (19.8, False)])
def test_a_verdict_that_readings_contradict_is_taken_back(reading, kept):
    watch = ReachWatch(wire=made_up())
    estimate = PowerObserver(wire=made_up()).found()
    most = 11.0 if reading < 15.0 else 25.0
    verdict = Unreachable("ambient too cold", 20.0, 10.0, 9.0, 8.0, most)
    state = watch.step(ReachState(verdict=verdict), 20.0, reading, 0.4, estimate)
    assert (state.verdict is verdict) == kept

"""What the report of an inspection says, by the content of a saved one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop_head.inspection.lines import StepRow, visit_row
from minorloop_head.procedures.inspected_view import with_finding
from minorloop_head.procedures.values import LogEntry
from minorloop_head.ultrasound.pits import PitDepth
from scripted_inspection import hole, inspected_view


def test_a_place_without_an_echo_is_not_scanned_and_not_known_to_be_within_reach():
    def row(*each):
        steps = tuple(LogEntry(0.0, what, "", succeeded) for what, succeeded in each)
        view = inspected_view("hole 1", seen=(hole(0.3, 20e-3, 5.0),), steps=steps)
        return visit_row(with_finding(view, 10e-3), 2e-3)

    silent = row(("scan", True), ("modality", False))
    assert (silent["scanned"], silent["reached"]) == (False, None)
    heard = row(("scan", True), ("modality", True))
    assert (heard["scanned"], heard["reached"]) == (True, True)
    assert heard["steps"] == [StepRow("scan", "", True), StepRow("modality", "", True)]


def finding(verdict="measured", evidence=5.0, **values):
    seen = hole(0.3, 20e-3, evidence)
    sizes = {"diameter": 1e-3, "place_sd": 1e-5, "diameter_sd": 1e-5, "depth_sd": 1e-5, **values}
    probed = PitDepth(verdict, 0.3, 20e-3, **sizes)
    return with_finding(inspected_view("hole 1", seen=(seen,), probed=probed), 10e-3)


@pytest.mark.parametrize(
    ("verdict", "evidence", "grade"),
    [
        ("measured", 0.7, "confirmed"),
        ("through-hole", 0.7, "confirmed"),
        ("no coupling", 7.0, "probable"),
        ("no coupling", 0.7, "look again"),  # odds of 2 to 1
        ("no pit", 7.0, "look again"),
    ],
)
def test_echoes_confirm_a_finding_and_odds_make_it_probable(verdict, evidence, grade):
    assert visit_row(finding(verdict, evidence), 2e-3)["grade"] == grade


@given(st.floats(0.1e-3, 1.2e-3), st.floats(1e-6, 0.1e-3), st.floats(0.5, 2.0))
def test_a_finding_is_accepted_if_enough_wall_is_left_by_the_end_of_its_band(depth, sd, least):
    row = visit_row(finding(depth=depth, depth_sd=sd, bursts=34, planned=36), 2e-3, least)
    assert row["wall [mm]"] == pytest.approx(2.0 - 1e3 * depth, abs=1e-4)
    assert row["wall_sd [mm]"] == pytest.approx(1e3 * np.hypot(sd, 0.017 * 2e-3), abs=1e-4)
    assert row["accepted"] == (2.0 - 1e3 * depth - 1.6448536 * np.hypot(1e3 * sd, 0.034) >= least)
    assert (
        visit_row(finding("uneven floor", depth=depth, depth_sd=sd), 2e-3, least)["accepted"]
        is None
    )
    unknown = visit_row(finding("no coupling"), 2e-3, least)
    assert (unknown["accepted"], unknown["wall [mm]"]) == (None, None)
    assert not visit_row(finding("through-hole"), 2e-3, least)["accepted"]

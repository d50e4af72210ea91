"""What the report of an inspection says, by the content of a saved one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop_head.inspection.lines import StepRow, visit_row
from minorloop_head.inspection.report import _without_depth, wall_words
from minorloop_head.procedures.inspected_view import InspectedView, with_finding
from minorloop_head.procedures.pictures import InspectedPicture
from minorloop_head.procedures.values import LogEntry
from minorloop_head.ultrasound.pits import PitDepth
from scripted_inspection import hole


def test_a_place_without_an_echo_is_not_scanned_and_not_known_to_be_within_reach():
    def row(*each):
        view = InspectedView(
            picture=InspectedPicture(name="hole 1", t=0.0, verdict="good"),
            image=np.zeros((2, 2), np.uint8), angles=(0.0, 0.0), joints=(0.0, 0.0),
            place=(0.0, 0.0), seen=(hole(0.3, 20e-3, 5.0),),
            steps=tuple(LogEntry(0.0, what, "", succeeded) for what, succeeded in each),
        )  # fmt: skip
        return visit_row(with_finding(view, 10e-3), 2e-3)

    silent = row(("scan", True), ("modality", False))
    assert (silent["scanned"], silent["reached"]) == (False, None)
    heard = row(("scan", True), ("modality", True))
    assert (heard["scanned"], heard["reached"]) == (True, True)
    assert heard["steps"] == [StepRow("scan", "", True), StepRow("modality", "", True)]


def test_it_says_what_the_edge_cuts_how_high_the_water_was_and_that_pictures_are_blurred():
    wall = {"z [mm]": [13.0, 22.0], "angles [deg]": [-180.0, 180.0], "searched": 0.9, "probed": 0.0}
    wall["pipe [mm]"] = 102.0
    content = {
        "wall": wall,
        "lens": "pictures are x",
        "views": 8,
        "out of reach": [],
        "not done": [],
    }
    water = {"water above the axis [mm]": [4.0, 0.2], "water level": "4.0 mm above the axis"}
    said = " ".join(wall_words(content | water))
    assert said.startswith("The camera searched 9.0 mm of the 102 mm of pipe: the inner wall from")
    assert "or one that the edge of each picture cuts, is not found; --advances" in said
    assert "Pictures are x." in said
    assert said.endswith("The water stood 4.0 mm above the axis.")
    full = {"water level": "no surface: water at every place"}
    beyond = {"out of reach": [{"view": "view 1", "why": "out of reach: pan needs 55"}]}
    said = wall_words(content | full | beyond)
    assert said[-2].startswith("The wires did not reach 1 direction in which to look (view 1: out")
    assert said[-1] == "The level of the water: no surface: water at every place."


def finding(verdict="measured", evidence=5.0, **values):
    seen = replace(hole(0.3, 20e-3, evidence), evidence=evidence)
    sizes = {"diameter": 1e-3, "place_sd": 1e-5, "diameter_sd": 1e-5, "depth_sd": 1e-5, **values}
    view = InspectedView(
        picture=InspectedPicture(name="hole 1", t=0.0, verdict="good"),
        image=np.zeros((2, 2), np.uint8), angles=(0.0, 0.0), joints=(0.0, 0.0),
        place=(0.0, 0.0), seen=(seen,), probed=PitDepth(verdict, 0.3, 20e-3, **sizes),
    )  # fmt: skip
    return with_finding(view, 10e-3)


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
    row = visit_row(finding(depth=depth, depth_sd=sd), 2e-3, least)
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


def test_a_crack_without_a_floor_may_be_deeper_than_is_measured_and_has_its_bound():
    row = {"depth [mm]": None, "kind": "crack", "verdict": "no floor echo (at least 0.70 mm deep)"}
    ((number, why),) = _without_depth([row])
    assert number == "1"
    assert why.endswith("deeper than the 1.25 mm that are measured (at least 0.70 mm deep)")

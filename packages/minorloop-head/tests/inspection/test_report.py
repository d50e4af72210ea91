"""What the report of an inspection says, by the content of a saved one."""

from types import SimpleNamespace

import numpy as np

from minorloop_head.inspection.lines import StepRow, visit_row
from minorloop_head.inspection.report import _map_caption, wall_words
from minorloop_head.procedures.inspected_view import InspectedView, with_finding
from minorloop_head.procedures.pictures import InspectedPicture
from minorloop_head.procedures.values import LogEntry
from minorloop_head.reconstruction.depth_map import WaterLine
from scripted_inspection import hole


def test_a_place_without_an_echo_is_not_scanned_and_not_known_to_be_within_reach():
    def row(*each):
        view = InspectedView(
            picture=InspectedPicture(name="hole 1", t=0.0, verdict="good"),
            image=np.zeros((2, 2), np.uint8), angles=(0.0, 0.0), joints=(0.0, 0.0),
            place=(0.0, 0.0), seen=(hole(0.3, 20e-3, 5.0),),
            steps=tuple(LogEntry(0.0, what, "", succeeded) for what, succeeded in each),
        )  # fmt: skip
        return visit_row(with_finding(view, 10e-3))

    silent = row(("scan", True), ("modality", False))
    assert (silent["scanned"], silent["reached"]) == (False, None)
    heard = row(("scan", True), ("modality", True))
    assert (heard["scanned"], heard["reached"]) == (True, True)
    assert heard["steps"] == [StepRow("scan", "", True), StepRow("modality", "", True)]


def test_the_caption_of_a_map_has_its_marks_only():
    seen = SimpleNamespace(seen_share=1.0, probed=np.zeros((2, 2), bool))
    assert _map_caption(seen, [], [], None) == ("The inner wall, unrolled, as the camera saw it.")
    line = WaterLine(1e-3, 1e-4, 0.0)
    shown = _map_caption(seen, [object()], [], line)
    assert shown.endswith("saw it; findings are numbered; dashed lines are the level of the water.")


def test_it_says_what_the_edge_cuts_how_high_the_water_was_and_that_pictures_are_blurred():
    wall = {"z [mm]": [13.0, 22.0], "angles [deg]": [-180.0, 180.0], "seen": 0.9, "probed": 0.0}
    wall["pipe [mm]"] = 102.0
    content = {"wall": wall, "lens": "pictures are x", "views": 8, "out of reach": []}
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

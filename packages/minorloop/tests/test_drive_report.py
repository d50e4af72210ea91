import numpy as np

from minorloop.drive import Arrival, DriveResult
from minorloop.drive_report import draw_drive, drive_report

RUN = {"actuator": "twin:ipmc", "input": "voltage [V]", "output": "curvature [1/m]"}
RESULT = DriveResult(
    0.25,
    (
        Arrival(1.0, 0.2, 1.5, 0.1, 1, "settled"),
        Arrival(-2.0, -0.4, np.nan, np.nan, 2, "unsettled"),
    ),
)


def test_the_page_has_every_target_the_offset_and_the_warnings():
    page = drive_report(RESULT, RUN, ["the meter was slow"]).html()
    for said in ("2 targets on twin:ipmc", "+0.25 more", "unsettled", "the meter was slow"):
        assert said in page
    assert page.count("<img") == 1


def test_the_figure_shows_targets_and_errors_with_units():
    above, below = draw_drive(RESULT, RUN["output"]).axes
    assert above.get_ylabel() == "curvature [1/m]"
    np.testing.assert_array_equal(above.lines[0].get_ydata(), [1, -2])
    np.testing.assert_array_equal(below.lines[1].get_ydata(), [0.5, np.nan])

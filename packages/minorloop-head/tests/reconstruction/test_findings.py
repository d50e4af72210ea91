import csv
import io

import numpy as np
import pytest

from minorloop_head.reconstruction.findings import finding_of, finding_table, kind_of
from minorloop_head.ultrasound.pits import PitDepth

PIT = PitDepth("measured", np.radians(30.0), 20e-3, 1e-3, 0.5e-3, 20e-6, 30e-6, 5e-6)
HOLE = PitDepth("through-hole", 0.0, 10e-3, 1e-3, place_sd=20e-6, diameter_sd=30e-6)


def test_the_table_holds_degrees_and_millimetres():
    rows = list(csv.DictReader(io.StringIO(finding_table([finding_of(PIT), finding_of(HOLE)]))))
    first = rows[0]
    assert (first["kind"], first["verdict"]) == ("pit", "measured")
    assert float(first["phi [deg]"]) == pytest.approx(30.0)
    assert float(first["phi_sd [deg]"]) == pytest.approx(np.degrees(20e-6 / 10e-3), abs=1e-4)
    assert float(first["depth [mm]"]) == pytest.approx(0.5)
    assert float(first["depth_sd [mm]"]) == pytest.approx(0.005)
    assert float(first["width [mm]"]) == float(first["length [mm]"]) == 1.0


@pytest.mark.parametrize(
    ("verdict", "kind"),
    [
        ("measured", "pit"),
        ("disturbed", "pit"),
        ("through-hole", "hole"),
        ("no pit", "mark"),
        ("deeper than 1.25 mm", "hole or pit"),
        ("no coupling", "hole or pit"),
        ("too short", "hole or pit"),
        ("no echoes yet", "hole or pit"),
    ],
)
def test_only_what_echoes_decide_has_a_kind(verdict, kind):
    assert kind_of(verdict) == kind
    assert finding_of(PitDepth(verdict, 0.0, 10e-3)).kind == kind

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from minorloop.errors import OutputError
from minorloop_head.reconstruction.findings import finding_of, finding_table, kind_of, save_findings
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


def test_it_is_written_or_refused(tmp_path):
    path = save_findings([finding_of(PIT)], tmp_path / "findings.csv")
    assert path.read_text() == finding_table([finding_of(PIT)])
    with pytest.raises(OutputError, match="does not exist"):
        save_findings([], tmp_path / "no" / "findings.csv")


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


def test_a_text_that_a_spreadsheet_takes_for_a_formula_is_quoted_and_numbers_are_not():
    finding = replace(finding_of(PIT), kind="=1+1", verdict="-2+3", z=-20e-3)
    (row,) = csv.DictReader(io.StringIO(finding_table([finding])))
    assert (row["kind"], row["verdict"], row["z [mm]"]) == ("'=1+1", "'-2+3", "-20.0000")

import csv
import json

import pytest
from scipy.io import savemat

from benchmarks._layered_scans import drawn_block
from minorloop.cli import main
from minorloop.errors import OutputError
from minorloop_head.inspection.scan_report import COLUMNS, keep_scan, scan_content, scan_summary
from minorloop_head.ultrasound.scan_flaws import scan_flaws


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(False, id="line"),
        pytest.param(True, id="raster", marks=pytest.mark.whole),
    ],
)
def found(request):
    seed = 1101 if request.param else 1003
    return scan_flaws(drawn_block(seed, raster=request.param).scan)


def test_what_is_kept_says_the_same_everywhere(found, tmp_path):
    content = keep_scan(found, tmp_path / "out", "block.mat")
    assert json.loads((tmp_path / "out" / "findings.json").read_text()) == content
    with (tmp_path / "out" / "findings.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["depth [mm]"]) for row in rows] == [
        row["depth [mm]"] for row in content["findings"]
    ]
    assert len(rows) == len(found.flaws) > 0
    report = (tmp_path / "out" / "report.html").read_text()
    assert scan_summary(content) in report
    raster = found.scan.traces.shape[2] > 1
    assert ("C-scan" in report) == raster
    assert report.count("data:image/svg+xml") >= 1 + raster
    with pytest.raises(OutputError):
        keep_scan(found, tmp_path / "out", "block.mat")


def test_a_flaw_of_unknown_size_has_a_bound(found):
    row = scan_content(found, "block.mat")["findings"][0]
    assert row["size [mm]"] is None
    assert row["verdict"].startswith("a point, at most ")
    assert (row["y [mm]"] is None) == (found.scan.traces.shape[2] == 1)


def test_the_verb_prints_flaws_and_replaces_what_the_file_says(tmp_path, capsys):
    scan = drawn_block(1003).scan
    content = {name: value for name, value in scan.fields().items() if name != "speeds"}
    savemat(tmp_path / "block.mat", {**content, "v": scan.speeds})
    options = ["--field", "speeds=v", "--given", f"step={1e3 * scan.steps[0]}", "--json"]
    assert main(["head", "scan", str(tmp_path / "block.mat"), *options]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["findings"]) == 4
    assert found["layers"][1]["thickness [mm]"] == pytest.approx(1e3 * scan.thicknesses[1], abs=0.3)
    assert main(["head", "scan", str(tmp_path / "block.mat"), *options[:-1]]) == 0
    said = capsys.readouterr().out
    assert all(name.split()[0] in said for name in ("no.", "4 flaws", "layer"))
    assert len(COLUMNS) == 9

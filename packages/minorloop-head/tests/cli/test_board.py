import tomllib

import numpy as np
import pytest

from minorloop import Preisach
from minorloop_head.control.limits import WireLimits
from minorloop_head.heated_wire import HeatedWire
from minorloop_head.procedures.head_file import HeadFile, save_head
from wires import in_a_file


def test_firmware_is_written_for_an_axis_of_each_model_file(answer, tmp_path):
    found = answer("head board model.json model.json --out firmware --rate 5")
    assert {"control.c", "axis0.c", "axis1.c", "Makefile", "README.md"} <= set(found["files"])
    bench = tomllib.loads((tmp_path / "firmware" / "bench.toml").read_text())
    assert [source["name"] for source in bench["sources"]] == ["voltage 1", "voltage 2"]
    assert [source["rate"] for source in bench["sources"]] == [5.0, 5.0]
    assert [sensor["of"] for sensor in bench["sensors"]] == ["voltage 1", "voltage 2"]


def test_firmware_of_a_head_has_its_limits_and_its_lines(run, refused, tmp_path):
    wire = HeatedWire(Preisach([0.0, 0.08, 0.16], [[1, 0], [2, 1]], relay="unipolar"), 4.0, 0.01)
    coupling = np.array([[1.0, 0.07], [0.06, 1.0]])
    known = in_a_file(wire, wire, coupling=coupling, limits=WireLimits(hottest=60.0))
    save_head(HeadFile(serial="H-07", identified=known), "head.json")
    status, out, _ = run("head board head.json --out firmware")
    assert (status, "make -C firmware" in out) == (0, True)
    bench = tomllib.loads((tmp_path / "firmware" / "bench.toml").read_text())
    assert (bench["serial"], len(bench["lines"])) == ("H-07", 4)
    for source in bench["sources"]:  # no hotter than 60 degrees, with the margin of the limits
        assert source["high"] == pytest.approx(np.sqrt(40 / (1.15 * 676)))
    save_head(HeadFile(serial="H-07"), "empty.json")
    assert "has no identified wires" in refused("head board empty.json --out a")

import math
from pathlib import Path

import pytest

from minorloop.cli._braille import scatter

PLAN = "plan decaying --low -1.2 --high 1.2 --levels 4 --hold 30"
RUN = "run --actuator twin:ipmc --plan plan.csv --noise 0.05 --specimen 3 --seed 4"


@pytest.fixture(autouse=True)
def _planned(_somewhere, run):
    assert run(f'{PLAN} --input "voltage [V]" --save plan.csv')[0] == 0


def test_shows_the_content_of_a_store(run, answer):
    run(f"{RUN} --store runs.sqlite")
    out = run("runs list --store runs.sqlite")[1]
    assert "11 of 11" in out
    assert "finished" in out
    assert answer("runs list --store .")["runs"][0]["points"] == 11
    shown = run("runs show --store runs.sqlite")[1]
    assert "fresh, from point 0 on; finished" in shown
    assert "curvature [1/m] against voltage [V]" in shown
    found = answer("runs show --store runs.sqlite")
    assert found["actuator"] == "twin:ipmc"
    assert found["settled"] + found["extrapolated"] + found["unsettled"] == 11
    assert len(found["columns"]["voltage [V]"]) == 11
    assert answer("runs export --store runs.sqlite")["rows"] == 11


def test_a_damaged_store_does_not_hide_the_others(run, answer):
    run(f"{RUN} --store runs.sqlite")
    content = bytearray(Path("runs.sqlite").read_bytes())
    content[len(content) // 2 : len(content) // 2 + 400] = bytes(400)
    Path("bad.sqlite").write_bytes(content)
    out = run("runs list --store .")[1]
    assert "11 of 11" in out
    assert "bad.sqlite" in out
    found = answer("runs list --store .")
    assert len(found["runs"]) == len(found["unusable"]) == 1


def test_no_line_is_drawn_across_a_point_without_a_value():
    joined = scatter([([0.0, 1.0, 2.0], [0.0, 0.5, 1.0])], 20, 5)
    apart = scatter([([0.0, 1.0, 2.0], [0.0, math.nan, 1.0])], 20, 5)

    def characters(lines):
        return sum(0x2800 < ord(letter) < 0x2900 for letter in "".join(lines))

    assert characters(apart) == 2 < characters(joined)

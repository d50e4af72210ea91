import csv

import numpy as np

from minorloop.arrays import uniform_levels
from minorloop.identification import excitation

PLAN = "plan decaying --low -1.2 --high 1.2 --levels 4"


def test_the_written_plan_can_be_read_back(run):
    status, out, err = run(f'{PLAN} --hold 60 --input "voltage [V]" --save plan.csv')
    assert (status, err) == (0, "")
    assert "11 holds of 60 s, 11 min in all" in out
    assert "determines the plane" in out
    assert "written to plan.csv" in out
    with open("plan.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["voltage [V]", "hold [s]"]
    inputs, holds = np.array(rows, dtype=float).T
    assert np.all(holds == 60)
    np.testing.assert_array_equal(
        inputs, excitation.decaying_staircase(uniform_levels(-1.2, 1.2, 4))
    )

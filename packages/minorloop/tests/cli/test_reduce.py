import itertools
from pathlib import Path

import numpy as np
import pytest

from command_line import write

LEVELS = [-1.0, -0.4, 0.3, 1.0, 0.2, -0.6, 0.5, -0.1]


@pytest.fixture(autouse=True)
def _log(_somewhere):
    """A raw log: a first-order lag in mm behind eight holds."""
    chance = np.random.default_rng(1000)
    u, t = np.repeat(LEVELS, 100), 0.1 * np.arange(800)
    shares = 1 - np.exp(-np.arange(1, 101) / 15)
    ends = np.array([0.0, *LEVELS])
    y = np.concatenate([a + (b - a) * shares for a, b in itertools.pairwise(ends)])
    d = 20 - y + 1e-3 * chance.normal(size=y.size)
    write("log.csv", "time [s],voltage [V],distance [mm]", np.column_stack([t, u, d]))


LINE = "reduce log.csv --input voltage --output distance"


def test_a_log_becomes_points_that_identify_takes(run):
    status, out, err = run(
        f"{LINE} --convert laser:20,15,0.02,0.05 --save points.csv --report r.html"
    )
    assert (status, err) == (0, "")
    assert "8 holds in 800 samples: 8 settled" in out
    assert "points written to points.csv" in out
    assert "Settled points of curvature" in Path("r.html").read_text()
    status, out, _ = run("identify points.csv --input voltage --output curvature --law levels=4 -v")
    assert "curvature [1/m] against voltage [V]" in out
    assert "weights: by the standard deviations in the column sd [1/m]" in out


def test_the_standard_deviation_of_a_point_is_its_weight(answer, refused, model):
    chance = np.random.default_rng(1000)
    u = np.concatenate([[-1, 1], chance.uniform(-1, 1, 298)])
    sd = np.where(np.arange(300) % 2, 0.002, 0.1)
    y = model.simulate(u) + sd * chance.normal(size=300)
    rows = np.column_stack([u, y, sd, 1e3 * sd])
    write("points.csv", "u [V],y [um],sd [um],other [nm]", rows)
    line = "identify points.csv --input u --output y --law levels=8,lag=0 --prior smooth"
    ways = ("", "--record sd=sd", "--record sd=none", "--record sd=0.1")
    recognised, named, without, noise = (answer(f"{line} {way}") for way in ways)
    assert (recognised["sd"], named["sd"]) == ("sd [um]", "sd")
    assert without["sd"] is noise["sd"] is None
    assert recognised["rmse_train"] == named["rmse_train"] > without["rmse_train"]
    assert "is not a standard deviation of 'y [um]'" in refused(f"{line} --record sd=other")

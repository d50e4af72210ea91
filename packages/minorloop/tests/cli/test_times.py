"""Times of a record on the command line: gaps, lags in seconds, and raw logs."""

import json
from pathlib import Path

import numpy as np
import pytest

from command_line import MODEL, write

T = 0.01 * np.arange(900)
U = np.exp(-T / 8) * np.sin(T * 4)
COLUMNS = "time [s],voltage [V],length [um]"
LINE = "identify log.csv --input voltage --output length --law levels=6,diagonal=uniform,slope=no"


def _log(t, u, y, columns=COLUMNS):
    write("log.csv", columns, np.column_stack([t, u, y]))


def test_with_dynamics_the_advice_on_lost_rows_can_be_followed(run):
    kept = np.delete(np.arange(900), slice(150, 450))
    _log(T[kept], U[kept], MODEL.simulate(U)[kept])
    line = LINE.partition(" --law")[0]
    law = "dynamics:first=operator,levels=4,diagonal=uniform"
    status, out, _ = run(f"{line} --law {law} --time time --json")
    assert status == 1
    said = json.loads(out)["warnings"][0]
    assert "--record rows=A:B" in said
    assert "--time" not in said
    assert "--curves" not in said


def test_uneven_samples_are_said_where_a_lag_needs_even_ones(answer, run):
    t = np.cumsum(np.random.default_rng(1000).uniform(0.005, 0.015, 900))
    _log(t, U, MODEL.simulate(U), COLUMNS.replace("time [s]", "clock [ms]"))
    assert "uneven" not in " ".join(answer(f"{LINE} --law lag=0")["advice"])
    assert "samples are uneven" in " ".join(run(f"{LINE} --law lag=3 -v")[1].split())


def test_a_lag_in_seconds_needs_no_even_samples(answer):
    t = np.cumsum(np.random.default_rng(1000).uniform(0.005, 0.015, 800))
    u = np.interp(t, T, U)
    _log(t, u, MODEL.simulate(np.interp(t - 0.025, t, u)))
    right = answer(f"{LINE} --time time --law 'lag=25 ms'")["nrmse_train"]
    wrong = answer(f"{LINE} --time time --law 'lag=0 s'")["nrmse_train"]
    assert right < 0.65 * wrong


def test_a_raw_log_is_not_to_be_trusted(run):
    levels = np.random.default_rng(1000).uniform(-1, 1, 12)
    u, y, last = np.repeat(levels, 60), [], 0.0
    for level in u:
        last += (level - last) / 12
        y.append(last)
    _log(0.1 * np.arange(u.size), u, y)
    status, out, err = run(f"{LINE} --law lag=0")
    assert status == 1
    assert "this looks like a raw log: 720 samples with 12 holds of about 60" in " ".join(
        out.split()
    )
    assert "reduce" in out
    assert "not to be trusted" in err


def test_invert_keeps_the_times_of_the_targets(run, refused):
    write("wanted.csv", "when [ms],length [um]", [[0, 0.3], [500, 1.5], [1500, -2.0]])
    line = "invert model.json wanted.csv --target length --time when --save inputs.csv"
    assert run(line)[0] == 0
    rows = Path("inputs.csv").read_text().splitlines()
    assert rows[0].startswith("when [s],voltage [V],target length [um]")
    assert [row.split(",")[0] for row in rows[1:]] == ["0.0", "0.5", "1.5"]
    rows = [[k if k < 15 else k - 5, 0.3] for k in range(20)]
    write("wanted.csv", "when [ms],length [um]", rows)
    said = refused(f"{line} --force")
    assert "column 'when [ms]' of wanted.csv runs backwards in row 17; give the rows in" in said


def test_simulate_leaves_outputs_after_a_gap_empty(run, answer):
    kept = np.delete(np.arange(900), slice(150, 450))
    write("in.csv", "time [s],voltage [V]", np.column_stack([T[kept], U[kept]]))
    line = "simulate model.json in.csv --input voltage --time time"
    notes = answer(line)["notes"]
    assert "1 gap in column 'time [s]': about 300 samples are missing" in notes[0]
    assert run(f"{line} --save out.csv")[0] == 0
    cells = [row.split(",")[2] for row in Path("out.csv").read_text().splitlines()[1:]]
    assert f"{cells.count('')} outputs are left empty" in notes[1]
    assert "" not in cells[:150]
    assert cells[150:160] == [""] * 10
    y = MODEL.simulate(U[kept])
    np.testing.assert_allclose([float(cell) for cell in cells[:150]], y[:150], atol=1e-12)


def test_gaps_and_uneven_times_of_targets_are_said(run):
    t = np.delete(np.cumsum(np.where(np.arange(100) % 2, 0.01, 0.02)), slice(40, 60))
    write("wanted.csv", "time [s],length [um]", np.column_stack([t, np.sin(t)]))
    err = run("invert model.json wanted.csv --target length --time time")[2]
    assert "note: 1 gap in the times of the targets, the longest 0.32 s: the input of" in err
    assert "note: samples are uneven" in err


@pytest.mark.parametrize("given", ["30 ms", "auto"])
def test_a_lag_in_seconds_is_kept_in_the_model_for_other_intervals(answer, given):
    late = np.interp(T - 0.03, T, MODEL.simulate(U))
    _log(T, U, late)
    answer(f"{LINE} --time time --prior smooth:strength=0 --law 'lag={given}' --save late.json")
    fine = np.arange(0, 8.99, 0.004)
    write("fine.csv", "time [s],voltage [V]", np.column_stack([fine, np.interp(fine, T, U)]))
    answer("simulate late.json fine.csv --time time --save out.csv")
    found = np.loadtxt("out.csv", delimiter=",", skiprows=1)[:, -1]
    off, prompt = (
        np.sqrt(np.mean((found - np.interp(fine - lag, T, MODEL.simulate(U)))[50:] ** 2))
        for lag in (0.03, 0.0)
    )
    assert off < 0.3 * prompt

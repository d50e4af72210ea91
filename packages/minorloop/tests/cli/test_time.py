"""Records and models with time through the verbs."""

from pathlib import Path

import numpy as np
import pytest

from command_line import MODEL, write
from minorloop import AfterEffect, BoucWen, Cascade, Linear, Oscillator, Preisach, modelfile
from minorloop.lab.records import Quantity

UNITS = {"input": "voltage [V]", "output": "length [um]"}
COLUMNS = "time [s],voltage [V],length [um]"
CASCADE = Cascade(MODEL, Linear.lags(0.05, 0.02, delay=0.02))
WEIGHTS = np.tril(np.random.default_rng(1000).uniform(0.2, 1, (4, 4)))
CREEPING = AfterEffect(
    Preisach(np.linspace(-1, 1, 5), WEIGHTS, relay="unipolar", diagonal="reversible"),
    times=[5.0],
    creep=[0.4 * WEIGHTS],
)
MASS = Oscillator(2.0, 10.0, 5e4, BoucWen(5e4, 800.0, 900.0))
T = 0.01 * np.arange(300)


def columns(name):
    return np.genfromtxt(name, delimiter=",", skip_header=1).T


def moving():
    """A record of the cascade."""
    t = 0.01 * np.arange(400)
    u = -np.cos(2 * t) * np.exp(-t / 6) * np.where(t < 2, 1, np.cos(25 * t))
    return COLUMNS, t, u, CASCADE.simulate(t, u)


def holds():
    """A record of the model that creeps: 60 holds of 10 rows."""
    u = np.repeat(np.random.default_rng(1001).uniform(-1, 1, 60), 10)
    t = np.arange(1.0, u.size + 1)
    noise = 1e-3 * np.random.default_rng(1002).normal(size=t.size)
    return COLUMNS, t, u, CREEPING.simulate(t, u) + noise


def vibration():
    """A record of the mass: two periods of a multisine of 256 samples."""
    rng = np.random.default_rng(1000)
    lines = np.zeros(129, dtype=complex)
    lines[2:50] = np.exp(2j * np.pi * rng.random(48))
    t = np.arange(512) / 750
    u = np.tile(2e3 * np.fft.irfft(lines), 2)
    y = np.tile(MASS.simulate(t[:256], u[:256], periodic=True), 2)
    noise = 2e-6 * rng.normal(size=t.size)
    return "time [s],voltage [N],length [m]", t, u, y + noise


def has_lags(found):
    lags = found["dynamics"]
    return abs(sum(lags["time_constants"]) + lags["dead_time"] - 0.09) < 0.01


def creeps(found):
    return found["law"] == "spectrum"


def has_mass(found):
    return abs(found["parameters"]["mass"] / 2 - 1) < 0.02 and 1.2e-6 < found["noise"] < 1.6e-6


@pytest.mark.parametrize(
    ("record", "law", "score", "said", "known"),
    [
        (moving, "dynamics:levels=8,first=operator,poles=2", "nrmse_train", "compared", has_lags),
        (holds, "viscosity:creep=spectrum,levels=4", "left_out_nrmse", "time explains", creeps),
        (vibration, "vibration:rough=rough.json,period=256", "nrmse", "and its loops", has_mass),
    ],
    ids=["dynamics", "viscosity", "vibration"],
)
def test_from_a_record_to_a_model_its_report_and_its_outputs(
    record, law, score, said, known, answer
):
    modelfile.save(Oscillator(3.0, 5.0, 3e4, BoucWen(7e4, 500.0, 1300.0)), "rough.json")
    header, t, u, y = record()
    write("log.csv", header, np.column_stack([t, u, y]))
    line = "identify log.csv --input voltage --output length --time time"
    found = answer(f"{line} --law {law} --save m.json --report r.html")
    assert known(found)
    assert found[score] < 6e-3
    assert modelfile.read("m.json").provenance.scores[score] == found[score]
    assert said in Path("r.html").read_text()
    answer("simulate m.json log.csv --time time --save moved.csv")
    moved = columns("moved.csv")
    np.testing.assert_array_equal(moved[0], t)
    error = (moved[2] - y)[t.size // 2 :]  # the mass begins at rest here
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.ptp(y)
    if record is vibration:
        answer("simulate m.json log.csv --time time --record between=held --save held.csv")
        assert (columns("held.csv")[2] != moved[2]).any()


def test_simulate_leaves_outputs_after_a_gap_empty(run, answer):
    t = 0.01 * np.arange(900)
    u = np.exp(-t / 8) * np.sin(t * 4)
    kept = np.delete(np.arange(900), slice(150, 450))
    write("in.csv", "time [s],voltage [V]", np.column_stack([t[kept], u[kept]]))
    line = "simulate model.json in.csv --input voltage --time time"
    notes = answer(line)["notes"]
    assert "1 gap in column 'time [s]': about 300 samples are missing" in notes[0]
    assert run(f"{line} --save out.csv")[0] == 0
    y = columns("out.csv")[2]
    assert f"{np.isnan(y).sum()} outputs are empty" in notes[1]
    assert np.isnan(y[150:160]).all()
    np.testing.assert_allclose(y[:150], MODEL.simulate(u[kept])[:150], atol=1e-12)


@pytest.fixture
def moves(_somewhere):
    """The cascade in the file dynamic.json, and times with targets in moves.csv."""
    modelfile.save(CASCADE, "dynamic.json", **UNITS)
    targets = MODEL.simulate([-1.0])[0] + 4 * (1 - np.cos(2 * T))
    write("moves.csv", "time [ms],length [um]", np.column_stack([1e3 * T, targets]))
    return targets


def test_invert_follows_targets_in_time_or_settles_at_them(moves, run):
    line = "invert dynamic.json moves.csv --target length --save in.csv"
    assert run(f"{line} --time time")[0] == 0
    t, u, targets, _, reachable = columns("in.csv")
    assert reachable.all()
    assert np.abs(CASCADE.simulate(t, u, before=-1.0) - moves).max() < 0.03 * np.ptp(moves)
    status, out, _ = run(f"{line} --force")
    assert status == 0
    assert "each output settles at its target; --time follows targets in time" in out
    np.testing.assert_array_equal(columns("in.csv")[0], MODEL.invert(targets).u)


def test_the_inputs_of_a_model_with_a_lag_are_ahead_of_the_targets(moves, run):
    names = (Quantity.parse(name) for name in UNITS.values())
    late = modelfile.ModelFile(MODEL, *names, 20, modelfile.Provenance(), lag_seconds=0.2)
    modelfile.save(late, "late.json")
    line = "invert late.json moves.csv --target length"
    status, _, err = run(f"{line} --time time --save in.csv")
    assert status == 0
    assert "the inputs are 0.195 s ahead of the targets, as the output is late" in err
    assert "the targets still move there: add rows to follow them on" in err
    t, u, targets, _, _ = columns("in.csv")
    late = np.interp(t - 0.195, t, MODEL.simulate(u))
    assert np.abs(late - targets)[25:].max() < 1e-3 * np.ptp(targets)
    assert "ahead" not in run(line)[2]


def test_invert_keeps_the_times_of_the_targets_and_says_what_is_wrong_with_them(run, refused):
    write("wanted.csv", "when [ms],length [um]", [[0, 0.3], [500, 1.5], [1500, -2.0]])
    line = "invert model.json wanted.csv --target length --time when --save inputs.csv --force"
    assert run(line)[0] == 0
    assert Path("inputs.csv").read_text().startswith("when [s],voltage [V],target length [um]")
    assert columns("inputs.csv")[0].tolist() == [0.0, 0.5, 1.5]
    rows = [[k if k < 15 else k - 5, 0.3] for k in range(20)]
    write("wanted.csv", "when [ms],length [um]", rows)
    said = refused(line)
    assert "column 'when [ms]' of wanted.csv runs backwards in row 17; give the rows in" in said
    t = np.delete(np.cumsum(np.where(np.arange(100) % 2, 0.01, 0.02)), slice(40, 60))
    write("wanted.csv", "when [s],length [um]", np.column_stack([t, np.sin(t)]))
    err = run(line)[2]
    assert "note: 1 gap in the times of the targets, the longest 0.32 s: the input of" in err
    assert "note: samples are uneven" in err


CREEP = "--input voltage --output length --time time --law viscosity:creep=spectrum,levels=4"


def test_pauses_without_samples_show_creep_if_both_ends_are_read(answer, refused):
    header, *record = holds()
    for name, kept in (("ends.csv", [0, 9]), ("last.csv", [9])):
        write(name, header, np.column_stack(record)[np.isin(np.arange(600) % 10, kept)])
    found = answer(f"identify ends.csv {CREEP}")
    assert found["law"] == "spectrum"
    assert found["left_out_nrmse"] < 0.005
    assert "no input is held" in refused(f"identify last.csv {CREEP}")

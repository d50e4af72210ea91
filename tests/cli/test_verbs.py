"""The command line, driven as a user would."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from minorloop import modelfile
from minorloop.cli import main
from minorloop.lab import columns
from minorloop.operators.preisach import Preisach

LEVELS = np.linspace(-1, 1, 9)
MODEL = Preisach(LEVELS, np.tril(np.random.default_rng(0).uniform(size=(8, 8))), 0.4)


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    u = np.random.default_rng(1).uniform(-1, 1, 400)
    write("good.csv", "voltage [V],length [um]", np.column_stack([u, MODEL.simulate(u)]))
    write("targets.csv", "length [um]", np.array([[0.3], [1.5], [-2.0]]))
    write("far.csv", "length [um]", np.array([[0.3], [1e3]]))


def write(name, header, rows):
    np.savetxt(name, rows, delimiter=",", header=header, comments="", fmt="%s")


def run(line, capsys):
    """Exit status, stdout, stderr."""
    status = main(line.split())
    shown = capsys.readouterr()
    return status, shown.out, shown.err


def refused(line, capsys):
    """The one line that an error is."""
    status, out, err = run(line, capsys)
    assert (status, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    return err


IDENTIFY = "identify good.csv --input voltage --output length --levels 8"


def test_from_a_file_to_a_model_and_back(capsys):
    line = f"{IDENTIFY} --holdout 0.2 --save model.json --report report.html"
    status, out, err = run(line, capsys)
    assert (status, err) == (0, "")
    assert "length [um] against voltage [V]" in out
    found = modelfile.read("model.json")
    assert (str(found.input), str(found.output), found.lag) == ("voltage [V]", "length [um]", 0)
    assert found.provenance.data == "good.csv"
    assert found.provenance.scores["nrmse_holdout"] < 0.01
    assert "<img" in (page := Path("report.html").read_text())
    assert "http" not in page.replace("http://www.w3.org", "")

    assert run("simulate model.json good.csv --input voltage --save out.csv", capsys)[0] == 0
    u, y = np.loadtxt("out.csv", delimiter=",", skiprows=1).T
    np.testing.assert_array_equal(y, found.model.simulate(u))

    assert run("invert model.json targets.csv --target length --save in.csv", capsys)[0] == 0
    table = np.loadtxt("in.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(found.model.simulate(table[:, 0]), [0.3, 1.5, -2.0], atol=1e-9)


@pytest.mark.parametrize(
    ("line", "keys"),
    [
        (
            f"{IDENTIFY} --holdout 0.2",
            "nrmse_train nrmse_holdout baseline_nrmse_holdout lag_samples unknowns rank "
            "excited_fraction kkt seconds advice",
        ),
        ("simulate model.json good.csv --input voltage", "samples y"),
        ("invert model.json targets.csv --target length", "u y worst_residual unreachable"),
        ("plan decaying --low 0 --high 1 --levels 4", "inputs hold_s hours rank unknowns"),
        ("demo", "rms_preisach rms_quadratic rms_ratio max_preisach max_quadratic"),
    ],
)
def test_json_is_one_object_and_nothing_else(line, keys, capsys):
    modelfile.save(MODEL, "model.json")
    status, out, err = run(f"{line} --json", capsys)
    assert (status, err) == (0, "")
    assert set(keys.split()) <= set(json.loads(out))


def test_an_empty_cell_was_not_measured(capsys):
    lines = Path("good.csv").read_text().splitlines()
    lines[5] = lines[5].split(",")[0] + ","
    Path("gap.csv").write_text("\n".join(lines))
    line = IDENTIFY.replace("good", "gap") + " --json"
    assert json.loads(run(line, capsys)[1])["samples"] == 399


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("voltage,length\n1,2\nabc,3\n", "'abc' in row 3"),
        ("voltage,length\n1,2\n,3\n", "empty in row 3"),
        ("voltage,length\n1,2\n3,inf\n", "'inf' in row 3"),
        ("voltage,length\n1,2\n3,4\n", "2 outputs are finite"),
        ("voltage,length\n" + "1,2\n1,3\n" * 3, "the input is 1 throughout"),
        ("voltage,length\n" + "1,2\n2,2\n" * 3, "the output is 2 throughout"),
        ("voltage,length\n1,2\n3\n", "row 3"),
        ("volts,length\n1,2\n", "has no column 'voltage', it has 'volts', 'length'"),
        ("", "empty"),
        ("voltage,length\n", "no rows"),
        ("\0\1\2", "bad.csv"),
    ],
)
def test_bad_files(content, says, capsys):
    Path("bad.csv").write_text(content)
    assert says in refused("identify bad.csv --input voltage --output length", capsys)


def test_a_file_too_large_is_not_begun(capsys, monkeypatch):
    monkeypatch.setattr(columns, "MAX_BYTES", 100)
    assert "good.csv" in refused(IDENTIFY, capsys)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--levels 0", "levels is 0"),
        ("--levels 100000", "at most 250"),
        ("--levels many", "--levels"),
        ("--lag -1", "lag is -1"),
        ("--lag soon", "auto or a whole number"),
        ("--rows 5", "such as 200:7000"),
        ("--rows 900:950", "400 rows"),
        ("--holdout 2", "0 to 0.9"),
        ("--holdout nan", "0 to 0.9"),
        ("--smoothness -1", "smoothness is -1"),
        ("--spacing odd", "'uniform', 'adaptive'"),
        ("--start odd", "'demagnetised'"),
        ("--bogus", "--bogus"),
    ],
)
def test_bad_options(options, says, capsys):
    assert says in refused(f"{IDENTIFY} {options}", capsys)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--save missing/model.json", "folder missing does not exist"),
        ("--save .", "is a folder"),
        ("--report targets.csv", "or --force to replace it"),
        ("--save new.json --report new.json", "named for two results"),
    ],
)
def test_places_are_checked_before_the_work(options, says, capsys, monkeypatch):
    import minorloop.identification

    monkeypatch.setattr(minorloop.identification, "identify", None)  # would fail if called
    before = Path("good.csv").read_text()
    assert says in refused(f"{IDENTIFY} {options}", capsys)
    assert Path("good.csv").read_text() == before


def test_force_replaces(capsys):
    Path("model.json").write_text("precious")
    assert "--force" in refused(f"{IDENTIFY} --save model.json", capsys)
    assert Path("model.json").read_text() == "precious"
    assert run(f"{IDENTIFY} --save model.json --force", capsys)[0] == 0
    assert modelfile.load("model.json").bands == 8


def test_targets_out_of_reach(capsys):
    modelfile.save(MODEL, "model.json")
    said = refused("invert model.json far.csv --target length", capsys)
    assert "index 1" in said
    assert "pass --clip" in said
    out = run("invert model.json far.csv --target length --clip", capsys)[1]
    assert "1 of 2 targets are out of reach" in out


def test_models_that_cannot_be_inverted_say_why(capsys):
    modelfile.save(Preisach(LEVELS, -MODEL.weights), "signed.json")
    assert "not monotone" in refused("invert signed.json targets.csv --target length", capsys)


def test_damaged_models(capsys):
    modelfile.save(MODEL, "model.json")
    text = Path("model.json").read_text()
    for damaged in (text[:200], text.replace('"version": 1', '"version": 9'), "", "[]"):
        Path("damaged.json").write_text(damaged)
        refused("simulate damaged.json good.csv --input voltage", capsys)
    assert "no file" in refused("simulate missing.json good.csv --input voltage", capsys)


@pytest.mark.parametrize(
    "line",
    [
        "plan spiral --low 0 --high 1",
        "plan decaying --low 1 --high 0",
        "plan decaying --low 0 --high inf",
        "plan decaying --low 0 --high 1 --hold 0",
        "plan decaying --low 0 --high 1 --levels 99999",
        "demo --seed -1",
        "demo --noise -1",
        "demo --noise nan",
        "demo --out good.csv",
        "fly",
        "identify",
    ],
)
def test_other_verbs_refuse_in_one_line(line, capsys):
    refused(line, capsys)


def test_plan_is_written_as_a_table(capsys):
    line = "plan decaying --low 0 --high 1 --levels 4 --hold 60 --input voltage --save plan.csv"
    assert "determines the plane" in run(line, capsys)[1]
    rows = Path("plan.csv").read_text().splitlines()
    assert rows[0] == "voltage,hold [s]"
    assert len(rows) == 1 + 11


def test_demo_leaves_report_data_and_model(capsys):
    assert run("demo --out result", capsys)[0] == 0
    line = "identify result/staircase.csv --input voltage --output curvature --levels 10 --json"
    assert json.loads(run(line, capsys)[1])["rank"] == 56
    assert modelfile.load("result/model.json").bands == 10
    assert "not empty" in refused("demo --out result", capsys)


def test_ctrl_c_is_no_traceback(capsys, monkeypatch):
    import minorloop.identification

    def interrupted(*args, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(minorloop.identification, "identify", interrupted)
    status, out, err = run(IDENTIFY, capsys)
    assert (status, out, err) == (130, "", "interrupted\n")


def test_is_a_program():
    program = [sys.executable, "-m", "minorloop"]
    command = [*program, "identify", "nope.csv", "--input", "a", "--output", "b"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == "error: nope.csv does not exist\n"
    shown = subprocess.run(program, capture_output=True, text=True)
    assert shown.returncode == 0
    assert "identify" in shown.stdout

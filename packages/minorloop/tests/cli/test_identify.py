import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

import minorloop.identification
import minorloop.report
from minorloop import __version__, modelfile
from minorloop.errors import OutputError
from minorloop.identification import plane_result
from minorloop.identification.pipeline import Options
from minorloop.lab.records import Record
from minorloop.operators.densities import LorentzianDensity
from minorloop.operators.preisach import Preisach

IDENTIFY = "identify good.csv --input voltage --output length --levels 8"
KEYS = (
    "nrmse_train nrmse_holdout baseline_nrmse_holdout lag_samples unknowns rank "
    "excited_fraction kkt seconds advice smoothness samples levels range "
    "relative_rms_train worst_holdout loop_area_train free_parameters effective_parameters curves"
)


def record():
    return np.loadtxt("good.csv", delimiter=",", skiprows=1).T


def test_from_a_file_to_a_model_with_its_origin(run):
    status, out, err = run(f"{IDENTIFY} --holdout 0.2 --save new.json --report new.html")
    assert (status, err) == (0, "")
    assert "length [um] against voltage [V]: Preisach, 8 bands" in out
    assert "model written to new.json" in out
    assert "report written to new.html" in out
    found = modelfile.read("new.json")
    assert (str(found.input), str(found.output), found.lag) == ("voltage [V]", "length [um]", 0)
    chosen = {"lag": "auto", "diagonal": "auto", "slope": "auto"}  # as the command does
    assert (
        found.model
        == Options.of({"levels": 8, "holdout": 0.2, **chosen}).identify(Record(*record())).model
    )
    origin = found.provenance
    assert (origin.data, origin.minorloop) == ("good.csv", __version__)
    assert origin.sha256 == hashlib.sha256(Path("good.csv").read_bytes()).hexdigest()
    errors = {"nrmse", "relative_rms", "worst", "loop_area"}
    both = {f"{error}_{part}" for error in errors for part in ("train", "holdout")}
    assert set(origin.scores) == both | {
        "baseline_nrmse",
        "free_parameters",
        "effective_parameters",
        "kkt",
    }
    assert origin.scores["nrmse_holdout"] < 0.01
    page = Path("new.html").read_text()
    assert "good.csv" in page
    assert "http" not in page.replace("http://www.w3.org", "")


def test_there_and_back_again(run, model):
    assert run(f"{IDENTIFY} --smoothness 0 --save new.json")[0] == 0
    assert run("simulate new.json good.csv --input voltage --save out.csv")[0] == 0
    u, y = np.loadtxt("out.csv", delimiter=",", skiprows=1).T
    np.testing.assert_allclose(y, model.simulate(u), atol=1e-9 * np.ptp(y))
    line = "invert new.json out.csv --target length --save in.csv"
    assert run(line)[0] == 0
    applied = np.loadtxt("in.csv", delimiter=",", skiprows=1)[:, 0]
    np.testing.assert_allclose(model.simulate(applied), y, atol=1e-8 * np.ptp(y))


@pytest.mark.parametrize(
    "options", ["", "--holdout 0.2", "--levels 12 --rows 0:120", "--signed --slope"]
)
def test_json_has_what_is_documented(options, answer):
    found = answer(f"{IDENTIFY} {options}")
    assert set(KEYS.split()) <= set(found)
    assert (found["nrmse_holdout"] is None) == ("holdout" not in options)
    assert all(isinstance(text, str) for text in found["advice"])


def test_the_numbers_are_those_of_python(answer):
    found = answer(f"{IDENTIFY} --rows 50:350 --holdout 0.3 --spacing adaptive --levels 6")
    compared = dict.fromkeys(("diagonal", "slope", "lag"), "auto")
    result = Options.of({"holdout": 0.3, "spacing": "adaptive", "levels": 6, **compared}).identify(
        Record(*(part[50:350] for part in record()))
    )
    assert found["samples"] == result.samples == 210
    assert found["nrmse_holdout"] == result.holdout_nrmse
    assert found["baseline_nrmse_holdout"] == result.baseline_nrmse
    assert found["rank"] == result.rank
    assert found["advice"] == list(result.advice)


def test_a_lag_is_found_and_kept_in_the_file(answer, model):
    u, _ = record()
    y = model.simulate(u)
    late = np.concatenate([np.full(3, y[0]), y[:-3]])
    np.savetxt("late.csv", np.column_stack([u, late]), delimiter=",", header="u,y", comments="")
    line = "identify late.csv --input u --output y --levels 8 --lag auto --save late.json"
    assert answer(line)["lag_samples"] == 3
    assert modelfile.read("late.json").lag == 3
    predicted = answer("simulate late.json late.csv --input u")["y"]
    np.testing.assert_allclose(predicted[3:], late[3:], atol=0.02 * np.ptp(y))


def test_the_rank_of_a_large_plane_is_worked_out_when_asked(monkeypatch, run):
    monkeypatch.setattr(plane_result, "_MOST_RANKED", 10)
    assert "not computed, see --rank" in run(f"{IDENTIFY} -v")[1]
    assert json.loads(run(f"{IDENTIFY} --json")[1])["rank"] is None
    assert json.loads(run(f"{IDENTIFY} --rank --json")[1])["rank"] > 30


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("voltage,length\n1,2\nabc,3\n", "'abc' in row 3"),
        ("voltage,length\n1,2\n,3\n", "empty in row 3"),
        ("voltage,length\n1,2\n3,inf\n", "'inf' in row 3"),
        ("voltage,length\n1,2\n3,4\n", "2 outputs are finite; at least 3 are needed"),
        ("voltage,length\n" + "1,2\n1,3\n" * 3, "the input is 1 throughout"),
        ("voltage,length\n-1e308,1\n1e308,2\n0,3\n", "the input reaches 1e+308; scale it"),
        ("voltage,length\n-1e-320,1\n1e-320,2\n0,3\n", "the input changes by"),
        ("volts,length\n1,2\n", "no column 'voltage', it has 'volts', 'length'; did you mean"),
        ("", "empty"),
        ("voltage,length\n", "no rows"),
    ],
)
def test_files_that_cannot_be_used(content, says, refused):
    Path("bad.csv").write_text(content)
    said = refused("identify bad.csv --input voltage --output length --save new.json")
    assert says in said
    assert len(said) < 300
    assert not Path("new.json").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--levels 0", "levels is 0; give a whole number"),
        ("--levels many", "'--levels': 'many' is not a whole number"),
        ("--lag -1", 'lag is -1; give "auto" or whole samples from 0 to 399'),
        ("--lag 398", "a lag of 398 leaves 2 measured samples"),
        ("--lag soon", "--lag is 'soon'; give auto or a whole number"),
        ("--rows 5", "such as 200:7000"),
        ("--rows 9:3", "holds no row; give A:B with A below B"),
        ("--holdout 2", "holdout is 2.0; give a share from 0 to 0.9"),
        ("--holdout some", "'some' is not a number"),
        ("--smoothness -1", "smoothness is -1"),
        ("--smoothness much", "--smoothness is 'much'; give auto or a number"),
        ("--spacing odd", "spacing is 'odd'; give one of 'uniform', 'adaptive'"),
        ("--start odd", "start is 'odd'; give one of 'negative', 'positive', 'demagnetised'"),
        ("--output voltage", "both 'voltage .V.'; give two columns"),
    ],
)
def test_options_that_cannot_be_used(options, says, refused):
    said = refused(f"{IDENTIFY} {options} --save new.json")
    assert re.search(says, said), said
    assert not Path("new.json").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--save missing/new.json", "the folder missing does not exist; make it first"),
        ("--save model.json", "model.json exists already; .* or --force to replace it"),
        ("--save new.json --report ./new.json", "is given for two results"),
        ("--save good.csv --force", "good.csv is an input and is not replaced"),
    ],
)
def test_places_are_checked_before_the_work(options, says, refused, monkeypatch):
    def too_late(*args, **options):
        pytest.fail("the work was begun")

    monkeypatch.setattr(minorloop.identification, "identify", too_late)
    before = {path: path.read_bytes() for path in Path().iterdir()}
    said = refused(f"{IDENTIFY} {options}")
    assert re.search(says, said), said
    assert {path: path.read_bytes() for path in Path().iterdir()} == before


@pytest.mark.parametrize("as_json", ["", "--json"])
def test_a_report_that_cannot_be_drawn_costs_neither_model_nor_numbers(as_json, run, monkeypatch):
    def fail(*args, **options):
        raise RuntimeError("no fonts")

    monkeypatch.setattr(minorloop.report.Report, "html", fail)
    line = f"{IDENTIFY} --save new.json --report new.html {as_json}"
    status, out, err = run(line)
    assert status == 2
    assert err == "error: new.html was not written, the report cannot be drawn: no fonts\n"
    assert modelfile.load("new.json").bands == 8
    if as_json:
        assert json.loads(out)["unknowns"] == 37
    else:
        assert "best delayed polynomial" in out


def test_a_model_that_cannot_be_saved_costs_neither_report_nor_numbers(run, monkeypatch):
    def fail(*args, **options):
        raise OutputError("new.json cannot be written: No space left on device")

    monkeypatch.setattr(modelfile, "save", fail)
    status, out, err = run(f"{IDENTIFY} --save new.json --report new.html")
    assert status == 2
    assert err == "error: new.json cannot be written: No space left on device\n"
    assert "best delayed polynomial" in out
    assert "<img" in Path("new.html").read_text()


def test_data_that_vanish_meanwhile_cost_nothing(run, monkeypatch):
    def vanishing(*args, **options):
        Path("good.csv").unlink()
        return Options.of(options).identify(Record(*args))

    monkeypatch.setattr(minorloop.identification, "identify", vanishing)
    digest = hashlib.sha256(Path("good.csv").read_bytes()).hexdigest()
    assert run(f"{IDENTIFY} --save new.json --report new.html")[0] == 0
    assert modelfile.read("new.json").provenance.sha256 == digest


def stuck():
    """The record, stuck for a fifth, as a file."""
    table = np.loadtxt("good.csv", delimiter=",", skiprows=1)
    table[200:280, 1] = table[200, 1]
    np.savetxt("stuck.csv", table, delimiter=",", header="voltage [V],length [um]", comments="")


def test_a_model_not_to_be_trusted_says_so_in_its_status_its_file_and_its_report(run):
    stuck()
    line = f"{IDENTIFY.replace('good', 'stuck')} --holdout 0.3"
    status, out, err = run(f"{line} --save new.json --report new.html")
    assert status == 1
    assert "! the output is stuck at" in out
    assert err.startswith("warning: this model is not to be trusted: the first")
    assert "model written to new.json" in out
    warnings = modelfile.read("new.json").warnings
    assert "from sample 200 to 279" in warnings[0]
    assert warnings[0][:60] in Path("new.html").read_text()
    with pytest.warns(modelfile.ModelWarning, match=r"new.json: the output is stuck"):
        modelfile.load("new.json")
    status, out, err = run(f"{line} --json")
    assert (status, err) == (1, "")
    found = json.loads(out)
    assert found["warnings"] == list(warnings)
    assert found["advice"][0] == warnings[0]


def test_samples_are_counted_from_the_first_row_used(answer, run):
    stuck()
    line = f"{IDENTIFY.replace('good', 'stuck')} --rows 50:400"
    out = " ".join(run(f"{line} -v")[1].split())
    assert "from sample 150 to 229" in out
    assert "samples are counted from row 50 of the file here" in out


def numbered(name="numbered.csv", curves=6, each=40):
    """Curves of the record, each simulated alone, with their number."""
    u, _ = record()
    model = modelfile.read("model.json").model
    rows = []
    for k in range(curves):
        part = u[k * each : (k + 1) * each]
        rows.append(np.column_stack([np.full(each, k), part, model.simulate(part, "positive")]))
    header = "curve,voltage [V],length [um]"
    np.savetxt(name, np.concatenate(rows), delimiter=",", header=header, comments="")


def test_curves_of_a_column_are_reset_and_left_out(model, run, answer):
    modelfile.save(model, "model.json", force=True)
    numbered()
    line = f"{IDENTIFY.replace('good', 'numbered')} --no-slope --diagonal {model.diagonal}"
    found = answer(f"{line} --curves curve --start-of-curve positive --skip 2")
    assert found["skipped"] == 12
    assert found["samples"] == 6 * 38
    assert found["nrmse_groups"] < 0.02
    assert [curve["name"] for curve in found["curves"]] == [f"{k}" for k in range(6)]
    assert found["curves"][5]["accuracy"]["samples"] == 38
    assert found["band_sd"] > 0
    shown = run(f"{line} --curves curve --start-of-curve positive --report curves.html -v")[1]
    assert "errors over the range of the record, by curve" in shown
    assert "Curve by curve" in Path("curves.html").read_text()
    assert run(f"{line} --groups curve")[0] == 1  # one curve for all: not to be trusted
    header, *rows = Path("numbered.csv").read_text().splitlines()
    named = [f"wire {'abcdef'[int(row[0])]},{row.split(',', 1)[1]}" for row in rows]
    Path("numbered.csv").write_text("\n".join([header, *named]))
    again = answer(f"{line} --curves curve --start-of-curve positive --skip 2")
    assert again["nrmse_groups"] == found["nrmse_groups"]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--start-of-curve positive", "without curves; give curves (--curves)"),
        ("--curves voltage", "groups of one row"),
        ("--curves length --start-of-curve upside", "(--start-of-curve) is 'upside'; give one of"),
        ("--skip 399", "skip leaves 1 measured rows"),
    ],
)
def test_refuses_curves_and_groups_that_cannot_be(options, says, run):
    status, out, err = run(f"{IDENTIFY} {options}")
    assert (status, out) == (2, "")
    assert says in " ".join(err.split())


def test_the_choices_and_the_residual_are_in_the_json(answer, run):
    found = answer(f"{IDENTIFY} --lag auto")
    assert [choice["name"] for choice in found["choices"]] == ["structure"]
    assert found["residual"]["worst_sample"] < 400
    assert "chosen structure: " in run(f"{IDENTIFY} --report chosen.html -v")[1]
    assert "Chosen structure: " in Path("chosen.html").read_text()


def test_a_model_is_made_from_a_data_sheet(run, answer):
    line = "identify --from-loop 12.8 0.58 1.5 --field 217 --input 'H [A/m]' --output 'B [T]'"
    status, out, err = run(f"{line} --save sheet.json")
    assert (status, err) == (0, "")
    assert "model written to sheet.json\nB [T] against H [A/m]: Preisach" in out
    assert "! this model was made from a data sheet" in out
    known = modelfile.read("sheet.json")
    assert (str(known.input), str(known.output)) == ("H [A/m]", "B [T]")
    assert known.model.simulate([217.0, 0.0]) == pytest.approx([1.5, 0.58], abs=1e-6)
    found = answer(line)
    assert (found["coercivity"], found["field"]) == (12.8, 217)
    assert found["warnings"] == list(known.warnings)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--from-loop 0 0.5 1", "coercivity is 0; give a positive number"),
        ("--from-loop 1 x 2", "--from-loop is '1 x 2'; give three numbers"),
        ("--from-loop 1 0.5", "requires 3 arguments"),
        ("--from-loop 1 0.5 1 --levels 5", "--levels cannot be combined with --from-loop"),
        ("good.csv --field 3", "--field is given without --from-loop"),
        ("", "Missing argument 'file'; see minorloop identify --help, or give --from-loop"),
    ],
)
def test_refuses_what_is_no_data_sheet(options, says, refused):
    assert says in refused(f"identify {options}")


def test_a_ridge_is_the_mean_of_the_prior(run, refused):
    u = np.concatenate([np.linspace(-1, 1, 30), np.linspace(1, -1, 30)])
    ridge = LorentzianDensity(0.3, 0.2, 0.15)
    y = Preisach.from_density(np.linspace(-1, 1, 9), ridge).simulate(u)
    rows = np.column_stack([u, y + 1e-3 * np.random.default_rng(1000).normal(size=60)])
    np.savetxt("loop.csv", rows, delimiter=",", header="u,y", comments="")
    line = "identify loop.csv --input u --output y --levels 8 --lag 0 --prior gaussian"
    assert json.loads(run(f"{line} --mean ridge --json")[1])["ridge"]["coercive"] > 0
    assert json.loads(run(f"{line} --json")[1])["ridge"] is None
    assert "mean is 'odd'; give one of 'zero', 'ridge'" in refused(f"{line} --mean odd")

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

import minorloop.identification
import minorloop.report
from minorloop import __version__, modelfile
from minorloop.cli import _identification_output as output
from minorloop.cli import identify as verb
from minorloop.errors import OutputError
from minorloop.identification import design_matrix, identify
from minorloop.lab import text_tables
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
    assert found.model == identify(*record(), levels=8, holdout=0.2, **chosen).model
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
    result = identify(
        *(part[50:350] for part in record()), holdout=0.3, spacing="adaptive", levels=6, **compared
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


def test_an_empty_cell_was_not_measured(answer):
    lines = Path("good.csv").read_text().splitlines()
    lines[5] = lines[5].split(",")[0] + ","
    Path("gap.csv").write_text("\n".join(lines))
    assert answer(IDENTIFY.replace("good", "gap"))["samples"] == 399


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_semicolons_and_letters_of_any_language(mark, answer):
    text = Path("good.csv").read_text().replace(",", ";").replace("voltage [V]", "Spannung Ü [µV]")
    Path("umlaut.csv").write_text(mark + text, encoding="utf-8")
    line = 'identify umlaut.csv --input "Spannung Ü" --output length --levels 8 --save ü.json'
    answer(line)
    assert str(modelfile.read("ü.json").input) == "Spannung Ü [µV]"


def test_advice_is_printed_for_an_input_that_cannot_identify(run):
    u = np.concatenate([np.linspace(-1, 1, 40), np.linspace(1, -1, 40)])
    rows = np.column_stack([u, np.concatenate([u[:40] ** 3, u[40:] ** 3 + 1 - u[40:] ** 2])])
    np.savetxt("loop.csv", rows, delimiter=",", header="u,y", comments="")
    out = " ".join(run("identify loop.csv --input u --output y --levels 12")[1].split())
    assert "one major loop" in out
    assert "one major loop" in out


def test_the_rank_of_a_large_plane_is_worked_out_when_asked(monkeypatch, run):
    monkeypatch.setattr(output, "_MOST_RANKED", 10)
    assert "not computed (--rank)" in run(IDENTIFY)[1]
    assert json.loads(run(f"{IDENTIFY} --json")[1])["rank"] is None
    assert json.loads(run(f"{IDENTIFY} --rank --json")[1])["rank"] > 30


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("voltage,length\n1,2\nabc,3\n", "'abc' in row 3"),
        ("voltage,length\n1,2\n,3\n", "empty in row 3"),
        ("voltage,length\n1,2\nnan,3\n", "'nan' in row 3"),
        ("voltage,length\n1,2\n-inf,3\n", "'-inf' in row 3"),
        ("voltage,length\n1,2\n3,inf\n", "'inf' in row 3"),
        ("voltage,length\n1,2\n3,x y\n", "'x y' in row 3"),
        ("voltage,length\n1,2\n1_000,3\n", "'1_000' in row 3"),
        ('voltage,length\n1,2\n"0,5",3\n', "'0,5' in row 3; write decimals with a point"),
        ("voltage,length\n1,2\n" + "z" * 5000 + ",3\n", "zzz...' in row 3"),
        ("voltage,length\n1,2\n" + "z" * 200_000 + ",3\n", "not a table"),
        ("voltage,length\n1,2\n3,4\n", "2 outputs are finite; at least 3 are needed"),
        ("voltage,length\n1,2\n3,\n4,\n5,6\n", "2 outputs are finite"),
        ("voltage,length\n" + "1,2\n1,3\n" * 3, "the input is 1 throughout"),
        ("voltage,length\n" + "1,2\n2,2\n" * 3, "the output is 2 throughout"),
        ("voltage,length\n-1e308,1\n1e308,2\n0,3\n", "the input reaches 1e+308; scale it"),
        ("voltage,length\n1,-1e308\n2,1e308\n0,3\n", "the output reaches 1e+308; scale it"),
        ("voltage,length\n-1e-320,1\n1e-320,2\n0,3\n", "the input changes by"),
        ("voltage,length\n1,2\n3\n", "row 3 of bad.csv has 1 cell, the header has 2"),
        ("voltage,length\n1,2\n3,4,5\n", "row 3 of bad.csv has 3 cells"),
        ("volts,length\n1,2\n", "no column 'voltage', it has 'volts', 'length'; did you mean"),
        ("Voltage,length\n1,2\n", "did you mean 'Voltage'?"),
        ("voltage [V],voltage [kV],length\n1,2,3\n", "could be any of"),
        ("voltage,voltage,length\n1,2,3\n", "two columns named 'voltage'"),
        ("1,2\n3,4\n5,6\n", "begins with numbers"),
        ("", "empty"),
        ("\n\n", "empty"),
        ("voltage,length\n", "no rows"),
        ("voltage,length\n\n\n", "no rows"),
        ("\0\1\2\n", "looks like a binary file"),
    ],
)
def test_files_that_cannot_be_used(content, says, refused):
    Path("bad.csv").write_text(content)
    said = refused("identify bad.csv --input voltage --output length --save new.json")
    assert says in said
    assert len(said) < 300
    assert not Path("new.json").exists()


def test_places_that_hold_no_table(refused, tmp_path):
    Path("latin.csv").write_bytes(b"voltage,L\x9dnge\n1,2\n")
    Path("image.csv").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 40)
    for name, says in (
        ("latin.csv", "neither UTF-8 nor Windows-1252"),
        ("image.csv", "image.csv"),
        ("nope.csv", "nope.csv does not exist"),
        (str(tmp_path), "is a folder"),
        ("/dev/null", "not a regular file"),
        ("n" * 300, "cannot be read"),
    ):
        assert says in refused(f"identify {name} --input voltage --output length")


def test_a_file_too_large_is_not_begun(refused, monkeypatch):
    monkeypatch.setattr(text_tables, "MAX_BYTES", 100)
    said = refused(IDENTIFY)
    assert "more than the 100 that are read; split it" in said


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--levels 0", "levels is 0; give a whole number"),
        ("--levels -5", "levels is -5"),
        ("--levels 501", "levels are 501 bands, .* give at most 500"),
        ("--levels 100000", "levels are 100000 bands, .* give at most 500"),
        (f"--levels {10**30}", "at most 500"),
        ("--levels many", "'--levels': 'many' is not a whole number"),
        ("--levels 2.5", "'2.5' is not a whole number"),
        ("--lag -1", 'lag is -1; give "auto" or whole samples from 0 to 399'),
        ("--lag 400", "lag is 400"),
        ("--lag 398", "a lag of 398 leaves 2 measured samples"),
        ("--lag soon", "--lag is 'soon'; give auto or a whole number"),
        ("--lag 1.5", "--lag is '1.5'; give auto or a whole number"),
        ("--rows 5", "such as 200:7000"),
        ("--rows 900:950", "the file has 400 rows"),
        ("--rows 0:4000", "give A:B from 0 to 400"),
        ("--rows 9:3", "holds no row; give A:B with A below B"),
        ("--rows 0:2", "2 outputs are finite"),
        ("--holdout 2", "holdout is 2.0; give a share from 0 to 0.9"),
        ("--holdout -0.1", "0 to 0.9"),
        ("--holdout nan", "0 to 0.9"),
        ("--holdout some", "'some' is not a number"),
        ("--rows 0:4 --holdout 0.5", "leaves 2 of 4"),
        ("--smoothness -1", "smoothness is -1"),
        ("--smoothness nan", "smoothness is nan"),
        ("--smoothness inf", "smoothness is inf"),
        ("--smoothness much", "--smoothness is 'much'; give auto or a number"),
        ("--spacing odd", "spacing is 'odd'; give one of 'uniform', 'adaptive'"),
        ("--relay odd", "'bipolar', 'unipolar'"),
        ("--diagonal odd", "'uniform', 'reversible'"),
        ("--start odd", "start is 'odd'; give one of 'negative', 'positive', 'demagnetised'"),
        ("--output voltage", "both 'voltage .V.'; give two columns"),
    ],
)
def test_options_that_cannot_be_used(options, says, refused):
    said = refused(f"{IDENTIFY} {options} --save new.json")
    assert re.search(says, said), said
    assert not Path("new.json").exists()


def test_a_plane_too_fine_is_refused_before_it_takes_memory(refused, monkeypatch):
    monkeypatch.setattr(design_matrix, "MOST_BANDS", 7)
    assert "levels are 8 bands" in refused(IDENTIFY)
    assert "levels are 8 bands" in refused("plan decaying --low 0 --high 1 --levels 8")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--save missing/new.json", "the folder missing does not exist; make it first"),
        ("--report missing/new.html", "the folder missing does not exist; make it first"),
        ("--save .", "is a folder"),
        ("--save good.csv/new.json", "good.csv does not exist; make it first|cannot be written"),
        ("--save model.json", "model.json exists already; .* or --force to replace it"),
        ("--save new.json --report targets.csv", "targets.csv exists already"),
        ("--save new.json --report ./new.json", "is given for two results"),
        ("--save good.csv --force", "good.csv is an input and is not replaced"),
        ("--report /dev/null --force", "not a regular file"),
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


def test_force_replaces(run, refused):
    Path("old.json").write_text("precious")
    assert "--force" in refused(f"{IDENTIFY} --save old.json")
    assert Path("old.json").read_text() == "precious"
    assert run(f"{IDENTIFY} --save old.json --force")[0] == 0
    assert modelfile.load("old.json").bands == 8


@pytest.mark.parametrize("as_json", ["", "--json"])
def test_a_report_that_cannot_be_drawn_costs_neither_model_nor_numbers(as_json, run, monkeypatch):
    def fail(*args, **options):
        raise RuntimeError("no fonts")

    monkeypatch.setattr(minorloop.report, "identification_report", fail)
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


def test_numbers_that_cannot_be_shown_cost_neither_model_nor_report(run, monkeypatch):
    def fail(*args, **options):
        raise BrokenPipeError

    monkeypatch.setattr(verb, "show", fail)
    status, _, err = run(f"{IDENTIFY} --save new.json --report new.html --json")
    assert (status, err) == (1, "")
    assert modelfile.load("new.json").bands == 8
    assert "<img" in Path("new.html").read_text()


def test_data_that_vanish_meanwhile_cost_nothing(run, monkeypatch):
    def vanishing(*args, **options):
        Path("good.csv").unlink()
        return identify(*args, **options)

    monkeypatch.setattr(minorloop.identification, "identify", vanishing)
    digest = hashlib.sha256(Path("good.csv").read_bytes()).hexdigest()
    assert run(f"{IDENTIFY} --save new.json --report new.html")[0] == 0
    assert modelfile.read("new.json").provenance.sha256 == digest


def test_an_interruption_is_no_traceback(run, monkeypatch):
    def interrupted(*args, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(minorloop.identification, "identify", interrupted)
    assert run(f"{IDENTIFY} --save new.json") == (130, "", "interrupted\n")
    assert not Path("new.json").exists()


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
    out = " ".join(run(line)[1].split())
    assert "from sample 150 to 229" in out
    assert "samples are counted from row 50 of the file here" in out


def test_an_overload_code_is_left_out_and_named(answer):
    lines = Path("good.csv").read_text().splitlines()
    lines[5] = lines[5].split(",")[0] + ",9.9e37"
    Path("over.csv").write_text("\n".join(lines))
    found = answer(IDENTIFY.replace("good", "over"))
    assert (found["samples"], found["codes"], found["warnings"]) == (399, [4], [])
    assert "sample 4 (9.9e+37)" in found["advice"][0]


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
    shown = run(f"{line} --curves curve --start-of-curve positive --report curves.html")[1]
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
        ("--groups other", "no column 'other'"),
        ("--curves length --start-of-curve upside", "(--start-of-curve) is 'upside'; give one of"),
        ("--skip 399", "skip leaves 1 measured rows"),
        ("--skip x", "'x' is not a whole number"),
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
    assert "chosen structure: " in run(f"{IDENTIFY} --report chosen.html")[1]
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
        ("good.csv --from-loop 1 0.5 1", "a file cannot be combined with --from-loop"),
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

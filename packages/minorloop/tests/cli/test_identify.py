import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import minorloop.identification
import minorloop.report
from minorloop import Record, __version__, modelfile
from minorloop.identification.pipeline import Options

IDENTIFY = "identify good.csv --input voltage --output length --law levels=8"


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
    line = f"{IDENTIFY.replace('good', 'numbered')} --law diagonal={model.diagonal},slope=no"
    found = answer(f"{line} --record curves=curve,start_of_curve=positive,skip=2")
    assert found["skipped"] == 12
    assert found["samples"] == 6 * 38
    assert found["nrmse_groups"] < 0.02
    assert [curve["name"] for curve in found["curves"]] == [f"{k}" for k in range(6)]
    assert found["curves"][5]["accuracy"]["samples"] == 38
    assert found["band_sd"] > 0
    shown = run(f"{line} --record curves=curve,start_of_curve=positive --report curves.html -v")[1]
    assert "errors over the range of the record, by curve" in shown
    assert "Curve by curve" in Path("curves.html").read_text()
    assert run(f"{line} --record groups=curve")[0] == 1  # one curve for all: not to be trusted
    header, *rows = Path("numbered.csv").read_text().splitlines()
    named = [f"wire {'abcdef'[int(row[0])]},{row.split(',', 1)[1]}" for row in rows]
    Path("numbered.csv").write_text("\n".join([header, *named]))
    again = answer(f"{line} --record curves=curve,start_of_curve=positive,skip=2")
    assert again["nrmse_groups"] == found["nrmse_groups"]


def test_a_refused_table_does_not_wait_for_compiled_code(tmp_path):
    table = tmp_path / "wide.csv"
    table.write_text(",".join(f"c{k}" for k in range(20_000)) + "\n")
    told = (
        "import sys; from minorloop.__main__ import main\n"
        f"sys.argv = ['minorloop', 'identify', {str(table)!r}, '--input', 'u', '--output', 'y']\n"
        "print(main(), 'numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["2", "False"], done.stderr

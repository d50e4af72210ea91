import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import minorloop.identification
import minorloop.report
from minorloop import __version__, modelfile

IDENTIFY = "identify good.csv --input voltage --output length --law levels=8"


def test_from_a_file_to_a_model_with_its_origin(run):
    status, out, err = run(f"{IDENTIFY} --holdout 0.2 --save new.json --report new.html")
    assert (status, err) == (0, "")
    assert "length [um] against voltage [V]: Preisach, 8 bands" in out
    assert "model written to new.json" in out
    assert "report written to new.html" in out
    found = modelfile.read("new.json")
    assert (str(found.input), str(found.output), found.lag) == ("voltage [V]", "length [um]", 0)
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
    shown = " ".join(out.split())
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
    assert len(found["advice"]) > len(warnings)
    assert all(sentence in shown for sentence in found["advice"][:5])


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

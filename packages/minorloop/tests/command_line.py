"""A folder with files, and the command line as a user calls it."""

import json
import shlex

import numpy as np
import pytest

from minorloop import Preisach, modelfile
from minorloop.cli import main
from minorloop.cli._compilation import COMPILES

LEVELS = np.linspace(-1, 1, 9)
MODEL = Preisach(LEVELS, np.tril(np.random.default_rng(0).uniform(size=(8, 8))), 0.4)


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch, without_pictures):
    """A separate folder with a record, targets and a model."""
    monkeypatch.chdir(tmp_path)
    write_files()


def write_files():
    """Write a record, targets and a model into the folder that is the current one."""
    u = np.concatenate([[-1, 1], np.random.default_rng(1).uniform(-1, 1, 398)])
    write("good.csv", "voltage [V],length [um]", np.column_stack([u, MODEL.simulate(u)]))
    write("targets.csv", "length [um]", [[0.3], [1.5], [-2.0]])
    modelfile.save(MODEL, "model.json", input="voltage [V]", output="length [um]")


def write(name, header, rows):
    np.savetxt(name, rows, delimiter=",", header=header, comments="", fmt="%s")


@pytest.fixture
def model():
    """The model of the simulated record."""
    return MODEL


@pytest.fixture
def program():
    """What carries out the words of a command line."""
    return main


@pytest.fixture
def run(capsys, program):
    """Return exit status, stdout and stderr of a command line, but for what compiles once."""

    def run(line):
        status = program(shlex.split(line))
        shown = capsys.readouterr()
        said = [each for each in shown.err.splitlines(keepends=True) if COMPILES not in each]
        return status, shown.out, "".join(said)

    return run


@pytest.fixture
def planned(_somewhere, run):
    """A plan of 11 levels in plan.csv."""
    line = "plan decaying --low -1.2 --high 1.2 --levels 4 --hold 30 --save plan.csv"
    assert run(f'{line} --input "voltage [V]"')[0] == 0


@pytest.fixture
def refused(run):
    """Return the error, after checking that it is one line."""

    def refused(line):
        status, out, err = run(line)
        assert (status, out) == (2, "")
        assert err.startswith("error: ")
        assert err.count("\n") == 1
        assert "Traceback" not in err
        return err

    return refused


@pytest.fixture
def answer(run):
    """Return the JSON object that ``--json`` prints."""

    def forbidden(constant):
        raise AssertionError(f"{constant} is not JSON")

    def answer(line):
        status, out, err = run(f"{line} --json")
        assert (status, err) == (0, "")
        assert out.count("\n") == 1
        found = json.loads(out, parse_constant=forbidden)
        assert isinstance(found, dict)
        return found

    return answer

"""Tests of the program as a whole, for all verbs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from minorloop import __main__ as program
from minorloop import __version__, modelfile

VERBS = ("identify", "simulate", "score", "invert", "plan", "demo")
PROGRAM = [sys.executable, "-m", "minorloop"]


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself_with_an_example(verb, run):
    status, out, err = run(f"{verb} --help")
    assert (status, err) == (0, "")
    assert f"Example: minorloop {verb} " in " ".join(out.split())


def test_says_its_version(run):
    assert run("--version") == (0, f"minorloop {__version__}\n", "")


def test_errors_are_short_and_without_control_characters(refused):
    Path("odd.csv").write_text("a\x1b[31m,b\n1,2\n", encoding="utf-8")
    said = refused("simulate model.json odd.csv --input voltage")
    assert "\x1b" not in said
    assert "U+001B; leave out what cannot be printed" in said
    Path("wide.csv").write_text("x" * 100_000 + ",b\n1,2\n")
    assert len(refused("simulate model.json wide.csv --input voltage")) < 1000
    assert len(refused(f"simulate model.json good.csv --input {'v' * 100_000}")) < 1000


class _Interrupting:
    """A finder of modules during whose work Ctrl-C is pressed."""

    def find_spec(self, name, *_):
        if name == "minorloop.cli":
            raise KeyboardInterrupt


def test_an_interruption_while_modules_are_loaded_gives_no_traceback(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "minorloop.cli")
    monkeypatch.setattr(sys, "meta_path", [_Interrupting(), *sys.meta_path])
    assert program.main() == 130
    assert capsys.readouterr() == ("", "interrupted\n")


def test_the_program_imports_its_verbs_when_it_is_called_and_nothing_heavy_for_help():
    """Nor does a process that it starts import the command line."""
    code = (
        "import sys, minorloop.__main__; assert 'minorloop.cli' not in sys.modules; "
        "from minorloop.cli import main; main(['--help']); "
        "assert not {'numpy', 'numba', 'scipy', 'matplotlib'} & set(sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


def test_a_unit_that_the_terminal_cannot_show_is_replaced():
    found = modelfile.read("model.json")
    modelfile.save(found.model, "model.json", output="length [µm]", force=True)
    Path("targets.csv").write_text("length\n0.3\n1.5\n-2.0\n")
    command = [*PROGRAM, "invert", "model.json", "targets.csv", "--target", "length"]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert r"\xb5m" in done.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a disk that is full")
def test_a_full_disk_gives_an_error_in_one_line():
    command = [*PROGRAM, "simulate", "model.json", "good.csv", "--input", "voltage", "--json"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("error: something could not be read or written")
    assert done.stderr.count("\n") == 1


def test_an_output_that_is_closed_gives_no_message():
    ends = os.pipe()
    os.close(ends[0])
    command = [*PROGRAM, "--version"]
    done = subprocess.run(command, stdout=ends[1], stderr=subprocess.PIPE, text=True)
    os.close(ends[1])
    assert (done.returncode, done.stderr) == (1, "")

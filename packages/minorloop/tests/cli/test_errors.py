"""Errors as JSON, and hints for verbs that do not exist."""

import json

import pytest

from minorloop import SafetyError, modelfile


@pytest.fixture
def failed(run):
    """Return the exit status and the error of a command line with ``--json``."""

    def failed(line):
        status, out, err = run(f"{line} --json")
        found = json.loads(out)
        assert list(found) == ["error"]
        assert err.removeprefix("error: ") == f"{found['error']['message']}\n"
        return status, found["error"]

    return failed


@pytest.mark.parametrize(
    ("line", "kind", "says"),
    [
        ("simulate nope.json good.csv --input voltage", "ModelFileError", "there is no file"),
        ("simulate model.json nope.csv --input a", "RecordError", "nope.csv does not exist"),
        ("simulate model.json", "UsageError", "Missing argument"),
        ("fit good.csv", "UsageError", "No such command 'fit'"),
    ],
)
def test_an_error_is_also_one_json_object(line, kind, says, failed):
    status, error = failed(line)
    assert (status, error["kind"]) == (2, kind)
    assert says in error["message"]


def compiler_stopped():
    """The error that numba raises when it is interrupted."""
    error = RuntimeError("no compiled object yet")
    error.__context__ = KeyboardInterrupt()
    return error


@pytest.mark.parametrize(
    ("error", "status", "kind", "says"),
    [
        (SafetyError("the source may be on"), 3, "SafetyError", "error: the source may be on"),
        (KeyboardInterrupt(), 130, "Interrupted", "interrupted\n"),
        (compiler_stopped(), 130, "Interrupted", "interrupted\n"),
        (MemoryError(), 2, "MemoryError", "error: there is not enough memory"),
        (OSError(5, "Input/output error"), 2, "OSError", "error: something could not be read or"),
        (BrokenPipeError(), 1, None, ""),
    ],
)
def test_any_error_gives_a_status_and_no_traceback(error, status, kind, says, run, monkeypatch):
    def fail(path):
        raise error

    monkeypatch.setattr(modelfile, "read", fail)
    line = "simulate model.json good.csv --input voltage"
    done, out, err = run(line)
    assert (done, out) == (status, "")
    assert err.startswith(says)
    assert err.count("\n") == bool(says)
    done, out, _ = run(f"{line} --json")
    assert done == status
    assert kind is None or json.loads(out)["error"]["kind"] == kind

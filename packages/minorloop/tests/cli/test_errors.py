"""Errors as JSON, and hints for verbs that do not exist."""

import json

import pytest

from minorloop import SafetyError, modelfile


def test_a_verb_that_does_not_exist_is_also_one_json_object(run):
    status, out, err = run("fit good.csv --json")
    error = json.loads(out).pop("error")
    assert (status, error["kind"]) == (2, "UsageError")
    assert err == f"error: {error['message']}\n"
    assert "No such command 'fit'" in err


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
    done, out, err = run(f"{line} --json")
    assert done == status
    if kind is not None:
        (found,) = json.loads(out).values()
        assert found["kind"] == kind
        assert err.removeprefix("error: ") == f"{found['message']}\n"

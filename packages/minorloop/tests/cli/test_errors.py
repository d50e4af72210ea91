"""Errors as JSON, and hints for verbs that do not exist."""

import json

import pytest

from minorloop import modelfile
from minorloop.cli import _common
from minorloop.errors import OutputError, SafetyError


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


@pytest.mark.parametrize(
    ("error", "status", "kind"),
    [
        (SafetyError("the source may be on"), 3, "SafetyError"),
        (KeyboardInterrupt(), 130, "Interrupted"),
        (MemoryError(), 2, "MemoryError"),
        (OSError(5, "Input/output error"), 2, "OSError"),
    ],
)
def test_the_exit_status_is_the_same_as_without_json(error, status, kind, failed, monkeypatch):
    def fail(path):
        raise error

    monkeypatch.setattr(modelfile, "read", fail)
    done, found = failed("simulate model.json good.csv --input voltage")
    assert (done, found["kind"]) == (status, kind)


def test_a_result_that_is_printed_stays_the_only_object(run, monkeypatch):
    printed = _common.print_json

    def fail_later(content):
        printed(content)
        raise OutputError("the report cannot be written")

    monkeypatch.setattr(_common, "print_json", fail_later)
    status, out, err = run("simulate model.json good.csv --input voltage --json")
    assert (status, err) == (2, "error: the report cannot be written\n")
    assert "error" not in json.loads(out)


def test_a_mistyped_verb_leads_to_the_right_one(refused):
    assert refused("identfy").endswith("Did you mean 'identify'?\n")

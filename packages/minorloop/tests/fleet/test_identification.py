import csv
import dataclasses
import json
import os
import sys
import threading

import numpy as np
import pytest

from fleet_records import write_manifest, write_record
from minorloop import load
from minorloop.errors import MissingExtraError, OutputError, ParameterError
from minorloop.fleet import identification
from minorloop.fleet._fitting import Task, identify_one
from minorloop.fleet.identification import identify_fleet
from minorloop.fleet.manifest import Specimen
from minorloop.fleet.results import write_result

OPTIONS = {"levels": 6, "prior": "none", "smoothness": 0.0}


@pytest.fixture
def six(tmp_path):
    """Six specimens: one without a file, one with text for numbers."""
    for k in range(4):
        write_record(tmp_path / f"s{k}.csv", k)
    (tmp_path / "bad.csv").write_text("drive [V],tip [mm]\n0,1\nx,y\n")
    return write_manifest(tmp_path, ["s0", "s1", "gone", "bad", "s2", "s3"])


def test_failures_are_reported_and_a_stopped_fleet_continues(six, tmp_path):
    out, seen = tmp_path / "out", []
    summary = identify_fleet(
        six, out, workers=1, watch=lambda done, of, last: seen.append((done, of)), **OPTIONS
    )
    assert sorted(seen) == [(k, 6) for k in range(1, 7)]
    assert [one.specimen for one in summary.outcomes] == ["s0", "s1", "gone", "bad", "s2", "s3"]
    failed = {one.specimen: one.error for one in summary.failures}
    assert failed.keys() == {"gone", "bad"}
    assert "cannot be read: No such file" in failed["gone"]
    assert "bad.csv" in failed["bad"]
    assert all(one.nrmse < 1e-9 for one in summary.identified)
    model = load(out / "models" / "s2.json")
    record = np.loadtxt(tmp_path / "s2.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(model.simulate(record[:, 0]), record[:, 1], atol=1e-6)
    told = json.loads((out / "summary.json").read_text())
    assert (told["identified"], told["failed"]) == (4, 2)
    assert (out / "summary.csv").read_text().count("\n") == 7

    # Going on does what is missing, could not be read or has changed, and only that.
    (out / "results" / "s0.json").unlink()
    write_record(tmp_path / "gone.csv", 9)
    write_record(tmp_path / "s1.csv", 8)
    again = []
    summary = identify_fleet(
        six, out, workers=1, watch=lambda done, of, last: again.append(last.specimen), **OPTIONS
    )
    assert sorted(again) == ["gone", "s0", "s1"]
    assert [one.specimen for one in summary.failures] == ["bad"]

    # What failed is tried again when that is asked for.
    again.clear()
    summary = identify_fleet(
        six,
        out,
        workers=1,
        retry_failed=True,
        watch=lambda done, of, last: again.append(last.specimen),
        **OPTIONS,
    )
    assert again == ["bad"]
    with pytest.raises(OutputError, match="other options: levels was 6 and is 7 now; give"):
        identify_fleet(six, out, workers=1, **{**OPTIONS, "levels": 7})


def test_without_dask_the_extra_is_named(six, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"minorloop\[fleet\]"):
        identify_fleet(six, tmp_path / "out", address="tcp://127.0.0.1:1", **OPTIONS)


def test_errors_in_a_fit_are_returned_as_text(six, tmp_path):
    tasks = [Task(one, one.read(), OPTIONS) for one in six if one.file.exists()]

    def fit(task, **options):
        return identify_one(dataclasses.replace(task, options=options), tmp_path / "scratch.csv")

    assert "no option 'colour'" in fit(tasks[0], colour=1)["error"]
    assert "levels" in fit(tasks[0], levels=0)["error"]
    found = [fit(task, **OPTIONS) for task in tasks]
    assert ["error" in one for one in found] == [False, False, True, False, False]
    assert str(six[3].file) in found[2]["error"]
    assert not (tmp_path / "scratch.csv").exists()


def outcomes_of(seen):
    """Return a replacement of the workers that keeps names and identifies in this process."""

    def outcomes(pending, options, place, start, *reading):
        for one in pending:
            seen.append(one.name)
            task = Task(one, one.read(), options)
            found = identify_one(task, place / "scratch.csv")
            yield write_result(place, one, identification._with_digest(task, found))

    return outcomes


@pytest.mark.parametrize("change", ["input", "output", "file"])
def test_specimens_with_other_columns_are_identified_again(change, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(identification, "_outcomes", outcomes_of(seen))
    write_record(tmp_path / "s0.csv", 0)
    table = np.loadtxt(tmp_path / "s0.csv", delimiter=",", skiprows=1)
    np.savetxt(
        tmp_path / "s0.csv", table[:, [0, 1, 1, 0]], delimiter=",", header="u,y,z,w", comments=""
    )
    (tmp_path / "s1.csv").write_bytes((tmp_path / "s0.csv").read_bytes())
    one = Specimen("a", tmp_path / "s0.csv", "u", "y")
    changed = {"input": {"input": "w"}, "output": {"output": "z"}}
    changed["file"] = {"file": tmp_path / "s1.csv"}
    for specimen in (one, one, dataclasses.replace(one, **changed[change])):
        identify_fleet([specimen], tmp_path / "out", **OPTIONS)
    assert seen == ["a", "a"]


def test_the_folder_has_only_current_models_and_lists_strays(tmp_path, monkeypatch):
    seen, out = [], tmp_path / "out"
    monkeypatch.setattr(identification, "_outcomes", outcomes_of(seen))
    for name in "abc":
        write_record(tmp_path / f"{name}.csv", ord(name))
    specimens = write_manifest(tmp_path, "abc")
    assert identify_fleet(specimens, out, **OPTIONS).strays == []
    (tmp_path / "a.csv").write_text("nonsense")
    with (out / "models" / "b.json").open("a") as file:
        file.write(" ")
    seen.clear()
    summary = identify_fleet(specimens[:2], out, **OPTIONS)
    assert seen == ["a", "b"]
    assert [one.specimen for one in summary.failures] == ["a"]
    assert summary.strays == ["models/c.json", "results/c.json"]
    assert summary.plain()["strays"] == summary.strays
    assert "models/c.json does not belong to any specimen" in str(summary)
    assert sorted(file.name for file in (out / "models").iterdir()) == ["b.json", "c.json"]


def test_the_table_names_files_as_the_manifest_does(tmp_path, monkeypatch):
    monkeypatch.setattr(identification, "_outcomes", outcomes_of([]))
    (tmp_path / "lot1").mkdir()
    write_record(tmp_path / "lot1" / "s.csv", 0)
    specimens = write_manifest(tmp_path, ["lot1/s"])
    identify_fleet(specimens, tmp_path / "out", **OPTIONS)
    (row,) = csv.DictReader((tmp_path / "out" / "summary.csv").read_text().splitlines())
    assert row["file"] == "lot1/s.csv"


def test_the_first_model_is_written_alone(tmp_path, monkeypatch):
    written, others = [], threading.Event()

    def write_result(place, one, found):
        if one == "later":
            others.wait(60)
        written.append(one)

    monkeypatch.setattr(identification, "write_result", write_result)
    with identification._Writer(tmp_path) as writing:
        writing.begin("failed", {"error": "it has no model"})
        writing.begin("first", {"model": 1})
        assert "first" in written
        writing.begin("later", {"model": 2})
        assert "later" not in written
        others.set()


def test_refuses_a_pipe_as_record(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    one = Specimen("a", tmp_path / "pipe.csv", "u", "y")
    summary = identify_fleet([one], tmp_path / "out", **OPTIONS)
    assert "not a regular file" in summary.failures[0].error


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"workers": 0}, "workers is 0"),
        ({"colour": 1}, "'colour' is not an option of a fleet"),
        ({"levels": np.arange(3)}, "numbers, words and lists"),
        ({"relay": "foo"}, "relay is 'foo'"),
        ({"levels": 0}, "levels is 0"),
        ({"levels": 1000}, "levels is 1000"),
        ({"start": "sideways"}, "start is 'sideways'"),
        ({"prior": "foo"}, "prior is 'foo'"),
        ({"smoothness": float("nan")}, "smoothness is nan"),
        ({"lag": -1}, "lag is -1"),
    ],
)
def test_refuses_wrong_options(options, message, six, tmp_path):
    with pytest.raises(ParameterError, match=message):
        identify_fleet(six, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_workers_of_a_cluster_are_not_counted_here(six, tmp_path):
    with pytest.raises(ParameterError, match="give one of them"):
        identify_fleet(six, tmp_path / "out", workers=2, address="tcp://127.0.0.1:1", **OPTIONS)


@pytest.mark.parametrize("patience", [0, -1.0, float("nan"), float("inf")])
def test_refuses_a_wrong_patience(patience, six, tmp_path):
    with pytest.raises(ParameterError, match="patience is"):
        identify_fleet(six, tmp_path / "out", patience=patience, **OPTIONS)


@pytest.mark.parametrize("limit", [0, -1.0, float("nan")])
def test_refuses_a_wrong_limit(limit, six, tmp_path):
    with pytest.raises(ParameterError, match="limit is"):
        identify_fleet(six, tmp_path / "out", limit=limit, **OPTIONS)


def test_refuses_folders_with_other_content(six, tmp_path):
    with pytest.raises(ParameterError, match="no specimen"):
        identify_fleet([], tmp_path / "out")
    with pytest.raises(OutputError, match="not empty"):
        identify_fleet(six, tmp_path)
    (tmp_path / "fleet.json").write_text("[]")
    with pytest.raises(OutputError, match="does not belong to a fleet"):
        identify_fleet(six, tmp_path)

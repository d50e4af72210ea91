import dataclasses
import json
import sys

import numpy as np
import pytest

from fleet_records import OPTIONS, write_fleet, write_record
from minorloop import MissingExtraError, OutputError, ParameterError, load
from minorloop.fleet import identification
from minorloop.fleet._fitting import identify_one
from minorloop.fleet.identification import identify_fleet
from minorloop.fleet.manifest import Specimen

SEEN = []


class Here:
    """Identifies in this process."""

    ahead = 1

    def __init__(self, *given):
        SEEN.clear()

    def fit(self, task):
        SEEN.append(task.specimen.name)
        return identify_one(task, task.specimen.file.with_suffix(".scratch"))

    def close(self):
        pass


@pytest.fixture
def here(monkeypatch):
    """Replace the workers; returns the function for a fleet that lists what was identified."""
    monkeypatch.setattr(identification, "LocalWorkers", Here)

    def identify(specimens, folder, **options):
        return identify_fleet(specimens, folder, **options, **OPTIONS), list(SEEN)

    return identify


@pytest.fixture
def six(tmp_path):
    """Six specimens: one without a file, one with text for numbers."""
    specimens = write_fleet(tmp_path, ["s0", "s1", "gone", "bad", "s2", "s3"])
    (tmp_path / "gone.csv").unlink()
    (tmp_path / "bad.csv").write_text("drive [V],tip [mm]\n0,1\nx,y\n")
    return specimens


@pytest.mark.usefixtures("here")
def test_failures_are_reported_and_a_stopped_fleet_continues(six, tmp_path):
    out, seen = tmp_path / "out", []

    def watch(done, of, last):
        seen.append((done, of, last.specimen))

    def identify(**options):
        seen.clear()
        summary = identify_fleet(six, out, watch=watch, **options, **OPTIONS)
        return summary, sorted(name for _, _, name in seen)

    summary, _ = identify()
    assert [done[:2] for done in seen] == [(k, 6) for k in range(1, 7)]
    assert [one.specimen for one in summary.outcomes] == ["s0", "s1", "gone", "bad", "s2", "s3"]
    failed = {one.specimen: one.error for one in summary.failures}
    assert failed.keys() == {"gone", "bad"}
    assert "cannot be read: No such file" in failed["gone"]
    assert str(six[3].file) in failed["bad"]
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
    summary, again = identify()
    assert again == ["gone", "s0", "s1"]
    assert [one.specimen for one in summary.failures] == ["bad"]

    # What failed is tried again when that is asked for.
    assert identify(retry_failed=True)[1] == ["bad"]


@pytest.mark.parametrize("change", ["input", "output", "file"])
def test_specimens_with_other_columns_are_identified_again(change, tmp_path, here):
    write_record(tmp_path / "s0.csv", 0)
    table = np.loadtxt(tmp_path / "s0.csv", delimiter=",", skiprows=1)
    np.savetxt(
        tmp_path / "s0.csv", table[:, [0, 1, 1, 0]], delimiter=",", header="u,y,z,w", comments=""
    )
    (tmp_path / "s1.csv").write_bytes((tmp_path / "s0.csv").read_bytes())
    one = Specimen("a", tmp_path / "s0.csv", "u", "y")
    other = {"input": "w", "output": "z", "file": tmp_path / "s1.csv"}[change]
    assert here([one], tmp_path / "out")[1] == ["a"]
    assert here([one], tmp_path / "out")[1] == []
    assert here([dataclasses.replace(one, **{change: other})], tmp_path / "out")[1] == ["a"]


def test_the_folder_has_only_current_models_and_lists_strays(tmp_path, here):
    out, specimens = tmp_path / "out", write_fleet(tmp_path, "abc")
    assert here(specimens, out)[0].strays == []
    (tmp_path / "a.csv").write_text("nonsense")
    with (out / "models" / "b.json").open("a") as file:
        file.write(" ")
    summary, seen = here(specimens[:2], out)
    assert sorted(seen) == ["a", "b"]
    assert [one.specimen for one in summary.failures] == ["a"]
    assert summary.strays == ["models/c.json", "results/c.json"]
    assert summary.plain()["strays"] == summary.strays
    assert "models/c.json does not belong to any specimen" in str(summary)
    assert sorted(file.name for file in (out / "models").iterdir()) == ["b.json", "c.json"]


def test_a_folder_is_continued_with_the_same_options_only(six, tmp_path, here):
    for content, said in (
        ("{", "does not belong to a fleet"),
        ("[]", "does not belong to a fleet"),
        ('{"format": "minorloop fleet", "version": 1}', "defaults of another version"),
        ('{"format": "minorloop fleet", "version": 2}', "levels was left out and is 6 now; give"),
    ):
        with pytest.raises(OutputError, match="not empty"):
            here(six, tmp_path)
        (tmp_path / "out").mkdir(exist_ok=True)
        (tmp_path / "out" / "fleet.json").write_text(content)
        with pytest.raises(OutputError, match=said):
            here(six, tmp_path / "out")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"workers": 0}, "workers is 0"),
        ({"colour": 1}, "'colour' is not an option of a fleet"),
        ({"levels": np.arange(3)}, "numbers, words and lists"),
        ({"relay": "foo"}, "relay is 'foo'"),
        ({"prior": "foo"}, "prior is 'foo'"),
        *(({"patience": x}, "patience is") for x in (0, -1.0, float("nan"), float("inf"))),
        *(({"limit": x}, "limit is") for x in (0, -1.0, float("nan"))),
    ],
)
def test_refuses_wrong_options(options, message, six, tmp_path):
    with pytest.raises(ParameterError, match=message):
        identify_fleet(six, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_refuses_no_specimens_and_names_the_extra(six, tmp_path, monkeypatch):
    with pytest.raises(ParameterError, match="no specimen"):
        identify_fleet([], tmp_path / "out")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"minorloop\[fleet\]"):
        identify_fleet(six, tmp_path / "out", workers="tcp://127.0.0.1:1", **OPTIONS)

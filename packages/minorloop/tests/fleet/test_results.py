import dataclasses
import json
from pathlib import Path

import pytest

from minorloop import load
from minorloop.errors import OutputError
from minorloop.fleet.manifest import Specimen
from minorloop.fleet.results import (
    earlier_outcomes,
    fail,
    one_line,
    open_folder,
    strays,
    write_result,
    write_summary,
)
from minorloop.fleet.summary import Summary
from minorloop.lab.records import Quantity
from minorloop.operators.preisach import Preisach

MODEL = Preisach([0.0, 1.0, 2.0], [[1.0, 0.0], [0.5, 2.0]])
FOUND = {
    "model": MODEL,
    "input": Quantity("drive", "V"),
    "output": Quantity("tip", "mm"),
    "lag": 0,
    "lag_seconds": 0.0,
    "advice": ("the output is stuck",),
    "chosen": (),
    "nrmse": 0.1,
    "nrmse_holdout": None,
    "excited": 1.0,
    "opening": 0.3,
    "samples": 9,
    "seconds": 0.5,
    "warnings": ("the output is stuck",),
    "sha256": "9834876dcfb05cb167a5c24953eba58c4ac89b1adf57f28f2f9d09af107ee8f0",  # of "aaa"
}


@pytest.fixture
def one(tmp_path):
    (tmp_path / "s.csv").write_text("aaa")
    return Specimen("s", tmp_path / "s.csv", "drive", "tip")


@pytest.fixture
def place(tmp_path, one):
    return open_folder(tmp_path / "out", [one], {"levels": 2})


def test_a_result_is_a_model_file_and_an_outcome_that_is_found_again(place, one):
    outcome = write_result(place, one, FOUND)
    assert load_quietly(place / "models/s.json") == MODEL
    assert (outcome.low, outcome.high) == MODEL.range
    assert earlier_outcomes(place, [one], failed=False) == {"s": outcome}


def load_quietly(path):
    with pytest.warns(UserWarning, match="the output is stuck"):
        return load(path)


@pytest.mark.parametrize("changed", ["s.csv", "out/models/s.json"])
def test_an_outcome_is_not_used_if_its_record_or_model_changed(changed, place, one, tmp_path):
    write_result(place, one, FOUND)
    Path(tmp_path / changed).write_text("changed")
    assert not earlier_outcomes(place, [one], failed=False)


def test_an_outcome_is_not_used_for_another_column(place, one):
    write_result(place, one, FOUND)
    assert not earlier_outcomes(place, [dataclasses.replace(one, input="other")], failed=False)


def test_a_failure_removes_the_model_and_is_kept_on_demand(place, one):
    write_result(place, one, FOUND)
    outcome = fail(place, one, "no\nrows", FOUND["sha256"])
    assert outcome.error == "no rows"
    assert not (place / "models/s.json").exists()
    assert not earlier_outcomes(place, [one], failed=False)
    assert earlier_outcomes(place, [one], failed=True) == {"s": outcome}


def test_files_of_other_specimens_are_strays(place, one):
    write_result(place, one, FOUND)
    (place / "models/old.json").touch()
    assert strays(place, [one]) == ["models/old.json"]


def test_a_folder_is_continued_with_the_same_options_only(place, one, tmp_path):
    assert open_folder(place, [one], {"levels": 2}) == place
    with pytest.raises(OutputError, match="levels was 2 and is 3 now"):
        open_folder(place, [one], {"levels": 3})
    with pytest.raises(OutputError, match="is not empty"):
        open_folder(tmp_path, [one], {})
    (place / "fleet.json").write_text("{")
    with pytest.raises(OutputError, match="does not belong to a fleet"):
        open_folder(place, [one], {"levels": 2})


def test_the_summary_is_written_as_json_and_as_a_table(place, one):
    write_summary(place, Summary([write_result(place, one, FOUND)]))
    assert json.loads((place / "summary.json").read_text())["identified"] == 1
    header, row = (place / "summary.csv").read_text().splitlines()
    table = dict(zip(header.split(","), row.split(","), strict=True))
    assert (table["specimen"], table["nrmse"]) == ("s", "0.1")


def test_long_texts_are_shortened_to_one_line():
    assert one_line("a\n b") == "a b"
    assert one_line("x" * 500) == "x" * 396 + " ..."

import dataclasses

import pytest

from minorloop.fleet.manifest import Specimen
from minorloop.fleet.results import (
    earlier_outcome,
    has_result,
    open_folder,
    write_result,
)

MODEL, DIGEST = b"model", "9372c470eeadd5ecd9c3c74c2b3cb633f8e2f2fad799250a0f70d652b6b825e4"
FIGURES = {"nrmse": 0.1, "low": -1.0, "high": 1.0, "sha256": "of the record", "model": DIGEST}


@pytest.fixture
def one(tmp_path):
    return Specimen("s", tmp_path / "s.csv", "drive", "tip")


@pytest.fixture
def place(tmp_path, one):
    place = open_folder(tmp_path / "out", [one], {"levels": 2})
    assert not has_result(place, one)
    write_result(place, one, one.outcome(**FIGURES), MODEL)
    assert has_result(place, one)
    return place


def test_an_outcome_is_found_again_if_record_columns_and_model_are_the_same(place, one):
    assert earlier_outcome(place, one, "of the record") == one.outcome(**FIGURES)
    assert earlier_outcome(place, one, "of another") is None
    other = dataclasses.replace(one, input="other")
    assert earlier_outcome(place, other, "of the record") is None
    (place / "models/s.json").write_text("changed")
    assert earlier_outcome(place, one, "of the record") is None
    (place / "results/s.json").write_text("nonsense")
    assert earlier_outcome(place, one, "of the record") is None

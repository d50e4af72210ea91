"""Truth of twins is private in them, and a study reads it for scores only."""

import ast
from pathlib import Path

import pytest

from minorloop.connect import connect
from truth import hidden_truth

PAPERS = Path(__file__).parents[1]
PUBLIC = {"PARAMETERS", "resonance", "checkpoint"}
"""Truth that is not private: parameters of the oscillator and the stage, states of twins."""
SCORES = {
    "catheter/scoring.py": {
        *("_axes", "_cross", "_hold", "_optics", "_output_now", "_peaks"),
        *("_pixel", "_state", "_truth"),
    },
    "catheter/scene_view.py": {"_advance", "_focus_wanted", "_optics"},
    "benchmark.py": {"PARAMETERS"},
    "stage.py": {"resonance"},
}
"""What files read to score a run, or to place a camera that is not driven."""


def read_of_others(text):
    """Names of truth, and private ones, of objects of other files."""
    nodes = list(ast.walk(ast.parse(text)))
    found = [node for node in nodes if isinstance(node, ast.Attribute)]
    mine = [node for node in found if getattr(node.value, "id", "") in ("self", "cls")]
    own = {node.attr for node in mine} | {getattr(node, "name", None) for node in nodes}
    private = {node.attr for node in found if node.attr[0] == "_" and node.attr[:2] != "__"}
    return (private - own) | (PUBLIC & {node.attr for node in found})


def test_only_scores_read_the_truth_of_a_twin():
    files = {path.relative_to(PAPERS).as_posix(): path for path in PAPERS.rglob("*.py")}
    found = {
        name: read_of_others(path.read_text("utf-8"))
        for name, path in files.items()
        if not name.startswith("tests/")
    }
    assert {name: read for name, read in found.items() if read} == SCORES


def test_a_hidden_truth_is_found_where_it_is_read():
    strip = connect("twin:ipmc", specimen=1)
    with hidden_truth():
        assert strip.apply(0.5, 1.0, 1.0).y.size == 1
        with pytest.raises(AssertionError, match=r"test_truth\.py reads _parameters"):
            assert strip._parameters
    assert strip._parameters

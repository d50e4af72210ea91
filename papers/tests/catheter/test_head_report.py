"""The table of sentences of the paper: where each is tested, and whether it holds."""

import re
from pathlib import Path

import pytest

from papers.catheter.head_report import holds

ROOT = Path(__file__).parents[3]


def statements():
    """Rows of the table: place, statement, test, result and verdict."""
    text = (ROOT / "papers/catheter/head_report.md").read_text("utf-8")
    _, _, section = text.partition("## What sections 4 and 5.1 say")
    lines = section.partition("\n## ")[0].splitlines()
    rows = [line.strip("| ").split(" | ") for line in lines if line.startswith("|")]
    return rows[2:]


def test_each_statement_names_tests_that_exist():
    for _, _, where, _, _ in statements():
        for part in where.split(";"):
            named = re.findall(r'"(test [^"]+)"', part)
            own = re.findall(r"[\w/-]*tests/[\w/]+\.py", part)
            assert len(own) == bool(named)
            for path in own:
                folder = ROOT if path.startswith("papers") else ROOT / "packages"
                text = (folder / path).read_text("utf-8")
                assert all(f"def {name.replace(' ', '_')}(" in text for name in named)


def test_a_statement_has_a_place_a_test_or_why_there_is_none_and_a_result():
    assert len(statements()) == 29
    for place, words, where, result, verdict in statements():
        assert re.match(r"3\.2|4\.[123]|5\.1|6", place)
        assert words[0].isupper()
        assert (result == "-") == where.startswith("not tested: ") == (verdict == "not tested")
        assert re.match(r"holds|not tested|\{holds ", verdict)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((1.0, 1.5, 2.0), "holds"),
        ((1.6, 1.5), "does not hold here"),
        ((float("nan"), 1.5), "does not hold here"),
        ((1.0, 1.5, "/", 1.6, 1.5), "holds in part"),
        ((1.6, 1.5, "/", 1.6, 1.5), "does not hold here"),
    ],
)
def test_a_figure_beyond_its_bound_does_not_hold_and_one_of_several_in_part(values, said):
    assert holds(*values) == said

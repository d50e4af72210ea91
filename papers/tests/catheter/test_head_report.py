"""The table of sentences of the paper: where each is tested, and whether it holds."""

import re
from pathlib import Path

import pytest

from papers.catheter.head_report import holds

ROOT = Path(__file__).parents[3]


def rows(heading):
    """Rows of the table in a section: place, statement, test, result and, if any, verdict."""
    text = (ROOT / "papers/catheter/head_report.md").read_text("utf-8")
    section = text.partition(f"## {heading}")[2].partition("\n## ")[0]
    lines = [line.strip("| ") for line in section.splitlines() if line.startswith("|")]
    return [line.split(" | ") for line in lines[2:]]


SCORED, HELD = rows("What sections 4 and 5.1 say"), rows("What tests hold the product to")


def test_each_statement_names_tests_that_exist():
    for _, _, where, *_ in SCORED + HELD:
        for part in where.split(";"):
            named = re.findall(r'"(test [^"]+)"', part)
            own = re.findall(r"[\w/-]*tests/[\w/]+\.py", part)
            assert len(own) == bool(named)
            for path in own:
                folder = ROOT if path.startswith("papers") else ROOT / "packages"
                text = (folder / path).read_text("utf-8")
                assert all(f"def {name.replace(' ', '_')}(" in text for name in named)


def test_every_verdict_is_computed_and_a_statement_without_a_test_says_why():
    assert len(SCORED) + len(HELD) == 29
    for place, words, *_ in SCORED + HELD:
        assert re.match(r"3\.2|4\.[123]|5\.1|6", place)
        assert words[0].isupper()
    for *_, verdict in SCORED:
        assert re.fullmatch(r"\{holds [^{}]+\}", verdict)
    for _, _, where, remark in HELD:
        assert (remark == "-") == where.startswith("not tested: ")


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

"""Templates of reports: figures in the place of their names, tables, pictures and repetitions."""

from collections import ChainMap
from types import SimpleNamespace

import pytest

from papers.harness import Study
from papers.page import filled, table_of

NAMES = ChainMap(
    {
        "ramp": {"ratio": 1.234, "none": float("nan"), "never": float("inf"), "count": 3},
        "study": SimpleNamespace(steps=[{"word": "go"}], found=lambda: {"rms": 0.5}),
        "twice": lambda value: 2 * value,
    }
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ratio\n  {ramp.ratio:.1f}", "ratio 1.2"),
        ("{ramp.none:.2f}, {ramp.never:.2f}", "none, not reached"),
        ("{ramp.ratio:.0p} of {ramp.count}", "123 % of 3"),
        ("{study.steps.0.word} {study.found.rms:.0%}", "go 50%"),
        ("{twice ramp.count} {twice 1.5:.1f}", "6 3.0"),
    ],
)
def test_figures_take_the_place_of_their_names(text, said):
    assert filled(text, NAMES) == said


def test_cells_of_a_table_are_filled():
    table = table_of("| what | ratio |\n|---|---|\n| ramp | {ramp.ratio:.2f} |", NAMES)
    assert (table.columns, table.rows) == (["what", "ratio"], [["ramp", "1.23"]])


TEMPLATE = """On {specimens}.

## Each {seed}

@for crack in study.cracks

Crack {crack}.

## Empty

{nothing_of study}

![A picture.](no_picture study)

## Last

[rows_of figures]

![Caption {seed}.](picture_of study)
"""


def test_sections_are_repeated_or_left_out(tmp_path, monkeypatch):
    module = tmp_path / "made_page.py"
    module.write_text(
        "nothing_of, no_picture = lambda study: '', lambda study: None\n"
        "rows_of, picture_of = lambda figures: figures['a'], lambda study: study.cracks\n"
        "picture_of = lambda study: 'drawn'\n"
        "names = lambda study, figures, runs: {'seed': 7}\n"
    )
    module.with_suffix(".md").write_text(TEMPLATE)
    monkeypatch.syspath_prepend(tmp_path)
    study, figures = SimpleNamespace(cracks=("x", "y")), {"a": "table"}
    report = Study("made", "Title", print, page="made_page").report(study, figures, [figures])
    assert (report.title, report.summary) == ("Title", "On 1 simulated specimen.")
    sections = [(one["heading"], one["paragraphs"], one["table"]) for one in report.sections]
    assert sections == [
        ("Each 7", ["Crack x."], None),
        ("Each 7", ["Crack y."], None),
        ("Last", [], "table"),
    ]
    (picture,) = report.sections[-1]["pictures"]
    assert (picture.figure, picture.caption) == ("drawn", "Caption 7.")

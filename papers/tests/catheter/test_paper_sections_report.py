import math
import re
from pathlib import Path

from minorloop.report import Report
from papers.catheter.paper_sections_report import STATEMENTS, add_sections

ROOT = Path(__file__).parents[3]


def test_each_statement_names_tests_that_exist():
    for _, _, where, _, _ in STATEMENTS:
        for part in where.split(";"):
            named = re.findall(r"\btest_\w+\b(?!\.py)", part)
            own = re.findall(r"[\w/-]*tests/[\w/]+\.py", part)
            assert len(own) == bool(named)
            for path in own:
                folder = ROOT if path.startswith("papers") else ROOT / "packages"
                text = (folder / path).read_text("utf-8")
                assert all(f"def {name}(" in text for name in named)


def test_a_statement_has_a_place_a_test_or_why_there_is_none_and_a_result():
    for place, words, where, result, verdict in STATEMENTS:
        assert re.match(r"3\.2|4\.[123]|5\.1|6", place)
        assert words[0].isupper()
        assert (result == "-") == where.startswith("not tested: ") == (verdict == "not tested")


def rows_of(figures):
    report, drawn = Report("", ""), figures.pop("drawn")
    add_sections(report, figures, drawn)
    return report.sections[0]["table"].rows


def every_figure(value):
    """Return the figures that statements name, each of one value."""
    known = {}
    for name in re.findall(r"\{([\w.]+):", " ".join(result for *_, result, _ in STATEMENTS)):
        at, (*path, last) = known, name.split(".")
        for part in path:
            at = at.setdefault(part, {})
        at[last] = value
    return known


def test_figures_take_the_place_of_their_names():
    rows = rows_of(every_figure(math.inf))
    assert len(rows) == len(STATEMENTS)
    assert not any("{" in row[3] for row in rows)
    assert "not reached" in rows[1][3]
    assert rows[0][2].startswith(
        '"test equals the sum of areas cell by cell" in minorloop/tests/operators/'
    )


def test_a_figure_beyond_its_bound_does_not_hold_and_one_of_several_in_part():
    known = every_figure(1.0)
    known["rivals"]["internal_model"]["disturbed_settle_s"] = math.nan
    verdicts = {words: verdict for _, words, _, _, verdict in rows_of(known)}
    assert [words for words, verdict in verdicts.items() if verdict == "does not hold here"] == [
        "After a long operation a significant error is left; the heating varies",
        "Its integral attenuates tracking errors",
        "A circle of both axes is followed by vision",
    ]
    arbitrary = "The model agrees with the wire under an arbitrary input"
    rivals = (
        "Feedforward with PI (ref. 11) and a model reference (ref. 12) apply poorly where "
        "conditions vary; an internal model is more robust"
    )
    assert verdicts[rivals] == "holds in part"
    assert verdicts[arbitrary] == "holds"
    for key in ("mesh_rms_deg", "rms_deg", "moving_rms_deg"):
        known = every_figure(1.0)
        known["arbitrary"][key] = 1.6
        assert {row[1]: row[4] for row in rows_of(known)}[arbitrary] == "holds in part"

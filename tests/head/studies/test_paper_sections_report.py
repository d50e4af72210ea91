import math
import re
from pathlib import Path

from minorloop.head.studies.paper_sections_report import STATEMENTS, add_sections
from minorloop.report import Report

TESTS = Path(__file__).parents[2]


def test_each_statement_names_tests_that_exist():
    files = {path.name: path.read_text("utf-8") for path in TESTS.rglob("test_*.py")}
    for _, _, where, _ in STATEMENTS:
        for part in where.split(";"):
            named = re.findall(r"\btest_\w+\b(?!\.py)", part)
            own = re.findall(r"tests/[\w/]+\.py", part)
            assert len(own) == bool(named)
            for path in own:
                assert (TESTS.parent / path).is_file()
                assert all(f"def {name}(" in files[Path(path).name] for name in named)


def test_a_statement_has_a_place_a_test_or_why_there_is_none_and_a_result():
    for place, words, where, result in STATEMENTS:
        assert re.match(r"3\.2|4\.[123]|5\.1|6", place)
        assert words[0].isupper()
        assert (result == "-") == where.startswith("not tested: ")


def test_figures_take_the_place_of_their_names():
    known = {}
    for name in re.findall(r"\{([\w.]+):", " ".join(result for *_, result in STATEMENTS)):
        at, (*path, last) = known, name.split(".")
        for part in path:
            at = at.setdefault(part, {})
        at[last] = math.inf
    report, drawn = Report("", ""), known.pop("drawn")
    add_sections(report, known, drawn)
    rows = report.sections[0]["table"].rows
    assert len(rows) == len(STATEMENTS)
    assert not any("{" in row[-1] for row in rows)
    assert "not reached" in rows[1][-1]
    assert rows[0][2].startswith('"test equals the sum of areas cell by cell" in tests/operators/')

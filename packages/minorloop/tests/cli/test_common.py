import io
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
import typer

from minorloop.cli import _common
from minorloop.errors import OutputError
from minorloop.report import Report


@pytest.mark.parametrize(
    ("parse", "text", "value"),
    [(_common.whole, "-3", -3), (_common.number, "1e-3", 1e-3), (_common.number, "inf", math.inf)],
)
def test_numbers_of_options(parse, text, value):
    assert parse(text) == value
    for bad in ("", "1,5", "many"):
        with pytest.raises(typer.BadParameter, match=f"'{bad}' is not a"):
            parse(bad)


def test_numbers_that_json_lacks_become_null(capsys):
    content = {"a": math.nan, "b": [math.inf, 1.0], "c": np.array([-math.inf, 2.0])}
    _common.print_json(content | {"d": np.float64(0.5), "e": np.int64(3), "f": None, "g": "µ"})
    assert json.loads(capsys.readouterr().out) == {
        "a": None,
        "b": [None, 1.0],
        "c": [None, 2.0],
        "d": 0.5,
        "e": 3,
        "f": None,
        "g": "µ",
    }


def test_progress_is_shown_on_stderr_only(monkeypatch, capsys):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal)
    with _common.working("adding") as now:
        now("subtracting")
    assert "subtracting" in terminal.getvalue()
    assert capsys.readouterr().out == ""


def test_an_interruption_ends_the_steps_at_once():
    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _common.all_done([interrupted, lambda: pytest.fail("went on")])


def test_a_report_that_cannot_be_drawn_is_one_sentence():
    def draw():
        raise RuntimeError("no fonts")

    with pytest.raises(OutputError, match=r"new\.html was not written.* no fonts"):
        _common.write_report(draw, Path("new.html"), force=False)
    with pytest.raises(OutputError, match="exists already"):
        _common.write_report(lambda: Report("a", "b"), Path("good.csv"), force=False)
    _common.write_report(lambda: Report("a", "b"), Path("new.html"), force=False)
    assert "<h1>a</h1>" in Path("new.html").read_text()


@pytest.mark.parametrize("other", ["new.csv", "./new.csv", "here/../new.csv", "link.csv"])
@pytest.mark.parametrize("force", [False, True])
def test_two_results_cannot_have_the_same_file(other, force):
    Path("here").mkdir()
    Path("link.csv").symlink_to("new.csv")
    with pytest.raises(OutputError, match="is given for two results"):
        _common.check_outputs([Path("new.csv"), Path(other)], force=force)

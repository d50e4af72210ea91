import io
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from minorloop.cli import _common
from minorloop.errors import OutputError


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


@pytest.mark.parametrize("other", ["new.csv", "./new.csv", "here/../new.csv", "link.csv"])
@pytest.mark.parametrize("force", [False, True])
def test_two_results_cannot_have_the_same_file(other, force):
    Path("here").mkdir()
    Path("link.csv").symlink_to("new.csv")
    with pytest.raises(OutputError, match="is given for two results"):
        _common.check_outputs([Path("new.csv"), Path(other)], force=force)

import io
import sys
from pathlib import Path

import pytest

from minorloop.cli import _common
from minorloop.errors import OutputError


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

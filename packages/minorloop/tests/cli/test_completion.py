"""Completion as the scripts of the shells ask for it."""

from pathlib import Path

import pytest
import shellingham


def test_bash_completes_a_verb(run, monkeypatch):
    monkeypatch.setenv("_MINORLOOP_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "minorloop\nide")
    monkeypatch.setenv("COMP_CWORD", "1")
    assert run("")[1].split() == ["identify"]


@pytest.mark.parametrize(
    ("shell", "file"),
    [
        ("bash", ".bash_completions/minorloop.sh"),
        ("zsh", ".zfunc/_minorloop"),
        ("fish", ".config/fish/completions/minorloop.fish"),
    ],
)
def test_completion_is_installed_for_the_shell_that_asks(shell, file, run, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(shellingham, "detect_shell", lambda: (shell, f"/bin/{shell}"))
    status, out, err = run("--install-completion")
    assert (status, err) == (0, "")
    assert f"{shell} completion installed" in out
    assert f"complete_{shell}" in (tmp_path / file).read_text()
    assert run("--show-completion")[1].strip() in Path(file).read_text()

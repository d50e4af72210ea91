"""Completion as the scripts of the shells ask for it."""

from pathlib import Path

import pytest
import shellingham


@pytest.fixture
def complete(run, monkeypatch):
    """Return the completions of a command line in bash, as words split at : and =."""

    def complete(*words):
        monkeypatch.setenv("_MINORLOOP_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", "\n".join(["minorloop", *words]))
        monkeypatch.setenv("COMP_CWORD", str(len(words)))
        status, out, err = run("")
        assert (status, err) == (0, "")
        return out.split()

    return complete


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["ide"], ["identify"]),
        (["plan", "st"], ["staircase"]),
        (["runs", ""], ["list", "show", "export"]),
        (["run", "--actuator", "twin:fi"], ["twin:fibre"]),
        (["run", "--actuator", "twin", ":", "fi"], ["fibre"]),
        (["run", "--actuator", "=", "twin", ":", "fi"], ["fibre"]),
        (["run", "--store", "a", ":", "b", "--actuator", "vi"], ["visa:"]),
        (["drive", "m.json", "x.csv", "--actuator", "visa", ":"], []),
        (["invert", "m.json", "x.csv", "--start", "p"], ["positive"]),
        (["identify", "x.csv", "--law", "vis"], ["viscosity:"]),
        (["identify", "x.csv", "--prior", "s"], ["smooth"]),
    ],
)
def test_bash_completes_what_follows_the_last_colon(words, found, complete):
    assert complete(*words) == found


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

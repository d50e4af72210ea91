"""Completion as the scripts of the shells ask for it."""

import shellingham


def test_bash_completes_a_verb(run, monkeypatch):
    monkeypatch.setenv("_MINORLOOP_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "minorloop\nide")
    monkeypatch.setenv("COMP_CWORD", "1")
    assert run("")[1].split() == ["identify"]


def test_completion_is_installed_for_the_shell_that_asks(run, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(shellingham, "detect_shell", lambda: ("fish", "/bin/fish"))
    status, out, err = run("--install-completion")
    assert (status, err) == (0, "")
    assert "fish completion installed" in out
    file = tmp_path / ".config/fish/completions/minorloop.fish"
    assert "complete_fish" in file.read_text()
    assert run("--show-completion")[1].strip() in file.read_text()

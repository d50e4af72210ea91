"""README, docs and examples do what they say."""

import re
import runpy
from pathlib import Path

import pytest

import minorloop
from minorloop.cli import main

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def code_blocks(page):
    return re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_code_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for block in code_blocks(page):
        exec(compile(block, page.name, "exec"), {})
    assert (page.name != "README.md") or (tmp_path / "model.json").exists()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        assert target.startswith("https://") or (page.parent / target).exists(), target


def test_verbs_and_options_exist(capsys):
    for page in PAGES:
        text = page.read_text().replace("\\\n", " ")
        for line in re.findall(r"^ +\$? ?minorloop (.+)$", text, flags=re.MULTILINE):
            verb, *words = line.split()
            assert main([verb, "--help"]) == 0
            shown = capsys.readouterr().out
            for word in words:
                assert not word.startswith("--") or word in shown, f"{page.name}: {line}"


def test_every_public_name_is_in_the_reference():
    text = (ROOT / "docs" / "reference.md").read_text()
    missing = [name for name in minorloop.__all__ if f"`{name}`" not in text]
    assert not missing


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.stem)
def test_examples_run(example, capsys):
    runpy.run_path(str(example))
    if example.stem != "readme_figures":
        assert len(capsys.readouterr().out.splitlines()) >= 2

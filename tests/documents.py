"""The code blocks of a page, and how each kind is tried.

A page is Markdown. Its fenced blocks are tried in order, in one folder and with one set of
Python names for the page: ``python`` is executed; of ``console`` every line after ``$`` is
carried out, and what is shown below it is what has to come out, with ``...`` for what differs
from run to run, and decimal fractions within one percent. A block after the comment
``<!-- parsed only: REASON -->`` takes too long, or hardware, or a network: then the commands
only have to be ones that exist, with options that exist.
"""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import typer.main
from markdown_it import MarkdownIt

from minorloop.cli import app, main
from papers.__main__ import command

ROOT = Path(__file__).parent.parent
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(ROOT.glob("packages/*/README.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
SHOWN = {"text", "c", "csv"}  # not code that could be carried out
NUMBER = re.compile(r"((?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w]|\.\d))")
MARK = re.compile(r"<!-- parsed only: .{10,} -->")
VERBS = typer.main.get_command(app)
PAPERS = command()


@dataclass(frozen=True)
class Block:
    """A code block: its language, its text, its first line, and whether it is parsed only."""

    language: str
    text: str
    line: int
    parsed_only: bool = False


def name_of(page):
    return page.relative_to(ROOT).as_posix()


def blocks(page):
    """Return the code blocks of a page in order, without those for Sphinx itself."""
    found, marked = [], False
    for token in MarkdownIt("commonmark").parse(page.read_text()):
        if token.type in ("fence", "code_block"):
            language = token.info.strip()
            if not language.startswith("{"):
                found.append(Block(language, token.content, token.map[0] + 1, marked))
        marked = token.type == "html_block" and bool(MARK.match(token.content.strip()))
    return found


def commands(text):
    """Return each command of a console block with the output that is shown for it."""
    lines = text.replace("\\\n", " ").splitlines()
    assert lines[0].startswith("$ "), "a console block begins with a command"
    found = []
    for line in lines:
        if line.startswith("$ "):
            found.append((line[2:].split("  #")[0].strip(), []))
        else:
            found[-1][1].append(line.rstrip())
    return [(command, "\n".join(shown).strip()) for command, shown in found]


def carry_out(command, capsys):
    """Run one command, those of minorloop in this process; return what it printed."""
    words = shlex.split(command)
    if words[0] == "minorloop" and not {"|", ">", "&&", ";"} & set(words):
        status = main(words[1:])
        shown = capsys.readouterr()
        assert status == 0, f"{command}: {shown.err}"
        return shown.out
    done = subprocess.run(
        ["bash", "-ec", command],
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
    )
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout


def agree(shown, printed):
    """Whether what a page shows is what was printed.

    Lines may be broken elsewhere, decimal fractions be off by a hundredth of their size and one
    in their last digit: another machine adds in another order.
    """
    text, *rest = NUMBER.split(" ".join(shown.split()))
    pattern = re.escape(text).replace(r"\.\.\.", ".*?")
    for text in rest[1::2]:
        pattern += f"({NUMBER.pattern[1:-1]})" + re.escape(text).replace(r"\.\.\.", ".*?")
    found = re.fullmatch(pattern, " ".join(printed.split()))
    return found is not None and all(map(near, rest[::2], found.groups()))


def near(shown, printed):
    """Whether a number is the one shown: whole ones to the letter, others to one percent."""
    if "." not in shown:
        return float(shown) == float(printed)
    last = 10.0 ** -len(shown.partition(".")[2].partition("e")[0])
    spread = last + 0.01 * abs(float(shown))
    return abs(float(shown) - float(printed)) <= spread * (1 + 1e-9)


def check_exists(command):
    """Refuse a command line that cannot be run as it is shown."""
    words = [word for word in shlex.split(command) if word]
    program = Path(words[0]).name
    if program == "minorloop":
        verb, rest = verb_of(words[1:])
        verb.make_context(verb.name, rest).close()
    elif program == "make":
        text = (ROOT / "Makefile").read_text()
        for target in (word for word in words[1:] if "=" not in word):
            assert re.search(rf"^{target}:", text, re.MULTILINE), command
    elif program == "pip":
        named = re.fullmatch(r"(?:\./packages/)?(minorloop(?:-head)?)(?:\[(\w+)\])?", words[-1])
        assert words[1] == "install", command
        assert named, command
        text = (ROOT / "packages" / named[1] / "pyproject.toml").read_text()
        extras = tomllib.loads(text)["project"].get("optional-dependencies", {})
        assert named[2] is None or named[2] in extras, command
    elif program == "python" and words[1:3] == ["-m", "papers"]:
        PAPERS.make_context("papers", words[3:]).close()
    elif program == "python" and words[1:3] == ["-m", "benchmarks"]:
        for part in words[4:]:
            assert (ROOT / "benchmarks" / f"{part}.py").exists(), command
    elif program == "python" and words[1:3] == ["-m", "pytest"]:
        for path in (word for word in words if "tests/" in word):
            assert (ROOT / path).exists(), command
    else:
        assert program in {"source", ".ci/run", "cc", "git"}, f"unknown command: {command}"


def verb_of(words):
    """The verb that words begin with, and the words after it."""
    verb, rest = VERBS, list(words)
    while hasattr(verb, "commands") and rest:
        verb = verb.commands[rest.pop(0)]
    return verb, rest


def check_named(text):
    """Refuse a command in running text whose verb, options or target do not exist."""
    program, first, *words = text.replace("\n", " ").split()
    if program == "make":
        assert re.search(rf"^{first}:", (ROOT / "Makefile").read_text(), re.MULTILINE), text
        return
    verb, words = verb_of([first, *words])
    options = {name for parameter in verb.params for name in parameter.opts}
    for word in words:
        assert not word.startswith("-") or word in {*options, "--help"}, text


def try_page(page, capsys, *, parsed_only=False):
    """Try all blocks of a page in order, in the present folder; or only parse them."""
    names = {}
    for block in blocks(page):
        where = f"{name_of(page)}:{block.line}"
        only = parsed_only or block.parsed_only
        if block.language == "python":
            code = compile("\n" * block.line + block.text, where, "exec")
            if not only:
                exec(code, names)
                capsys.readouterr()
        elif block.language == "console":
            for command, shown in commands(block.text):
                if only:
                    check_exists(command)
                    continue
                printed = carry_out(command, capsys)
                assert not shown or agree(shown, printed), f"{where}: {command}\n{printed}"
        elif block.language == "json":
            json.loads(block.text)
        elif block.language == "toml":
            tomllib.loads(block.text)
        else:
            assert block.language in SHOWN, f"{where}: what is {block.language!r}?"

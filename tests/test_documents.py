"""README, docs and examples do what they say."""

import ast
import doctest
import inspect
import re
import runpy
import shutil
import sys
from dataclasses import is_dataclass
from importlib import import_module

import numpy as np
import pytest

import documents
import minorloop
from documents import PAGES, ROOT, name_of
from minorloop.identification import pipeline
from minorloop.lab import actuator
from minorloop.operators import operator

DOCS = ROOT / "docs"
REFERENCE = DOCS / "reference"
DEVICES = {"home_made_plant"}
DEVICES |= {f"simulated_{name}" for name in ("board", "head", "pipe", "tracker")}
"""Examples that need a device, or are one; the tests of drivers use them."""
EXAMPLES = sorted(each for each in (ROOT / "examples").glob("*.py") if each.stem not in DEVICES)
OPTIONAL = {"control", "cv2", "distributed", "fmpy", "jax", "openpyxl", "pandas", "sklearn"}
LONG = ("how-to/dynamics", "how-to/fit", "how-to/simulators", "head/inspect")
LONG = [DOCS / f"{name}.md" for name in LONG]
"""Pages that take longest: their blocks are carried out with the whole tests, and parsed in all."""
TRIED = [
    pytest.param(page, marks=[pytest.mark.whole] if page in LONG else [])
    for page in PAGES
    if documents.blocks(page)
]


@pytest.mark.filterwarnings("ignore")  # what Dask and scikit-learn warn of is not ours
@pytest.mark.parametrize("page", TRIED, ids=name_of)
def test_every_code_block_does_what_the_page_says(page, tmp_path, monkeypatch, capsys):
    text = page.read_text()
    if ("minorloop export" in text or "gcc" in text) and not shutil.which("gcc"):
        pytest.skip("no C compiler (gcc) is installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    try:
        documents.try_page(page, capsys)
    except ModuleNotFoundError as error:
        if error.name not in OPTIONAL:
            raise
        pytest.skip(f"needs {error.name}, which an extra brings")


@pytest.mark.parametrize("page", LONG, ids=name_of)
def test_code_blocks_of_a_long_page_are_code_and_commands_that_exist(page, capsys):
    documents.try_page(page, capsys, parsed_only=True)


def test_a_page_that_shows_something_else_is_found(tmp_path, monkeypatch, capsys):
    page = ROOT / "docs" / "none.md"
    monkeypatch.setattr(type(page), "read_text", lambda self: "```console\n$ echo 1\n2\n```\n")
    with pytest.raises(AssertionError, match="echo 1"):
        documents.try_page(page, capsys)


@pytest.mark.parametrize("command", ["minorloop identify --level 3", "make coffee", "rm -r ."])
def test_a_command_that_does_not_exist_is_found(command):
    with pytest.raises(Exception, match=r"No such option|coffee|unknown command"):
        documents.check_exists(command)


@pytest.mark.parametrize(
    ("shown", "same"),
    [
        ("rms 0.683% of 56", True),
        ("rms 0.686% of\n56", True),
        ("rms 0.9% of 56", False),
        ("rms 0.683% of 57", False),
        ("rms ... of 56", True),
        ("rms 0.683% of 56 or so", False),
    ],
)
def test_what_is_shown_is_compared_with_what_was_printed(shown, same):
    assert documents.agree(shown, "rms  0.683%\nof 56\n") is same


def test_sentences_of_the_core_name_options_that_exist():
    known = {"--help", "--version", "--dynamics"}  # the page puts the last in the place of two
    for verb in documents.VERBS.commands.values():
        for each in [verb, *getattr(verb, "commands", {}).values()]:
            known |= {name for option in each.params for name in option.opts}
    named = set()
    for file in (ROOT / "packages" / "minorloop" / "src").rglob("*.py"):
        named |= set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]+", file.read_text()))
    assert named <= known


INLINE = [
    (page, text)
    for page in PAGES
    for text in re.findall(r"(?<!`)`(minorloop [a-z][^`]*|make [a-z][^`]*)`(?!`)", page.read_text())
]


@pytest.mark.parametrize(("page", "text"), INLINE, ids=lambda found: getattr(found, "name", None))
def test_commands_in_the_text_exist(page, text):
    documents.check_named(text)


def anchors(page):
    """The anchors of a page's headings, as GitHub and myst make them."""
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    for title in re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE):
        yield re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md", ROOT / "SECURITY.md"], ids=name_of)
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```|\$\$.*?\$\$|\$[^$\n]+\$", "", page.read_text(), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"\w+:", target):
            assert re.fullmatch(r"https://[\w.-]+\.\w+(/[\w./~%#=?&-]*)?", target), target
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path) if path else page
        assert there.exists(), target
        assert not anchor or anchor in set(anchors(there)), target


def test_every_page_is_reached_from_the_first():
    listed = set()
    for page in DOCS.rglob("*.md"):
        for entries in re.findall(r"```\{toctree\}(.*?)```", page.read_text(), flags=re.DOTALL):
            lines = [line.split("<")[-1].strip(" >") for line in entries.splitlines()]
            listed |= {(page.parent / f"{line}.md").resolve() for line in lines}
    assert set(DOCS.rglob("*.md")) - {DOCS / "index.md"} <= listed


def public_modules():
    """Every module whose name has no underscore, but those of the command line."""
    for source in sorted(ROOT.glob("packages/*/src")):
        for path in sorted(source.rglob("*.py")):
            parts = path.relative_to(source).with_suffix("").parts
            if not any(part.startswith("_") for part in parts) and "cli" not in parts:
                yield ".".join(parts), path


def test_the_reference_has_every_package_once():
    """The pages take every public module of a package from the package itself."""
    pages = [page.read_text() for page in DOCS.rglob("reference/*.md")]
    listed = [found for page in pages for found in re.findall(r"^\.\. modules:: (.+)$", page, re.M)]
    packages = {".".join(name.split(".")[:2]) for name, _ in public_modules()}
    assert sorted(" ".join(listed).split()) == sorted(
        package.removeprefix("minorloop.") for package in packages
    )


def undocumented(path):
    """Public names of a module, and of its classes, that have no docstring."""
    stack = [("", node) for node in ast.parse(path.read_text()).body]
    while stack:
        prefix, node = stack.pop()
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue
        overloaded = any("overload" in ast.unparse(mark) for mark in node.decorator_list)
        if node.name.startswith("_") or overloaded:
            continue
        if not ast.get_docstring(node):
            yield prefix + node.name
        if isinstance(node, ast.ClassDef):
            stack += [(f"{prefix}{node.name}.", inner) for inner in node.body]


def test_every_public_name_of_every_module_has_a_docstring():
    assert not [f"{name}.{n}" for name, path in public_modules() for n in undocumented(path)]


def described(docstring):
    """The names in the section Parameters of a docstring in numpydoc's form."""
    section = re.search(r"Parameters\n-+\n(.*?)(?=\n\n[A-Z]\w+\n---|\Z)", docstring, re.DOTALL)
    lines = re.findall(r"^(\S[^\n:]*?)(?: :.*)?$", section[1], re.MULTILINE) if section else []
    return {name.strip().lstrip("*") for line in lines for name in line.split(",")}


def described_fields(found):
    """The fields of a class that a docstring follows, alone or the last of several of a kind."""
    tree, names, waiting = ast.parse(inspect.getsource(found)).body[0], set(), set()
    for node in tree.body:
        if isinstance(node, ast.AnnAssign):
            waiting.add(node.target.id)
        else:
            names |= waiting if isinstance(node, ast.Expr) else set()
            waiting = set()
    return names


PROTOCOLS = [
    found
    for module in (actuator, operator, pipeline)
    for found in vars(module).values()
    if getattr(found, "_is_protocol", False)
]
"""Their methods are described here once; an implementation says what differs."""
CALLABLES = [
    name
    for name in minorloop.__all__
    if callable(getattr(minorloop, name)) and not name.endswith(("Error", "Warning"))
]


def parameters(function):
    names = inspect.signature(function).parameters
    return {name for name in names if not name.startswith("_") and name not in ("self", "cls")}


def describing(docstring, found, method):
    """A docstring, those of the same method of protocols, and those that it names by "as of"."""
    yield docstring
    for name in [method, *re.findall(r"\bas\s+of\s+`([\w.]+)`", docstring, re.IGNORECASE)]:
        owner, _, last = name.rpartition(".")
        for one in [getattr(minorloop, owner) if owner in CALLABLES else found, *PROTOCOLS]:
            yield inspect.getdoc(vars(one)[last]) if last in vars(one) else ""


@pytest.mark.parametrize(("docstring", "known"), [("As of `choose`.", {"u", "y"}), ("No.", set())])
def test_a_docstring_has_the_parameters_of_those_that_it_names(docstring, known):
    found = describing(docstring, minorloop.Adaptive, "roles")
    assert set().union(*map(described, found)) == known


@pytest.mark.parametrize("name", CALLABLES)
def test_every_parameter_of_a_public_name_is_described(name):
    found = getattr(minorloop, name)
    if not getattr(found, "_is_protocol", False):
        # A dataclass has the fields of those that it is made from, which describe them.
        made_from = inspect.getmro(found)[:-1] if inspect.isclass(found) else [found]
        known = [described(inspect.getdoc(one)) for one in made_from if inspect.getdoc(one)]
        known += [described_fields(one) for one in made_from if is_dataclass(one)]
        assert parameters(found) <= set().union(*known)
    for method, function in vars(found).items() if inspect.isclass(found) else ():
        function = getattr(function, "__func__", function)
        if inspect.isfunction(function) and not method.startswith("_"):
            known = [described(one) for one in describing(inspect.getdoc(function), found, method)]
            assert parameters(function) <= set().union(*known), method


@pytest.mark.parametrize("name", CALLABLES)
def test_a_public_name_has_an_example_that_does_what_it_shows(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names, found = {"ml": minorloop, "np": np}, []
    (example,) = doctest.DocTestFinder(recurse=False).find(
        getattr(minorloop, name), name, extraglobs=names
    )
    result = doctest.DocTestRunner(verbose=False).run(example, out=found.append)
    assert result.attempted
    assert not found


def test_the_table_of_public_names_is_complete_and_right():
    text = (REFERENCE / "index.md").read_text()
    listed = dict(re.findall(r"\{py:\w+\}`(\w+) <([\w.]+)>`", text))
    assert set(listed) == {*minorloop.__all__} - {"__version__"}
    for name, target in listed.items():
        module, _, last = target.rpartition(".")
        found = getattr(minorloop, name)
        assert found is (
            import_module(target)
            if inspect.ismodule(found)
            else getattr(import_module(module), last)
        )


def test_the_simulated_pipe_names_the_installation_that_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(SystemExit, match="cv2 is not installed; run make setup"):
        runpy.run_path(str(ROOT / "examples" / "simulated_pipe.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.stem)
def test_examples_run(example, capsys):
    runpy.run_path(str(example))
    if "figures" not in example.stem:
        assert len(capsys.readouterr().out.splitlines()) >= 2

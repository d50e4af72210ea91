"""What is built holds what it should, and nothing else; `make smoke` installs and uses it."""

import runpy
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BUILT_BY_NODE = "minorloop/head/console/static/"


def present(*folders):
    """Files of the tree, without what is built, cached or installed there."""
    built = ("__pycache__", "node_modules", "static")
    return {
        file.relative_to(ROOT).as_posix()
        for folder in folders
        for file in (ROOT / folder).rglob("*")
        if file.is_file() and not set(file.parts) & set(built) and ".egg-info" not in str(file)
    }


def built(kind):
    wheel = pytest.importorskip("hatchling.builders.wheel", reason="hatchling is not installed")
    sdist = pytest.importorskip("hatchling.builders.sdist")
    builder = {"wheel": wheel.WheelBuilder, "sdist": sdist.SdistBuilder}[kind](str(ROOT))
    return {file.distribution_path.replace("\\", "/") for file in builder.recurse_included_files()}


def test_the_wheel_is_the_package():
    files = {name for name in built("wheel") if not name.startswith(BUILT_BY_NODE)}
    assert {f"src/{name}" for name in files} == present("src")
    for name in ("py.typed", "export/templates/model.c", "templates/report.html"):
        assert f"minorloop/{name}" in files


def test_the_pages_are_in_the_wheel_once_they_are_built():
    if not (ROOT / "src" / BUILT_BY_NODE / "index.html").exists():
        pytest.skip("the pages are not built; make pages builds them")
    for kind, before in (("wheel", ""), ("sdist", "src/")):
        assert f"{before}{BUILT_BY_NODE}index.html" in built(kind)


def test_the_source_distribution_is_enough_to_build_test_and_read():
    files = built("sdist")
    wanted = present("src", "tests", "docs", "benchmarks", "examples", "web") | {
        *("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "LICENSE", "Makefile"),
        "SECURITY.md",
        *("pyproject.toml", "requirements.lock"),
        *("requirements-core.lock", "requirements-judge.lock"),
    }
    assert wanted - files == set()
    strange = {n for n in files if n.split("/")[0] in ("build", "dist", "demo", ".git", ".venv")}
    assert not strange
    assert not any("node_modules" in name or "__pycache__" in name for name in files)


def test_the_citation_file_can_be_cited():
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    content = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    from minorloop import __version__

    assert content["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= set(content)
    assert content["version"] == __version__
    assert content["license"] == project["license"]
    assert content["authors"][0]["name"] == project["authors"][0]["name"]
    kinds = {"article", "conference-paper"}
    families = [[a["family-names"] for a in paper["authors"]] for paper in content["references"]]
    assert [names[0] for names in families] == ["Chen", "Sohn", "Boudjabi"]
    for paper in content["references"]:
        assert paper["type"] in kinds
        assert paper["title"]
        if paper["type"] == "conference-paper":
            assert 2000 < paper["year"] < 2010
            assert paper["conference"]["name"]
            assert len(paper["conference"]["country"]) == 2


def test_every_extra_is_used_by_the_smoke_test():
    with (ROOT / "pyproject.toml").open("rb") as file:
        extras = tomllib.load(file)["project"]["optional-dependencies"]
    uses = runpy.run_path(str(Path(__file__).with_name("smoke.py")))["USES"]
    assert set(uses) == set(extras)

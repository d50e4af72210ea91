"""What is built holds what it should, and nothing else; `make smoke` installs and uses it."""

import runpy
import tomllib
from pathlib import Path

import pytest

import minorloop.version
import minorloop_head.version

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {"minorloop": "minorloop", "minorloop-head": "minorloop_head"}
BUILT_BY_NODE = {
    "minorloop": ("minorloop/page/static/lab.html", "/lab", ["Leon Sorokin"]),
    "minorloop-head": (
        "minorloop_head/console/static/index.html",
        "",
        ["Leon Sorokin", "three.js authors"],
    ),
}
"""Page of each package, the path that its files are served at, and authors of what it contains."""
packages = pytest.mark.parametrize("folder", PACKAGES)


def present(folder):
    """Files of the source of a package, without what is built, cached or installed there."""
    source = ROOT / "packages" / folder / "src"
    built = ("__pycache__", "static")
    return {
        file.relative_to(source).as_posix()
        for file in source.rglob("*")
        if file.is_file() and not set(file.parts) & set(built) and ".egg-info" not in str(file)
    }


def built(folder, kind):
    wheel = pytest.importorskip("hatchling.builders.wheel", reason="hatchling is not installed")
    sdist = pytest.importorskip("hatchling.builders.sdist")
    builder = {"wheel": wheel.WheelBuilder, "sdist": sdist.SdistBuilder}[kind]
    files = builder(str(ROOT / "packages" / folder)).recurse_included_files()
    return {file.distribution_path.replace("\\", "/") for file in files}


@packages
def test_wheel_and_source_distribution_are_the_package(folder):
    files = {name for name in built(folder, "wheel") if "/static/" not in name}
    assert files == present(folder)
    assert f"{PACKAGES[folder]}/py.typed" in files
    inside = built(folder, "sdist")
    assert {f"src/{name}" for name in files} <= inside
    assert not any("__pycache__" in name for name in inside)


@packages
def test_the_pages_are_in_the_wheel_with_licences_once_they_are_built(folder):
    page, path, authors = BUILT_BY_NODE[folder]
    source = ROOT / "packages" / folder / "src" / page
    if not source.exists():
        pytest.skip("the pages are not built; make pages builds them")
    text = source.with_name("licenses.txt").read_text()
    assert [each for each in authors if each not in text] == []
    assert f'href="{path}/licenses.txt"' in source.read_text()
    for kind, before in (("wheel", ""), ("sdist", "src/")):
        assert f"{before}{page}" in built(folder, kind)


def test_both_packages_have_one_version():
    assert minorloop.version.__version__ == minorloop_head.version.__version__


def project(folder):
    with (ROOT / "packages" / folder / "pyproject.toml").open("rb") as file:
        return tomllib.load(file)["project"]


def test_the_citation_file_can_be_cited():
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    content = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert content["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= set(content)
    assert content["version"] == minorloop.__version__
    assert content["license"] == project("minorloop")["license"]
    assert content["authors"][0]["name"] == project("minorloop")["authors"][0]["name"]
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
    uses = runpy.run_path(str(Path(__file__).with_name("smoke.py")))["USES"]
    assert set(uses) == {*project("minorloop")["optional-dependencies"], "head"}

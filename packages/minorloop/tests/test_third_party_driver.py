"""The driver of the gallery with the line that docs/how-to/instruments.md has for its package."""

import re
from importlib import invalidate_caches
from pathlib import Path

import pytest

from minorloop import ParameterError, Store, connect
from minorloop.cli import main
from minorloop.connect import addresses

ROOT = Path(__file__).parents[3]


def install(folder, module, points):
    """Write the files that ``pip install`` writes for a package of one file."""
    (folder / "acme_stage.py").write_text(module)
    about = folder / "acme_stage-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-stage\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(points)


@pytest.fixture
def installed(tmp_path, monkeypatch):
    notebook = (ROOT / "examples/gallery/07_instrument.py").read_text()
    (stage,) = re.findall(r"^class Stage:.*?(?=^\S)", notebook, re.S | re.M)
    module = f"import numpy as np\nimport minorloop as ml\n\n{stage}"
    page = (ROOT / "docs/how-to/instruments.md").read_text()
    (table,) = re.findall(r"```text\n(\[project.*?)```", page, re.S)
    points = table.replace("project.entry-points.", "").replace('"', "")
    site = tmp_path / "site"
    site.mkdir()
    module += "\ndef simulated(name, *, specimen=None, noise=0.0, seed=0):\n    return specimen\n"
    install(site, module, f"{points}broken = acme_stage:Nothing\nsim = acme_stage:simulated\n")
    monkeypatch.syspath_prepend(site)
    invalidate_caches()
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("installed")
def test_the_address_of_an_installed_driver_is_known(capsys):
    assert "stage:NAME" in addresses()
    assert connect("stage:COM3").port == "COM3"
    with pytest.raises(ParameterError, match=r"'stage:NAME'"):
        connect("stag:COM3")
    with pytest.raises(ParameterError, match=r"the driver of broken:x cannot be loaded: .*Nothing"):
        connect("broken:x")
    assert connect("sim:x", specimen=3) == 3
    assert main(["run", "--help"]) == 0
    assert "stage:NAME" in " ".join(capsys.readouterr().out.split())


@pytest.mark.usefixtures("installed")
def test_an_installed_driver_is_run_and_resumed():
    Path("plan.csv").write_text("voltage [V],hold [s]\n0,10\n50,10\n")
    drive = ["run", "--actuator", "stage:COM3", "--plan", "plan.csv", "--store", "s.sqlite"]
    assert main(drive) == 0
    with Store.open("s.sqlite") as store:
        assert store.setup.address == "stage:COM3"
        values = [point.value for point in store.points()]
        assert values == pytest.approx([0.0, 5.0], abs=0.002)
    assert main(["resume", "--store", "s.sqlite"]) == 0

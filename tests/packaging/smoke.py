"""``python tests/packaging/smoke.py [EXTRA ...]``: does what is built work where nothing else is?

Builds the source distributions, and the wheels from these; installs that of the core in a fresh
environment and uses it; runs the core's tests there; then installs each extra, and the head, alone,
in an environment of its own on top of the plain one, and uses what it brings. Before that, the
plain one has to say which extra is missing. All of it is in build/smoke, with the locked versions.
``core`` as the extra runs the core's tests and no extra; ``lowest`` runs them with the lowest
versions that the core allows.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
import tomllib
import venv
import zipfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PLACE = ROOT / "build" / "smoke"
INSTALL, USE, TESTS = 900, 300, 1800
"""Seconds that an installation, a use and the core's tests may take."""

MODEL = """
import numpy as np
from minorloop import Preisach
model = Preisach(np.linspace(-1, 1, 6), np.tril(np.ones((5, 5))))
"""
USES = {
    "frames": """
import pandas
from minorloop import Record
frame = pandas.DataFrame({"voltage [V]": [0.0, 1.0], "tip [mm]": [0.0, 2.0]})
assert len(Record(frame["voltage [V]"], frame["tip [mm]"])) == 2
""",
    "excel": """
import openpyxl
from minorloop import read
book = openpyxl.Workbook()
for row in (["voltage [V]", "tip [mm]"], [0.0, 1.0], [1.0, 2.0]):
    book.active.append(row)
book.save("log.xlsx")
assert len(read("log.xlsx", input="voltage", output="tip", time=None)) == 2
""",
    "fmi": MODEL
    + """
import shutil, sys, tempfile
import fmpy
if shutil.which("cc"):
    from minorloop.export.fmu import export_fmu
    path = tempfile.mkdtemp() + "/model.fmu"
    export_fmu(model, path)
    found = fmpy.simulate_fmu(path, stop_time=0.1)
    assert len(found) > 1
    assert not fmpy.validation.validate_fmu(path)
""",
    "control": MODEL
    + """
from minorloop.export.python_control import as_system
assert as_system(model).ninputs == 1
""",
    "sklearn": """
import numpy as np
from minorloop.export.sklearn import PreisachRegressor
u = np.sin(np.arange(60.0))[:, None]
assert PreisachRegressor(levels=4).fit(u, u[:, 0] ** 3).score(u, u[:, 0] ** 3) > 0.9
""",
    "jax": MODEL
    + """
import jax
from minorloop.export.jax import as_function
function, parameters = as_function(model)
slopes = jax.grad(lambda p: function(p, [0.1, 0.9, -0.3]).sum())(parameters)
assert slopes["weights"].shape == (5, 5)
""",
    "fleet": MODEL
    + """
import tempfile
from pathlib import Path
from minorloop.fleet import identify_fleet, read_manifest
if __name__ == "__main__":
    folder = Path(tempfile.mkdtemp())
    u = np.sin(np.arange(80.0))
    table = np.column_stack([u, model.simulate(u)])
    np.savetxt(folder / "a.csv", table, delimiter=",", header="u,y", comments="")
    (folder / "m.csv").write_text("specimen,file\\na,a.csv\\n")
    specimens = read_manifest(folder / "m.csv", input="u", output="y")
    summary = identify_fleet(specimens, folder / "out", workers=1, levels=4, prior="none")
    assert len(summary.identified) == 1, summary.failures
    from distributed import LocalCluster
    local = {"n_workers": 1, "processes": False, "protocol": "tcp://"}
    with LocalCluster(dashboard_address=None, **local) as cluster:
        address = cluster.scheduler_address
        summary = identify_fleet(specimens, folder / "far", workers=address, levels=4, prior="none")
    assert len(summary.identified) == 1, summary.failures
""",
    "instruments": """
from minorloop.lab.drivers.link import VisaLink
VisaLink("ASRL/dev/does-not-exist::INSTR")
""",
    **{
        extra: f"""
from minorloop.lab.drivers.{extra} import open_device
from minorloop.lab.drivers.device import DeviceChannel, DevicePlan
sources = (DeviceChannel("voltage", {wire}, low=0.0, high=1.0),) if {wire} else ()
open_device(DevicePlan("one", {keys}, sources))
"""
        for extra, keys, wire in (
            ("daqmx", {"device": "NoSuchDevice"}, {"channel": "ao0"}),
            ("labjack", {}, {}),
            ("modbus", {"host": "127.0.0.1", "port": 1}, {}),
        )
    },
    "page": """
from minorloop.page.auth import Authentication
from minorloop.page.lab import LabPage, application
from minorloop.page.serving import serve
assert application(Authentication("127.0.0.1"), LabPage()).routes
""",
    "head": """
import cv2
import numpy as np
from minorloop.page.auth import Authentication
from minorloop_head.console.loop import LoopSettings
from minorloop_head.console.server import STATIC, Console
import uvicorn, websockets
authentication = Authentication("127.0.0.1")
app = Console(authentication=authentication, loop=LoopSettings(address="twin:rig")).app()
assert app.routes
from minorloop_head.reconstruction.depth_map import mesh_of
from minorloop_head.reconstruction.depth_map import DepthMap, Patch
patch = Patch(0.0, 0.0, 4, 5, step=0.001)
flat = np.zeros((patch.rows, patch.columns))
wall = DepthMap(patch, flat, flat + 1e-5, flat.astype(np.uint8) + 1)
assert len(mesh_of(wall).vertices) == flat.size
""",
}
MISSING = {
    "instruments": "cannot be opened",
    "daqmx": "cannot be used",
    "labjack": "cannot be used",
    "modbus": "127.0.0.1:1",
}
"""What the extras of instruments say of devices that are not there."""

SAYS = {
    "control": (USES["control"], "python-control"),
    "sklearn": ("import minorloop.export.sklearn", "scikit-learn"),
    "jax": ("import minorloop.export.jax", "jax"),
    "fleet": (
        "from minorloop.fleet._cluster import _connect; _connect('tcp://127.0.0.1:1')",
        "dask.distributed",
    ),
    "instruments": (USES["instruments"], "pyvisa"),
    "daqmx": (USES["daqmx"], "nidaqmx"),
    "labjack": (USES["labjack"], "labjack-ljm"),
    "modbus": (USES["modbus"], "pymodbus"),
    "page": ("from minorloop.cli.lab import run; run()", "starlette"),
}
"""What each extra is asked for by, and what is said to be missing without it."""

CORE_TESTS = ["pytest", "pytest-xdist", "hypothesis"]
"""What the core's tests need beside the wheel; those of other packages are skipped without them."""

ABSENT = """
import importlib.util as search
packages = "cv2 starlette uvicorn websockets trimesh pandas distributed pyvisa pymodbus".split()
assert not [name for name in packages if search.find_spec(name)]
"""

PLAIN = """
minorloop --version
minorloop --help
minorloop demo --out demo
minorloop export c demo/model.json --out c
python -m minorloop --version
"""


def main(extras: list[str]) -> None:
    began = time.perf_counter()
    shutil.rmtree(PLACE, ignore_errors=True)
    PLACE.mkdir(parents=True)
    wheel, head = build("minorloop"), build("minorloop-head")
    lowest = extras == ["lowest"]
    (PLACE / "constraints.txt").write_text(least_versions() if lowest else constraints())
    plain = environment("plain", None)
    install(plain, str(wheel))
    for line in PLAIN.split("\n")[1:-1]:
        program, *words = line.split()
        run([str(plain / "bin" / program), *words], USE)
    for extra, (code, package) in SAYS.items():
        said = use(plain, code, fails=True)
        wanted = f"{package} is not installed; pip install 'minorloop[{extra}]' brings it"
        assert wanted in said, f"without {extra}: {said}"
    say(began, "plain", f"{wheel.name} works, and says what is missing")
    if not extras or "core" in extras or lowest:
        say(began, "core", test_core(plain, lowest))
    for extra in (
        [name for name in extras if name not in ("core", "lowest")] if extras else wanted_extras()
    ):
        place = environment(extra, plain)
        install(place, str(head) if extra == "head" else f"{wheel}[{extra}]")
        said = use(place, USES[extra], fails=extra in MISSING)
        assert MISSING.get(extra, "") in said, f"without a device: {said}"
        shutil.rmtree(place)
        say(began, extra, "installs alone and works")


def test_core(plain: Path, lowest: bool) -> str:
    """Run the core's tests on the plain wheel; return pytest's last line."""
    use(plain, ABSENT)
    place = environment("core", plain)
    install(place, *CORE_TESTS)
    # Old libraries may warn of newer ones below them.
    lenient = ["-W", "ignore::DeprecationWarning"] if lowest else []
    pytest = [str(place / "bin" / "python"), "-m", "pytest", "packages/minorloop/tests", *lenient]
    said = run(pytest, TESTS, ROOT)
    shutil.rmtree(place)
    return said.strip().splitlines()[-1]


def wanted_extras() -> list[str]:
    """The extras of the project; each has to have a use here."""
    extras = [*core_project()["optional-dependencies"], "head"]
    assert set(extras) == set(USES), f"extras and uses differ: {set(extras) ^ set(USES)}"
    return extras


def build(package: str) -> Path:
    """The wheel that the source distribution makes; it has to be that of the tree."""
    place, hatchling = PLACE / package, [sys.executable, "-m", "hatchling", "build"]
    run([*hatchling, "-d", str(place / "dist")], USE, ROOT / "packages" / package)
    (sdist,) = (place / "dist").glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(place / "source", filter="data")
    (source,) = (place / "source").iterdir()
    run([*hatchling, "-t", "wheel", "-d", str(place / "rebuilt")], USE, source)
    (first,), (second,) = ((place / at).glob("*.whl") for at in ("dist", "rebuilt"))
    inside = [set(zipfile.ZipFile(file).namelist()) for file in (first, second)]
    assert inside[0] == inside[1], f"wheels differ: {sorted(inside[0] ^ inside[1])[:9]}"
    return second


def constraints() -> str:
    """The locked versions, without the digests, which only fit some files."""
    lock = (ROOT / "requirements.lock").read_text()
    return "\n".join(line.rstrip(" \\") for line in lock.splitlines() if re.match(r"\w", line))


def least_versions() -> str:
    """The lowest versions of what the core depends on."""
    return "\n".join(core_project()["dependencies"]).replace(">=", "==")


def core_project() -> dict[str, Any]:
    """The metadata of the core."""
    return tomllib.loads((ROOT / "packages/minorloop/pyproject.toml").read_text())["project"]


def environment(name: str, below: Path | None) -> Path:
    """A fresh environment; what is below is there too, and nothing else."""
    place = PLACE / name
    venv.create(place, with_pip=True)
    if below is not None:
        (packages,) = (below / "lib").glob("*/site-packages")
        (mine,) = (place / "lib").glob("*/site-packages")
        (mine / "below.pth").write_text(f"{packages}\n")
    return place


def install(place: Path, *packages: str) -> None:
    pip = [str(place / "bin" / "python"), "-m", "pip", "install", "--quiet"]
    limits = ["--disable-pip-version-check", "-c", str(PLACE / "constraints.txt")]
    run([*pip, *limits, *packages], INSTALL)


def use(place: Path, code: str, *, fails: bool = False) -> str:
    script = PLACE / "use.py"  # a file, for workers import the script that started them
    script.write_text(code)
    return run([str(place / "bin" / "python"), "-W", "ignore", str(script)], USE, fails=fails)


def run(command: list[str], seconds: float, folder: Path = PLACE, *, fails: bool = False) -> str:
    blank = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    known = {name: value for name, value in os.environ.items() if name not in blank}
    done = subprocess.run(
        command, cwd=folder, env=known, capture_output=True, text=True, timeout=seconds, check=False
    )
    said = done.stdout + done.stderr
    if (done.returncode != 0) != fails:
        raise SystemExit(f"{' '.join(command)} ended with {done.returncode}:\n{said[-4000:]}")
    return said


def say(began: float, what: str, text: str) -> None:
    print(f"{time.perf_counter() - began:6.0f} s  {what}: {text}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])

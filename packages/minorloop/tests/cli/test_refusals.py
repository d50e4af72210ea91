"""What verbs refuse: one line on stderr, exit status 2, and no file is written."""

from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest

from command_line import MODEL, write, write_files
from minorloop import modelfile
from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.oscillator import Oscillator
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.differential import BoucWen
from minorloop.operators.preisach import Preisach

UNITS = {"input": "voltage [V]", "output": "length [um]"}
STRIP = Preisach(np.linspace(-1.2, 1.2, 9), np.tril(np.full((8, 8), 0.24)))
PLANE = Preisach(np.linspace(-1, 1, 5), np.tril(np.ones((4, 4))), diagonal="reversible")
FORCE = BoucWen(7e4, 500.0, 1300.0)
MODELS = {
    "late": Cascade(MODEL, Linear.lags(0.05, 0.02)),
    "creep": AfterEffect(PLANE, times=[5.0], creep=[0.4 * np.tril(np.ones((4, 4)))]),
    "rough": Oscillator(3.0, 5.0, 3e4, FORCE),
}
TEXTS = {
    "empty.csv": "voltage,length\n0.1,\n0.2,\n",
    "far.csv": "time [s],length [um]\n0,6\n0.01,6\n0.02,6\n",
    "curvatures.csv": "curvature [1/m]\n2\n-30\n",
    "fleet.csv": "specimen,file\na,good.csv\n",
    "broken.json": "{",
}


def write_more_files():
    for name, model in MODELS.items():
        units = {} if isinstance(model, Oscillator) else UNITS
        modelfile.save(model, f"{name}.json", **units)
    modelfile.save(STRIP, "strip.json", input="voltage [V]", output="curvature [1/m]")
    for name, text in TEXTS.items():
        Path(name).write_text(text)
    t, u = 0.1 * np.arange(800), np.repeat([-1, -0.4, 0.3, 1, 0.2, -0.6, 0.5, -0.1], 100)
    write("log.csv", "time [s],voltage [V],distance [mm]", np.column_stack([t, u, 20 - u]))
    t, u = np.arange(60) / 750, np.sin(np.arange(60.0))
    write("moved.csv", "time [s],force [N],displacement [m]", np.column_stack([t, u, 1e-6 * u]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder for all of these tests, which write nothing."""
    with chdir(tmp_path_factory.mktemp("refusals")):
        write_files()
        write_more_files()
        yield Path.cwd()


@pytest.fixture(autouse=True)
def _there(_somewhere, folder, monkeypatch):
    monkeypatch.chdir(folder)


IDENTIFY = "identify good.csv --input voltage --output length"
MOVED = "identify moved.csv --input force --output displacement"
INVERT = "invert model.json targets.csv --target length"
DRIVE = "drive strip.json curvatures.csv --target curvature --actuator twin:ipmc --store a.sqlite"
TIMED = DRIVE.replace("strip", "creep").replace("curvatures.csv --target curvature", "targets.csv "
"--target length")  # fmt: skip
PLAN = "plan decaying --low -1.2 --high 1.2 --levels 4"
SINES = "plan sines:frequencies=0.2,1,amplitudes=0.7,1,preamble=-1.2"
REDUCE = "reduce log.csv --input voltage --output distance"
EXPORT = "model.json --out x"
FLEET = "fleet fleet.csv --out x --input voltage --output length"


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("fly", "No such command 'fly'; see minorloop --help"),
        ("identify", "Missing argument 'file'; see minorloop identify --help"),
        ("identify good.csv --output length", "input (--input) is missing; name a column"),
        (f"{IDENTIFY} --law 'lag=3 rows'", "lag is '3 rows'; give it in one of s, ms"),
        (f"{IDENTIFY} --time none --law lag=25ms", "name its column (--time)"),
        (f"{IDENTIFY} --law odd:levels=3", "there is no law 'odd'; give one of plane, dynamics"),
        (f"{IDENTIFY} --law dynamics", "name the column of time"),
        (f"{IDENTIFY} --record rows=5", "give two whole numbers A:B, such as 200:7000"),
        (f"{IDENTIFY} --record start_of_curve=positive", "give curves (--record curves=COLUMN)"),
        (f"{IDENTIFY} --save model.json", "model.json exists already"),
        (f"{IDENTIFY} --save good.csv --force", "good.csv is an input and is not replaced"),
        (f"{MOVED} --law viscosity --time none", "--time is missing; --law viscosity needs"),
        (f"{MOVED} --law viscosity --holdout 0.3", "laws of time are scored on parts left out"),
        (f"{MOVED} --law vibration:rough=unknow", "give unknown, or a model file"),
        (f"{MOVED} --law vibration:rough=model.json", "give one with a rough oscillator"),
        ("simulate late.json good.csv", "needs times; name the column of time (--time)"),
        (
            "simulate rough.json moved.csv --input force --time time --record start=positive",
            "begins at rest",
        ),
        ("score model.json empty.csv", "no row is left to score"),
        ("invert rough.json moved.csv --target displacement", "an oscillator, whose output"),
        ("invert late.json far.csv --target length --time time", "rests at"),
        (f"{INVERT} --time time --hold 3", "--hold and --time cannot be combined"),
        (f"{INVERT} --hold nan", "--hold is nan; give a positive number of seconds"),
        ("plan spiral --low 0 --high 1", "no plan 'spiral'; give one of decaying, reversal"),
        (f"{PLAN} --input 'u\x1b[2J [V]'", "--input is 'u\\x1b[2J [V]', which has the character"),
        (f"{PLAN} --save good.csv", "or --force to replace it"),
        (SINES.replace(",preamble=-1.2", ""), "plan sines needs preamble"),
        ("runs list --store .", "there is no experiment store in ."),
        ("runs sing --store a", "there is no action 'sing'"),
        (DRIVE.replace("strip.json", "good.csv"), "good.csv is a table, not a model file; give"),
        (DRIVE.replace("curvatures.csv --target curvature", "far.csv --target length"), "is in um"),
        (f"{DRIVE} --every 10", "identify one with creep (--law viscosity)"),
        (f"{TIMED} --every 10 --corrections 2", "--corrections cannot be combined with --every"),
        (f"{REDUCE} --convert laser:20", "give laser:D0,H0[,SD,SD], numbers separated by commas"),
        (f"{REDUCE} --convert laser:2000,15", "none of the 8 holds has a usable output"),
        ("frequency good.csv --input voltage --output length", "good.csv has no column 'freq"),
        ("export rust model.json --out x", "no export 'rust'; give one of c, fmu"),
        (f"export c:linear=broken.json {EXPORT}", "is not a linear part"),
        (f"export c:first=linear {EXPORT}", "first does nothing without linear"),
        ("export c rough.json --out x --interval 0.1", "the file has an oscillator"),
        (f"{FLEET} --law viscosity", "there is no law of a fleet 'viscosity'"),
        ("demo --out good.csv", "good.csv is a file; give the name of a folder"),
    ],
)
def test_a_refusal_is_one_sentence_and_writes_nothing(line, says, refused):
    before = {path: path.read_bytes() for path in Path().iterdir()}
    assert says in refused(line)
    assert {path: path.read_bytes() for path in Path().iterdir()} == before

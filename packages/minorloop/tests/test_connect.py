import math
import os
import pty
import sys
import threading
import tty
from pathlib import Path

import numpy as np
import pytest

from board_process import EXAMPLES
from minorloop import Actuator, InstrumentError, LimitError, ParameterError, connect

TWINS = ("ipmc", "ipmc-laser", "fibre")


@pytest.mark.parametrize("name", TWINS)
def test_every_twin_has_an_address(name):
    twin = connect(f"twin:{name}")
    assert isinstance(twin, Actuator)
    lowest = np.array([channel.low for channel in twin.inputs])
    record = twin.apply(lowest if lowest.size > 1 else lowest[0], 1.0, 0.5)
    assert [str(q) for q in record.inputs] == [str(c) for c in twin.inputs]
    assert [str(q) for q in record.outputs] == [str(c) for c in twin.outputs]


@pytest.mark.parametrize("address", ["twin:impc", "ipmc", "", "twin:", "visa:", "vsa:x"])
def test_refuses_unknown_addresses_and_names_the_known_ones(address):
    with pytest.raises(ParameterError, match=r"give one of .*'twin:ipmc'.*'visa:NAME'"):
        connect(address)


def test_instruments_are_described_by_a_file_and_have_no_specimen(tmp_path):
    with pytest.raises(ParameterError, match="cannot be read"):
        connect(f"visa:{tmp_path / 'bench.json'}")
    with pytest.raises(ParameterError, match="is not simulated; leave specimen"):
        connect("visa:bench.json", specimen=1)
    with pytest.raises(ParameterError, match="has no option 'tick'; it takes none"):
        connect("visa:bench.json", tick=1.0)


MODULE = """
from minorloop.twins.ipmc import Ipmc

def strip(name="nominal"):
    return Ipmc(noise=0.0 if name == "nominal" else 0.1)

def nothing():
    return 7

def broken():
    return {}["cable"]

def exits():
    raise SystemExit(7)

number = 7
"""


@pytest.fixture
def home(tmp_path, monkeypatch):
    (tmp_path / "home_made.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])


@pytest.mark.usefixtures("home")
def test_a_function_of_a_module_in_the_current_folder_makes_an_actuator():
    plant = connect("module:home_made.strip")
    assert isinstance(plant, Actuator)
    assert plant.exchange(1.0) == connect("twin:ipmc").exchange(1.0)
    assert connect("module:home_made.strip:noisy").exchange(1.0) != plant.exchange(1.0)
    with pytest.raises(LimitError):
        plant.exchange(1e308)


@pytest.mark.usefixtures("home")
@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("home_made", "has no function of a module; give module:PACKAGE.FUNCTION"),
        ("home_made.nobody", "cannot be loaded: .*nobody.*; give module:PACKAGE.FUNCTION"),
        ("no_such_home.stage", "cannot be loaded: No module named 'no_such_home'"),
        ("stage", "has no function of a module"),
        ("home_made.number", "is no function"),
        ("home_made.nothing", "int is not an actuator: it has no inputs"),
        ("home_made.broken", "failed: KeyError: 'cable'"),
        ("home_made.exits", "failed: SystemExit: 7"),
        ("home_failing.stage", "cannot be loaded: .*zero"),
        ("home_leaving.stage", "cannot be loaded: .*7"),
    ],
)
def test_a_module_without_an_actuator_is_refused_in_one_sentence(name, sentence):
    Path("home_failing.py").write_text("1 / 0")
    Path("home_leaving.py").write_text("raise SystemExit(7)")
    failed = "failed" in sentence or "failing" in name or "leaving" in name
    with pytest.raises(
        InstrumentError if failed else ParameterError, match=f"module:{name}.*{sentence}"
    ):
        connect(f"module:{name}")


class Amplifier:
    """The device of examples/home_made_plant.py on a pseudo-terminal, in a thread."""

    def __init__(self, outputs=None):
        self.outputs = outputs

    def __enter__(self):
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        self.inputs, self.seen = "0 0", []
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()
        return self

    def _serve(self):
        with open(self.master, "rb", buffering=0, closefd=False) as line:
            buffer = b""
            while b"END" not in buffer:
                buffer += line.read(64)
                *lines, buffer = buffer.split(b"\n")
                for each in lines:
                    self.seen.append(each.decode())
                    self.inputs = {b"U": each[2:].decode(), b"O": "0 0"}.get(each[:1], self.inputs)
                    outputs = self.outputs or " ".join(
                        f"{float(u) / 2:g}" for u in self.inputs.split()
                    )
                    answer = self.inputs if each[:1] in (b"U", b"O") else outputs
                    os.write(self.master, f"{answer}\n".encode())

    def __exit__(self, *_):
        os.write(self.slave, b"END")
        self._thread.join()
        os.close(self.master)
        os.close(self.slave)


def test_a_plant_names_the_package_that_it_imports(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    monkeypatch.chdir(EXAMPLES)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with pytest.raises(ParameterError, match=r"stage cannot be loaded: .*; install serial, which"):
        connect("module:home_made_plant.stage:/dev/ttyACM0")


def test_the_plant_of_the_examples_has_at_most_40_lines_and_is_a_stage(monkeypatch):
    pytest.importorskip("serial", reason="needs pyserial: minorloop[instruments]")
    assert len((EXAMPLES / "home_made_plant.py").read_text().splitlines()) <= 40
    monkeypatch.chdir(EXAMPLES)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with Amplifier() as amplifier:
        plant = connect(f"module:home_made_plant.stage:{os.ttyname(amplifier.slave)}")
        assert plant.serial == "S-02"
        assert plant.at_once([10.0, 20.0]).tolist() == [5.0, 10.0]
        for wrong in (100.5, math.nan, math.inf):
            with pytest.raises(LimitError):
                plant.exchange([wrong, 0.0])
        plant.safe()
        plant.close()
        assert amplifier.seen[-1] == "OFF"
    assert not [line for line in amplifier.seen if line.startswith("U 100.5")]


def test_an_answer_that_a_home_made_driver_cannot_read_is_one_sentence(monkeypatch):
    pytest.importorskip("serial", reason="needs pyserial: minorloop[instruments]")
    monkeypatch.chdir(EXAMPLES)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with Amplifier("xx 3a") as amplifier:
        address = f"module:home_made_plant.stage:{os.ttyname(amplifier.slave)}"
        for _ in range(2):  # the port is free again
            with pytest.raises(InstrumentError, match=r"the driver failed: ValueError: .*xx"):
                connect(address)

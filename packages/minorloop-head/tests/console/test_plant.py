import time
from dataclasses import replace

import numpy as np
import pytest

from board_process import commands, simulated_board
from console_rig import Pilot
from minorloop.errors import InstrumentError, LimitError, ModelFileError, ParameterError
from minorloop_head.console.plant import flowing_water, head_at, open_plant, probed
from minorloop_head.console.watchdog import Command, WatchedPlant
from minorloop_head.procedures.head_file import HeadFile, save_head
from minorloop_head.twins.surroundings import Surroundings, convection


def test_the_gas_of_the_simulated_pipe_cools_the_wires_of_its_head_while_it_is_drained():
    dense = replace(flowing_water(), gas="forced gas", pressure=5e5)
    plain, cooled = open_plant("twin:pipe"), open_plant("twin:pipe", water=dense)
    assert plain.head.surroundings.convection == Surroundings().convection
    assert cooled.head.surroundings.convection == convection("forced gas", pressure=5e5)
    for plant in (plain, cooled):
        plant.flood(True)
        assert plant.head.surroundings.convection == convection("flooded, sleeved")
        plant.flood(False)
    assert cooled.head.surroundings.convection > 2 * plain.head.surroundings.convection


def test_the_file_of_the_head_is_read_and_that_of_another_refused(tmp_path):
    file = tmp_path / "head.json"
    save_head(HeadFile(serial="twin-head-3"), file)
    assert head_at("twin:pipe", 3, file)[0].serial == "twin-head-3"
    with pytest.raises(ModelFileError, match=r"'twin-head-3', and the head here is 'twin-head-4'"):
        head_at("twin:pipe", 4, file)


@pytest.fixture
def board(tmp_path):
    pytest.importorskip("pyvisa_py", reason="needs pyvisa-py: minorloop[instruments]")
    with simulated_board(tmp_path, bench="head.toml") as (address, _):
        yield address, tmp_path


def test_a_head_on_a_serial_board_is_steered(board):
    address, folder = board
    assert probed(address) == ("H-01", 0.04, 3, True)
    plant = open_plant(address)
    for seconds in (0.2, 0.0):  # a loop that is late; the plant does not keep its ticks
        plant.exchange(np.zeros(4))
        time.sleep(seconds)
    assert 0.2 <= plant.time < 60.0
    pilot = Pilot(plant=plant).steering(2)
    assert pilot.session.state.mode == "HEAD"
    pilot.until(lambda s: s.reading[0] > 0.02)  # rad: its wires get warm, in the board's own time
    plant.safe()
    plant.close()
    sent = np.array([words[1:] for words in commands(folder) if words[0] == "SET"], float)
    assert sent.max() == pytest.approx(0.4)


class Hostile:
    """A control that asks for anything, as a page that has taken it over would."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def currents(self):
        wild = [np.nan, np.inf, -np.inf, 1e308, -1e-3, 0.4000001, 5.0, 0.1, 0.4]
        return self.rng.choice(wild, 2).tolist()


def test_no_command_beyond_the_limits_reaches_a_board_whoever_sends_it(board, monkeypatch):
    address, folder = board
    plant = open_plant(address)
    watched = WatchedPlant(plant, 60.0)
    hostile, refused = Hostile(1000), 0
    for _ in range(60):
        watched._carry_out(Command(0.0, [*hostile.currents(), 1e9, np.nan]))
        refused += watched.why.startswith("a command could not be carried out")
        watched.why = ""
    plant.close()
    (folder / "faulty.py").write_text(
        "import minorloop as ml\n"
        "class Faulty:\n"
        "    tick = 0.04\n"
        "    def __init__(self, address):\n"
        "        self.bench = ml.connect(address)\n"
        "        self.inputs, self.outputs = self.bench.inputs, self.bench.outputs\n"
        "    def exchange(self, u):\n"
        "        return self.bench._source.set(1000 * u)\n"
        "    apply = exchange\n"
        "    def safe(self):\n"
        "        self.bench.safe()\n"
        "    def close(self):\n"
        "        self.bench.close()\n"
    )
    monkeypatch.syspath_prepend(folder)
    faulty = open_plant(f"module:faulty.Faulty:{address}")
    with pytest.raises(LimitError):
        faulty.exchange(np.array([0.1, 0.1, 0.0, 0.0]))
    faulty.close()
    said = commands(folder)
    assert refused > 30
    assert not [words for words in said if words[0] == "BEYOND"]
    sent = np.array([words[1:] for words in said if words[0] == "SET"], float)
    assert len(sent) > 0
    assert ((sent >= 0.0) & (sent <= 0.4)).all()
    assert ["SAFE"] in said[-6:]


def test_a_plant_that_cannot_be_used_is_one_sentence_before_the_console_starts(board):
    address, folder = board
    file = folder / "head.toml"
    text = file.read_text()
    for old, new, sentence in (
        ("board::INSTR", "nothing::INSTR", "cannot be opened"),
        ("safe_within = 0.5", "safe_within = 5", "the console needs up to 2 s"),
        ('unit = "deg"', 'unit = "rad"', "pan is in rad, and .* has deg"),
    ):
        file.write_text(text.replace(old, new))
        with pytest.raises((InstrumentError, ParameterError), match=sentence):
            probed(address)
    assert not [words for words in commands(folder) if words[0] == "SET"]

import time
from dataclasses import replace

import numpy as np
import pytest

from board_process import commands, simulated_board
from console_rig import Pilot, ScriptedCamera, tip
from minorloop.errors import InstrumentError, LimitError, ModelFileError, ParameterError
from minorloop_head.console.identified_head import head_of
from minorloop_head.console.plant import flowing_water, head_at, open_plant, open_tip, probed
from minorloop_head.console.session import Session
from minorloop_head.console.watchdog import Command, WatchedPlant
from minorloop_head.control.head import head_control
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.calibration import STRAIGHT, HeadCalibration
from minorloop_head.procedures.head_file import HeadFile, save_head
from minorloop_head.procedures.values import Plant, Tip
from minorloop_head.twins.surroundings import Surroundings, convection
from wires import made_up

SMALL = HeadCalibration(lens=Pinhole(64, 48, 50.0, (31.5, 23.5)), leds=np.zeros((3, 3)))
CONTROL = head_control("observer", (made_up(), made_up()))


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


def test_plant_and_tip_are_what_the_console_needs_with_the_camera_that_the_view_describes():
    found, view = tip()
    plant = open_plant("twin:pipe", specimen=2, seed=1)
    assert isinstance(plant, Plant)
    assert isinstance(found, Tip)
    plant.exchange(np.zeros(4))
    found.move_to(plant.stance())
    assert found.frame().image.shape == (view.lens.height, view.lens.width)


def test_a_head_that_was_identified_is_brought_to_the_middle():
    control, plant = head_of("twin:pipe", 3), open_plant("twin:pipe", specimen=3)
    state, y = control.begin(), np.zeros(4)
    for _ in range(300):
        u, state = control.step(state, np.degrees([STRAIGHT, STRAIGHT]), np.degrees(y[:2]))
        y = plant.exchange(np.concatenate([u, [0.0, 0.0]]))
    assert y[:2] == pytest.approx([STRAIGHT, STRAIGHT], abs=8e-3)


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
    pilot = Pilot.__new__(Pilot)  # without the simulated head, which takes seconds
    pilot.now, pilot.seq = 100.0, 0
    pilot.session = Session(plant, SMALL, CONTROL, ScriptedCamera())
    pilot.steering(2)
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


def test_the_first_pit_is_drawn_from_the_seed_and_that_of_the_demonstration_is_easy_to_find():
    pipes = [open_tip("twin:pipe", seed=seed, scale=0.1)[0].pipe for seed in (0, 1000, 1001, 1002)]
    demonstration, *drawn = ([bore for bore in pipe.bores if not bore.through] for pipe in pipes)
    easy = demonstration[0]
    assert (easy.phi, easy.z, easy.diameter, easy.depth) == (0.45, 20e-3, 1e-3, 0.5e-3)
    pits = [pit for each in drawn for pit in each]
    assert len(pits) == 9
    for name in ("phi", "z", "diameter", "depth", "brightness", "floor_tilt"):
        assert len({getattr(pit, name) for pit in pits}) == 9
    assert all(0.85e-3 <= pit.diameter <= 1.15e-3 and 0.2e-3 <= pit.depth <= 1e-3 for pit in pits)
    assert all(pit.brightness > 0.0 and any(pit.floor_tilt) for pit in pits)

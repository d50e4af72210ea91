"""The plant that the console steers, and its model.

There are two interfaces, since one process drives the wires and another one reads camera and probe.
`Plant` is a head with two wires on a catheter with two motors. `Tip` is the camera with its lights
and the ultrasonic probe. Wires are known by identification, camera and probe by calibration.
"""

from __future__ import annotations

import contextlib
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from minorloop.connect import connect
from minorloop.errors import ParameterError
from minorloop.files import PathLike
from minorloop.lab.drivers.bench import WallClock
from minorloop_head.console.settings import PIPE, SAFE_WITHIN, is_pipe
from minorloop_head.console.units import Position
from minorloop_head.procedures.actuator_plant import ActuatorPlant
from minorloop_head.procedures.values import ALL_LIGHTS, Plant, Reading, Tip

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.procedures.head_file import HeadFile
    from minorloop_head.twins.pipe import Crack, Pipe
    from minorloop_head.twins.surroundings import Filling

_LENGTH = 0.1024
"""Length of the simulated pipe in metres."""
_CLEAR = 2.5e-3
"""Least distance along the pipe of a crack from a pit or a hole, in metres."""
_FOUND, _AWAY = (0.85e-3, 1.15e-3), 2e-3
"""Least and largest diameter of a pit or a hole for the camera, and largest distance along the pipe
from the middle of its part, in metres."""
FULL_PIPE = -9.999e-3
"""Height of the water in the full pipe, in metres; y points down from the axis."""
# Uncertainties of the calibration: of the mount in m, of a gauge in m, of a caliper as a share of
# the thickness, of a thermometer in K.
_MOUNT, _RADIUS, _THICKNESS, _TEMPERATURE = 0.05e-3, 20e-6, 0.03, 0.3


def reading_at(position: Position, **known: Any) -> Reading:
    """Return the `Reading` of a procedure at a position, with other values."""
    angles, place = np.array(position[:2]), np.array(position[2:])
    return Reading(**{"t": 0.0, **known}, angles=angles, place=place)


class _ProbedPlant(NamedTuple):
    """Properties of a plant: serial number, tick in seconds, LEDs, and sensors at its joints."""

    serial: str | None
    tick: float
    leds: int
    sensors: bool


def head_at(address: str, specimen: int | None, file: PathLike) -> tuple[HeadFile, _ProbedPlant]:
    """Return the file of the head at an address, and the properties of its plant.

    A head that is not simulated is made safe and read.

    Raises a `ParameterError` as `probed` does; a `ModelFileError` if the file is not valid, is of
    another head, has wires that are older than its calibration, or has another number of LEDs than
    the plant.
    """
    with ThreadPoolExecutor(1) as pool:  # a bench takes a moment to answer
        probing = pool.submit(_simulated if is_pipe(address) else probed, address, specimen)
        from minorloop_head.procedures.head_file import read_head

        found = read_head(file)
        plant = probing.result()
    found.check_fits(plant.serial, file)
    found.check_lights(plant.leds, file)
    return found, plant


def _simulated(address: str, specimen: int | None) -> _ProbedPlant:
    """Return the properties of the simulated head."""
    from minorloop_head.twins.head import Head

    head = Head(specimen)
    return _ProbedPlant(head.serial, head.tick, len(ALL_LIGHTS), True)


def probed(address: str, specimen: int | None = None) -> _ProbedPlant:
    """Return the properties of a plant, which is then made safe and closed.

    Raises a `ParameterError` if nothing can be steered at the address, or it takes too long to make
    it safe; an `InstrumentError` if a device is missing, busy, or does not answer.
    """
    with contextlib.closing(_actuator_plant(address, specimen)) as plant:
        longest = getattr(plant.actuator, "safe_within", 0.0)
        if longest > SAFE_WITHIN:
            raise ParameterError(
                f"{address} has safe_within {longest:g} s; the console needs up to "
                f"{SAFE_WITHIN:g} s"
            )
        plant.safe()
        plant.exchange(np.zeros(4))
        plant.safe()
        return _ProbedPlant(plant.serial, plant.tick, plant.leds, plant.sensors)


def open_plant(
    address: str, *, specimen: int | None = None, seed: int = 0, water: Filling | None = None
) -> Plant:
    """Return the plant at an address.

    Raises a `ParameterError` if nothing can be steered at the address.

    ``specimen`` and ``seed``: of the simulated specimen, and of its noise. ``water``: of the
    simulated pipe when it is flooded; flowing water to the top without it. Its gas is that of the
    drained pipe too.
    """
    if not is_pipe(address):
        return _actuator_plant(address, specimen, seed)
    from minorloop_head.twins.catheter import Catheter
    from minorloop_head.twins.head import Head
    from minorloop_head.twins.rig import Rig
    from minorloop_head.twins.surroundings import convection

    head, water = Head(specimen, 0.05, seed, delay=0.04), water or flowing_water()
    film = convection(water.gas, pressure=water.pressure)
    head.surround(replace(head.surroundings, convection=film))
    return Rig(head, Catheter(specimen, 0.02, seed), flooded=water)


def open_tip(
    address: str,
    *,
    specimen: int | None = None,
    seed: int = 0,
    scale: float = 1.0,
    flow: Callable[[bool], None] | None = None,
    water: Filling | None = None,
) -> tuple[Tip, HeadCalibration]:
    """Return camera and probe of the plant at an address, and their calibration.

    Raises a `ParameterError` if nothing can be steered at the address.

    ``specimen``, ``seed``: of the simulated specimen, and of its noise and its pipe. ``scale``: of
    the image; small images are drawn faster. ``flow``: called when the pipe is flooded or drained,
    with a flag: ``flood`` of the plant. ``water``: as in `open_plant`.
    """
    if not is_pipe(address):
        raise ParameterError(f"{address!r} has no camera; give one, or {PIPE}, which has")
    from minorloop_head.geometry import Mount
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.twins.camera import LENS
    from minorloop_head.twins.rig import SimulatedTip
    from minorloop_head.twins.ultrasound import compile_echoes

    compile_echoes()
    rng = np.random.default_rng([seed, 41])
    offset = (0.0, 0.0) if specimen is None else tuple(rng.uniform(-0.2e-3, 0.2e-3, 2).tolist())
    known = np.array(offset) + rng.normal(0.0, _MOUNT, 2)
    pipe, water = _pipe(seed), water or flowing_water()
    tip = SimulatedTip(
        pipe,
        mount=Mount(offset=offset),
        specimen=specimen,
        seed=seed,
        optics=LENS.scaled(scale),
        flooded=water,
        flow=flow,
    )
    view = HeadCalibration(
        lens=tip.camera.calibration,
        leds=tip.camera.leds,
        offset=(float(known[0]), float(known[1])),
        radius=pipe.radius + float(rng.normal(0.0, _RADIUS)),
        thickness=pipe.thickness * float(rng.uniform(1 - _THICKNESS, 1 + _THICKNESS)),
        temperature=water.temperature + float(rng.normal(0.0, _TEMPERATURE)),
        tool=tip.tool.calibration,
        length=_LENGTH,
    )
    return tip, view


class _LoopClock(WallClock):
    """The clock of a plant that the control loop paces: the plant only reads it."""

    def sleep(self, seconds: float) -> None:
        """Return at once."""


def _actuator_plant(address: str, specimen: int | None = None, seed: int = 0) -> ActuatorPlant:
    """Return the head at an address as a plant."""
    actuator = connect(address, specimen=specimen, seed=seed)
    try:
        return ActuatorPlant(actuator, _LoopClock())
    except ParameterError as error:
        getattr(actuator, "close", lambda: None)()
        raise ParameterError(
            f"there is nothing to steer at {address!r}: {error}; {PIPE} is always there"
        ) from None


def flowing_water(level: float | None = FULL_PIPE, temperature: float | None = None) -> Filling:
    """Return the filling of the flooded simulated pipe: water that flows.

    ``level``: height of its surface in metres, y pointing down from the axis; None for a dry pipe.
    ``temperature``: in degrees Celsius; that of a room without it.
    """
    from minorloop_head.procedures.calibration import ROOM_TEMPERATURE
    from minorloop_head.twins.surroundings import Filling, Sway

    warm = ROOM_TEMPERATURE if temperature is None else temperature
    return Filling(level=level, temperature=warm, sway=None if level is None else Sway())


def _pipe(seed: int) -> Pipe:
    """Return a pipe with dents, dirt and scratches, and with pits, holes and cracks along it.

    The pipe of seed 0, the demonstration, has a first pit that is easy to find: black, flat, large.
    """
    from minorloop_head.twins.pipe import Bore, Pipe, draw_pit

    rng, bores = np.random.default_rng([seed, 43]), []
    for n, slot in enumerate((20e-3, 33e-3, 46e-3, 60e-3, 74e-3, 88e-3)):
        phi, z = float(rng.uniform(-math.pi, math.pi)), slot + float(rng.uniform(-_AWAY, _AWAY))
        bore = Bore(phi, z, float(rng.uniform(*_FOUND)), brightness=0.0, lining=0.08)
        bores.append(bore if n % 2 else draw_pit(rng, phi, z, _FOUND))
    if seed == 0:
        bores[0] = Bore(0.45, 20e-3, 1e-3, depth=0.5e-3, brightness=0.0, lining=0.08)
    drawn = Pipe.draw(seed, length=_LENGTH)
    return replace(drawn, bores=tuple(bores), cracks=_cracks(seed, [bore.z for bore in bores]))


def _cracks(seed: int, bores: Sequence[float]) -> tuple[Crack, ...]:
    """Return a crack between each two neighbouring bores, apart from all of them."""
    from minorloop_head.twins.pipe import draw_crack

    rng, found = np.random.default_rng([seed, 44]), []
    for low, high in pairwise(bores):
        ends = [-math.inf]
        while not low + _CLEAR < min(ends) <= max(ends) < high - _CLEAR:
            middle = 0.5 * (low + high)
            crack = draw_crack(rng, float(rng.uniform(-math.pi, math.pi)), middle)
            ends = [z for _, z in crack.points]
        found.append(crack)
    return tuple(found)

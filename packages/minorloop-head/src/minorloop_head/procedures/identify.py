"""Identification of a head from runs in a folder, which can be stopped and continued at any time.

Each axis is measured alone, the other current at zero. Four runs an axis are kept as stores: a step
and a loop; the same inputs once more, with the sensor of the other axis; reversal curves on levels
that are dense where the wire moves; and random inputs, for the check. A fifth, of minor loops, may
be added, also later. A finished run is not repeated, and a stopped one continues after its last
point.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, as_whole
from minorloop.errors import ParameterError, SignalError
from minorloop.identification import excitation
from minorloop.lab.actuator import Actuator
from minorloop.lab.plan import Plan
from minorloop.lab.run import ResumeMode
from minorloop.lab.store import Setup, Store
from minorloop.lab.wrapped_actuator import single_channel
from minorloop_head.control.controller import within
from minorloop_head.control.heating import (
    HeatedIdentification,
    identify_coupling,
    identify_heating,
    moves_enough,
    moving_levels,
)
from minorloop_head.control.limits import WireLimits
from minorloop_head.geometry import AXES
from minorloop_head.procedures.actuator_plant import check_axes
from minorloop_head.procedures.head_file import CheckedAxis, IdentifiedWires

RUNS = ("loop", "coupling", "curves", "check")
"""Runs of an axis."""
_MINOR_LOOPS = "minor-loops"
"""An optional run of minor loops."""
_SEEDED = (
    *((axis, run) for axis in range(len(AXES)) for run in RUNS),
    *((axis, _MINOR_LOOPS) for axis in range(len(AXES))),
)
"""Axis and run in the order of their seeds. Optional runs come last: they change no other seed."""
_STEP_HOLDS = 3
"""Number of holds at the beginning of the loop that form the step: cold, hot, cold."""
_SAMPLES = 250
"""Samples of a hold: 25 in the lag of a wire, where the hold is ten times as long."""

Connect = Callable[[int], AbstractContextManager[Actuator]]
"""Opens the actuator for a run with the seed of its noise."""
Told = Callable[[str], None]
"""Called with the name of a run that begins."""
CarryOut = Callable[[Actuator, Store], ResumeMode]
"""Carries out the rest of the plan in a store, as `minorloop.lab.run.run` does."""


@dataclass(frozen=True, kw_only=True)
class HeadExcitation:
    """Inputs that identify a head.

    Raises a `ParameterError` if a number is out of its range.
    """

    highest: float = 0.4
    """Largest current in A, up to 0.4, which heats a wire by some 108 K, see `WireLimits`."""
    bands: int = 12
    """Bands of the operator of each wire, 2 to 50. On specimens 1000 to 1003 the rms error of
    settled angles is 0.5 to 0.7 degrees with 8, 0.02 to 0.4 with 12, and still 0.02 to 0.3 with 16,
    which takes a third longer."""
    hold: float = 40.0
    """Longest hold in seconds, in which a wire settles."""
    minor_loops: bool = False
    """Whether a decaying staircase is measured too, see `wire_holds`."""

    def __post_init__(self) -> None:
        within("highest", self.highest, 0.01, 0.4, "A")
        as_whole("bands", self.bands, 2, 50)
        within("hold", self.hold, 1.0, 3600.0, "s")

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs of an axis."""
        return (*RUNS, _MINOR_LOOPS) if self.minor_loops else RUNS

    @property
    def loop(self) -> FloatArray:
        """A step up and down, then a loop in even steps, in A."""
        rise = np.linspace(0.0, 1.0, round(1.25 * self.bands) + 1)
        return self.highest * np.concatenate([[0.0, 1.0], rise, rise[-2::-1]])

    @property
    def check(self) -> FloatArray:
        """Random inputs in A, which occur in no other run; cold first."""
        powers = np.random.default_rng(19).uniform(0.0, 1.0, 2 * self.bands)
        return self.highest * np.concatenate([[0.0], np.sqrt(powers)])

    def holds(self, run: str) -> int:
        """Return the number of holds of a run, one of `runs`."""
        if run == "curves":
            return excitation.reversal_curves(np.arange(self.bands + 1.0)).size
        if run == _MINOR_LOOPS:
            return excitation.decaying_staircase(np.arange(self.bands + 1.0)).size
        return self.check.size if run == "check" else self.loop.size

    def plan(self, levels: FloatArray, name: str) -> Plan:
        """Return the plan that holds levels of an input, by its name, one after the other."""
        return Plan(levels, self.hold, sample_interval=self.hold / _SAMPLES, input=name)


@dataclass(frozen=True, eq=False)
class HeadMeasurement:
    """The runs of a head, in a folder."""

    folder: Path
    """Folder of the stores."""
    setup: dict[str, Any]
    """Address, specimen, seed and options of the actuator, as in `Setup`."""
    excitation: HeadExcitation
    connect: Connect
    carry_out: CarryOut
    simulated: bool = True
    """Whether the noise of the actuator has a seed; each run then has its own."""
    told: Told = lambda run: None
    """Called when a run begins or is continued."""

    def left(self) -> dict[str, int]:
        """Return the number of remaining holds of each unfinished run, by its name.

        Raises a `StoreError` if a store in the folder cannot be read, or belongs to another run.
        """
        how, left = self.excitation, {}
        known = {"loop": how.loop, "coupling": how.loop, "check": how.check}
        for axis, name in enumerate(AXES):
            for run in how.runs:
                path, holds = self._path(axis, run), how.holds(run)
                if path.exists():
                    with Store.open(path) as store:
                        names = store.setup.input, store.setup.output
                        levels = known.get(run)
                        plan = store.plan if levels is None else how.plan(levels, names[0])
                        store.check_same(plan, self._setup(self._seed(axis, run), names))
                        holds = 0 if store.finished else len(store.plan) - len(store)
                if holds:
                    left[f"{name}-{run}"] = holds
        return left

    def identified(self) -> IdentifiedWires:
        """Carry out the unfinished runs, and identify both wires.

        Raises a `ParameterError` if the actuator is no head; a `StoreError` if a store in the
        folder belongs to another run; a `SignalError` if a wire does not move, or its records
        cannot be used.
        """
        axes = [self._axis(axis) for axis in range(len(AXES))]
        found, moves = zip(*axes, strict=True)
        return IdentifiedWires(
            on=self._began(),
            wires=tuple(each.model for each in found),
            coupling=identify_coupling(moves),
            limits=WireLimits(),
            highest=self.excitation.highest,
            check=tuple(self._checked(axis, each) for axis, each in enumerate(found)),
            advice=tuple(
                f"{name}: {text}"
                for name, each in zip(AXES, found, strict=True)
                for text in (*each.steady.warnings, *each.step_advice)
            ),
            address=self.setup["address"],
            stores=self._digests(),
        )

    def _axis(self, axis: int) -> tuple[HeatedIdentification, FloatArray]:
        """Return an identified wire, and the angles (2, T) of all sensors while it alone moved."""
        how, other = self.excitation, 1 - axis
        u, y = self._measured(axis, "loop", how.loop)
        self._check_loop(axis, u, y)
        _, across = self._measured(axis, "coupling", how.loop, sensor=other)
        levels = moving_levels(u[_STEP_HOLDS - 1 :], y[_STEP_HOLDS - 1 :], how.bands)
        holds, angles = self._measured(axis, "curves", excitation.reversal_curves(levels))
        if how.minor_loops:
            staircase = excitation.decaying_staircase(levels)
            more = self._measured(axis, _MINOR_LOOPS, staircase)
            holds, angles = np.append(holds, more[0]), np.append(angles, more[1])
        found = identify_heating(holds, angles, step=self._step(axis), levels=levels)
        moves = np.empty((2, y.size))
        moves[axis], moves[other] = y - y[0], across - across[0]
        return found, moves

    def _check_loop(self, axis: int, u: FloatArray, y: FloatArray) -> None:
        """Refuse a loop or step without motion of the wire, before the long runs begin."""
        width, step = float(np.ptp(y)), self._step(axis)[2]
        if not moves_enough(step, width):
            raise SignalError(
                f"{AXES[axis]} moves by {np.ptp(step):.3g} degrees in its first step and by "
                f"{width:.3g} in the loop, with currents up to {u.max():g} A, held for "
                f"{self.excitation.hold:g} s at most; give longer holds or a larger current, in a "
                "new folder, and check that the wire is connected"
            )

    def _checked(self, axis: int, found: HeatedIdentification) -> CheckedAxis:
        u, y = self._measured(axis, "check", self.excitation.check)
        error = found.model.operator.simulate(u**2) - y
        return CheckedAxis(float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()))

    def _step(self, axis: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return times, currents and angles of the step at the beginning of the loop."""
        with Store.open(self._path(axis, "loop")) as store:
            points, parts, now = store.points()[:_STEP_HOLDS], [], 0.0
            for point in points:
                t, y = store.trace(point.index)
                parts.append((now + t, np.full(t.size, point.input), y))
                now += point.held
        t, u, y = (np.concatenate(each) for each in zip(*parts, strict=True))
        begins = int(np.flatnonzero(u)[0]) - 2  # a sample under the first current, cold
        # A sample is measured at the end of an interval; its current was held from the one before.
        return t[begins:], np.append(u[begins + 1 :], u[-1]), y[begins:]

    def _measured(
        self, axis: int, run: str, levels: FloatArray, sensor: int | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Carry out the rest of a run, and return its inputs and settled outputs."""
        path, seed = self._path(axis, run), self._seed(axis, run)
        if path.exists():
            with Store.open(path) as store:
                if store.finished:
                    names = store.setup.input, store.setup.output
                    store.check_same(
                        self.excitation.plan(levels, names[0]), self._setup(seed, names)
                    )
                    return _settled(store)
        self.told(path.stem)
        with self.connect(seed) as head:
            check_head(head)
            output = head.outputs[axis if sensor is None else sensor].name
            plant = single_channel(head, head.inputs[axis].name, output)
            names = str(plant.inputs[0]), str(plant.outputs[0])
            plan, setup = self.excitation.plan(levels, names[0]), self._setup(seed, names)
            with self._opened(path, plan, setup) as store:
                store.check_same(plan, setup)
                self.carry_out(plant, store)
                return _settled(store)

    def _opened(self, path: Path, plan: Plan, setup: Setup) -> Store:
        return Store.open(path, write=True) if path.exists() else Store.create(path, plan, setup)

    def _setup(self, seed: int, names: tuple[str, str]) -> Setup:
        return Setup(**{**self.setup, "seed": seed}, input=names[0], output=names[1])

    def _seed(self, axis: int, run: str) -> int:
        """Return the seed of a run: each of a twin has different noise."""
        if not self.simulated:
            return int(self.setup["seed"])
        return int(self.setup["seed"]) + _SEEDED.index((axis, run))

    def _path(self, axis: int, run: str) -> Path:
        return self.folder / f"{AXES[axis]}-{run}.sqlite"

    def _began(self) -> datetime:
        """Return when the first of the runs began."""
        with Store.open(self._path(0, RUNS[0])) as store:
            return datetime.fromisoformat(store.sessions()[0].began)

    def _digests(self) -> dict[str, str]:
        paths = [self._path(axis, run) for axis in range(len(AXES)) for run in self.excitation.runs]
        return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def _settled(store: Store) -> tuple[FloatArray, FloatArray]:
    """Return inputs and settled outputs (T,) of a store."""
    points = store.points()
    return np.array([p.input for p in points]), np.array([p.value for p in points])


def check_head(plant: Actuator, seen: str = "") -> None:
    """Refuse an actuator that is no head.

    Raises a `ParameterError` if it has not two currents in A and two angles in degrees, or as
    `check_axes`.

    ``seen``: end of the message on a head without sensors: how else its angles can be measured.
    """
    units = [channel.unit for channel in (*plant.inputs, *plant.outputs)]
    if len(plant.inputs) != 2 or units != ["A", "A", "deg", "deg"]:
        known = ", ".join(str(channel) for channel in (*plant.inputs, *plant.outputs))
        raise ParameterError(
            f"the actuator has {known}; a head has two currents in A and two angles in deg{seen}"
        )
    check_axes(plant)

"""Identification of the head's wires from settled holds: as the paper does it, and as power.

Boudjabi, Ferreira and Krupa measure reversal curves on a mesh of 0.1 V over a command of 0 to
1.2 V and interpolate between them. The same is done here, beside the dots of the fibre paper on
the same measurements, and an operator on the heating power with its levels where the wire moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Levels, uniform_levels
from minorloop.dynamics.heated_wire import HeatedWire
from minorloop.head.control.heating import (
    HeatedIdentification,
    identify_coupling,
    identify_heating,
    moving_levels,
)
from minorloop.head.studies.head_loop import NOISE, TICK
from minorloop.head.twins.head import Head
from minorloop.identification import Identification, excitation, identify
from minorloop.operators.relays import RelayModel

COMMAND, CURRENT = 1.2, 0.4
"""Full command in V, and its current in A."""
MESH, BANDS = 12, 16
HOLD = 40.0
"""Seconds of a settled hold: more than five times the slowest time constant of the wire."""
FIRST_LOOP, VALIDATION, TARGETS = 25, 40, 40
STEP = (0.16, 25.0, 40.0)
"""Times at which the current of the step is switched on and off, and end of its record, in s."""
_MARGIN = 0.05
"""Share of the range at each end without targets, by trial: near saturation, the inverse is
ill-conditioned."""


@dataclass(frozen=True, eq=False)
class Static:
    """Results of settled measurements of one specimen; angles in degrees.

    ``paper`` is the plane on the mesh of commands in V, ``dots`` its relays; ``wires`` the two
    axes on heating power; ``coupling`` (2, 2) that of the sensors. ``inputs`` (n,) are random
    commands in V that no model was fitted to and ``settled`` (n,) the angles after them;
    ``targets`` (m,) with ``stepping`` (m,) and ``exact`` (m,), the results of two inverses on the
    identified plane, and ``driven``, the angles to which they drive the wire.
    """

    paper: Identification
    dots: RelayModel
    wires: tuple[HeatedIdentification, HeatedIdentification]
    coupling: FloatArray
    inputs: FloatArray
    settled: FloatArray
    targets: FloatArray
    stepping: FloatArray
    exact: FloatArray
    driven: dict[str, FloatArray]

    @property
    def predictions(self) -> dict[str, FloatArray]:
        """Angles (n,) of each model after the validation commands."""
        power = (self.inputs * CURRENT / COMMAND) ** 2
        return {
            "power": self.wires[0].model.operator.simulate(power),
            "mesh": self.paper.model.simulate(self.inputs),
            "dots": self.dots.simulate(self.inputs),
        }

    def figures(self) -> dict[str, Any]:
        """Return errors in degrees, and those of inverses in percent of the model's range."""
        rms = {name: _rms(y - self.settled) for name, y in self.predictions.items()}
        low, high = self.paper.model.range
        stepping, exact = (
            100 * _rms(y - self.targets) / (high - low) for y in (self.stepping, self.exact)
        )
        driven = {name: _rms(y - self.targets) for name, y in self.driven.items()}
        return {
            "static": {
                "rms_deg": rms["power"],
                "mesh_rms_deg": rms["mesh"],
                "dots_rms_deg": rms["dots"],
                "max_deg": float(np.abs(self.predictions["power"] - self.settled).max()),
            },
            "stepping_inverse": {"rms_pct": stepping, "driven_rms_deg": driven["stepping"]},
            "exact_inverse": {
                "rms_pct": exact,
                "driven_rms_deg": driven["exact"],
                "times_better": stepping / max(exact, 1e-13),
            },
        }


def run_static(seed: int) -> Static:
    """Identify both wires of one specimen, and validate the models on other commands."""
    mesh = uniform_levels(0.0, COMMAND, MESH)
    commands = excitation.reversal_curves(mesh)
    measured = _settled(seed, 0, commands * CURRENT / COMMAND)[:, 0]
    paper = identify(
        commands,
        measured,
        levels=mesh,
        relay="unipolar",
        diagonal="reversible",
        prior="none",
        smoothness=0.0,
    )
    dots = RelayModel.from_preisach(paper.model)
    wires, readings = zip(*(_wire(seed, axis) for axis in range(2)), strict=True)
    rng = np.random.default_rng([seed, 5])
    inputs = rng.uniform(0.0, COMMAND, VALIDATION)
    low, high = paper.model.range
    edge = _MARGIN * (high - low)
    targets = rng.uniform(low + edge, high - edge, TARGETS)
    stepping = dots.stepping_inverse(targets)
    exact = paper.model.invert(targets)
    return Static(
        paper=paper,
        dots=dots,
        wires=(wires[0], wires[1]),
        coupling=identify_coupling(readings),
        inputs=inputs,
        settled=_settled(seed, 0, inputs * CURRENT / COMMAND)[:, 0],
        targets=targets,
        stepping=stepping.y,
        exact=exact.y,
        driven={
            name: _settled(seed, 0, np.clip(u, 0.0, COMMAND) * CURRENT / COMMAND)[:, 0]
            for name, u in (("stepping", stepping.u), ("exact", exact.u))
        },
    )


def identify_head(seed: int) -> tuple[tuple[HeatedWire, HeatedWire], FloatArray]:
    """Identify both wires of one specimen and the coupling of its sensors, for its control."""
    found, readings = zip(*(_wire(seed, axis) for axis in range(2)), strict=True)
    return (found[0].model, found[1].model), identify_coupling(readings)


def _wire(seed: int, axis: int) -> tuple[HeatedIdentification, FloatArray]:
    """Identify one axis from a first loop, reversal curves where it moves, and a step.

    The second value are the readings (2, n) of both sensors while only this axis moved.
    """
    up = np.linspace(0.0, CURRENT, FIRST_LOOP)
    loop = np.concatenate([up, up[-2::-1]])
    levels: Levels = moving_levels(loop, _settled(seed, axis, loop)[:, axis], BANDS)
    holds = excitation.reversal_curves(levels)
    readings = _settled(seed, axis, holds)
    t, current, angle = _step(seed, axis)
    found = identify_heating(holds, readings[:, axis], step=(t, current, angle), levels=levels)
    return found, readings.T


def _settled(seed: int, axis: int, currents: npt.ArrayLike) -> FloatArray:
    """Return the readings (n, 2) at the ends of holds of one axis, the other one cold."""
    head = _head(seed, axis)
    inputs = np.zeros((np.size(currents), 2))
    inputs[:, axis] = currents
    return np.array([np.asarray(head.apply(u, HOLD, HOLD).y)[:, -1] for u in inputs])


def _step(seed: int, axis: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, currents and readings of a step to full current and back."""
    on, off, end = STEP
    interval = 2 * TICK
    t = np.arange(0.0, end, interval)
    current = np.where((t >= on) & (t < off), CURRENT, 0.0)
    head, inputs = _head(seed, axis), np.zeros((t.size, 2))
    inputs[:, axis] = current
    read = [np.asarray(head.apply(u, interval, interval).y)[axis, -1] for u in inputs[:-1]]
    return t, current, np.array([0.0, *read])


def _head(seed: int, axis: int) -> Head:
    return Head(seed, NOISE, 2 * seed + axis)


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(error**2)))

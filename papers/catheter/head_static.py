"""Identification of the head's wires from settled holds: as the paper does it, and as power.

Boudjabi, Ferreira and Krupa measure reversal curves on a mesh of 0.1 V over a command of 0 to
1.2 V and interpolate between them. The same is done here, beside the dots of the fibre paper on
the same measurements, and an operator on the heating power with its levels where the wire moves.
All are then tried on random holds and, as in the paper's Fig 5, on an arbitrary continuous input.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Levels, uniform_levels
from minorloop.dynamics.linear import Linear
from minorloop.identification import Identification, excitation
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel
from minorloop_head.control.controller import mean_slope
from minorloop_head.control.heating import (
    HeatedIdentification,
    identify_coupling,
    identify_heating,
    moving_levels,
    wire_holds,
)
from minorloop_head.heated_wire import HeatedWire
from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import Surroundings
from papers.catheter.head_loop import NOISE, TICK
from papers.facts import identify_settled
from papers.harness import Results, rms

COMMAND, CURRENT = 1.2, 0.4
"""Full command in V, and its current in A."""
MESH, BANDS = 12, 16
HOLD = 40.0
"""Seconds of a settled hold: more than five times the slowest time constant of the wire."""
FIRST_LOOP, VALIDATION, TARGETS = 25, 40, 40
STEP = (0.16, 25.0, 40.0)
"""Times at which the current of the step is switched on and off, and end of its record, in s."""
ARBITRARY_SECONDS, ARBITRARY_PERIODS, SINES, RISE = 600.0, (30.0, 90.0), 4, 20.0
"""The arbitrary input: duration in s; a sum of so many sines with periods in this range, slow
enough for the wire to cross its loop and fast enough for the lag to count; rise in s."""
WHOLE, INSIDE = 200.0, 0.5
"""Seconds over the whole range of commands, and the share of it above which the input stays after
them and another rise: below, the wire is cold, and no reversal is a minor loop."""
LOOP = 1.0
"""Degrees by which the angle rises and falls in what counts as a minor loop."""
MOVING, MOVING_GAP = 0.1, 2.0
"""A wire moves where its angle changes by so many degrees a second over so many seconds: a
hundredth of its usual rate, and four times the noise of such a difference."""
_LAGS = (0.3, 60.0)
"""Range in seconds in which the lag of a linear heating is looked for."""
EDGE = 0.02
"""Share of the stroke at each end that counts as the end."""
_MARGIN = 0.05
"""Share of the range at each end without targets, by trial: near saturation, the inverse is
ill-conditioned."""


@dataclass(frozen=True, eq=False)
class Arbitrary:
    """An arbitrary continuous input with minor loops, that no model was fitted to.

    ``t`` (T,) in s, ``command`` (T,) in V, ``angle`` (T,) as measured in degrees; ``predicted``
    are the angles (T,) of the operator on ``power`` with its lag, of the ``mesh`` behind a linear
    lag, and of the ``ideal`` H(s) of Fig 9, whose lag is behind the operator.
    """

    t: FloatArray
    command: FloatArray
    angle: FloatArray
    predicted: dict[str, FloatArray]

    @property
    def moving(self) -> npt.NDArray[np.bool_]:
        """(T,) where the wire moves: the rest is predicted by any model."""
        gap = MOVING_GAP / 2
        later, before = (np.interp(self.t + off, self.t, self.angle) for off in (gap, -gap))
        return np.asarray(np.abs(later - before) > MOVING * MOVING_GAP)

    @property
    def minor_loops(self) -> int:
        """Reversals from a fall to a rise of the angle away from cold."""
        count, falls, turn = 0, False, float(self.angle[0])
        for angle in self.angle.tolist():
            turn = min(turn, angle) if falls else max(turn, angle)
            if abs(angle - turn) > LOOP:
                count += falls and turn > 2.0 * LOOP
                falls, turn = not falls, angle
        return count

    def figures(self) -> dict[str, float]:
        """Return rms errors in degrees, of all samples and of those in which the wire moves."""
        found = {"moving_share": float(np.mean(self.moving)), "minor_loops": self.minor_loops}
        for name, predicted in self.predicted.items():
            prefix, error = "" if name == "power" else f"{name}_", predicted - self.angle
            found[f"{prefix}rms_deg"] = rms(error)
            found[f"{prefix}moving_rms_deg"] = rms(error[self.moving])
        return found


def run_static(seed: int) -> Results:
    """Identify both wires of one specimen, and validate the models on other commands.

    Angles are in degrees. ``paper`` is the plane on the mesh of commands in V; ``wires`` the two
    axes on heating power; ``coupling`` (2, 2) that of the sensors. ``inputs`` (n,) are random
    commands in V that no model was fitted to, ``settled`` (n,) the angles after them and
    ``predictions`` (n,) those of each model; ``targets`` (m,) with ``model`` (m,) by name the
    results of two inverses on the identified plane, and ``driven`` the angles to which they drive
    the wire. ``arbitrary`` is the continuous input. Errors of inverses are in percent of the
    model's range.
    """
    paper = identify_mesh(seed)
    dots = RelayModel.from_preisach(paper.model)
    wires, coupling = _identified(seed)
    rng = np.random.default_rng([seed, 5])
    inputs = rng.uniform(0.0, COMMAND, VALIDATION)
    low, high = paper.model.range
    edge = _MARGIN * (high - low)
    targets = rng.uniform(low + edge, high - edge, TARGETS)
    settled = _settled(seed, 0, inputs * CURRENT / COMMAND)[:, 0]
    predictions = {
        "power": wires[0].model.operator.simulate((inputs * CURRENT / COMMAND) ** 2),
        "mesh": paper.model.simulate(inputs),
        "dots": dots.simulate(inputs),
    }
    inverses = {"stepping": dots.stepping_inverse(targets), "exact": paper.model.invert(targets)}
    driven = {
        name: _settled(seed, 0, np.clip(found.u, 0.0, COMMAND) * CURRENT / COMMAND)[:, 0]
        for name, found in inverses.items()
    }
    arbitrary = _arbitrary(seed, wires[0].model, paper.model)
    errors = {name: y - settled for name, y in predictions.items()}
    own, (least, most) = EDGE * np.ptp(wires[0].model.operator.range), wires[0].model.operator.range
    # Holds between the ends of the stroke: at the ends any model is right.
    between = (settled > least + own) & (settled < most - own)
    figures: dict[str, Any] = {
        "static": {
            "rms_deg": rms(errors["power"]),
            "mesh_rms_deg": rms(errors["mesh"]),
            "dots_rms_deg": rms(errors["dots"]),
            "max_deg": float(np.abs(errors["power"]).max()),
            "moving_rms_deg": rms(errors["power"][between]),
            "moving_holds": int(between.sum()),
        },
        "arbitrary": arbitrary.figures(),
    }
    for name, found in inverses.items():
        figures[f"{name}_inverse"] = {
            "rms_pct": 100 * rms(found.y - targets) / (high - low),
            "driven_rms_deg": rms(driven[name] - targets),
        }
    stepping, exact = (figures[f"{name}_inverse"] for name in inverses)
    exact["times_better"] = stepping["rms_pct"] / max(exact["rms_pct"], 1e-13)
    return Results(
        figures, paper=paper, wires=wires, coupling=coupling, inputs=inputs, settled=settled,
        predictions=predictions, targets=targets, driven=driven, arbitrary=arbitrary,
        model={name: found.y for name, found in inverses.items()},
    )  # fmt: skip


def heating_lag(seed: int, model: Preisach, surroundings: Surroundings | None = None) -> float:
    """Return the lag in seconds of a linear heating before a model, from a step of one specimen."""
    from scipy.optimize import minimize_scalar

    t, current, angle = step_record(seed, 0, surroundings)

    def error(lag: float) -> float:
        heated = Linear.lags(lag).simulate(t, current * COMMAND / CURRENT)
        return float(np.mean((model.simulate(heated) - angle) ** 2))

    return float(minimize_scalar(error, bounds=_LAGS, method="bounded").x)


def _arbitrary(seed: int, wire: HeatedWire, mesh: Preisach) -> Arbitrary:
    """Drive the first axis by an arbitrary input: over the whole range, then where it moves."""
    rng = np.random.default_rng([seed, 6])
    t: FloatArray = 2 * TICK * np.arange(round(ARBITRARY_SECONDS / (2 * TICK)), dtype=np.float64)
    turns = np.outer(1.0 / rng.uniform(*ARBITRARY_PERIODS, SINES), t)
    shape = np.sin(2 * np.pi * (turns + rng.uniform(size=(SINES, 1)))).sum(axis=0)
    share = (shape - shape.min()) / np.ptp(shape)
    floor = INSIDE * np.clip((t - WHOLE) / RISE, 0.0, 1.0)
    share = floor + (1.0 - floor) * share
    command = COMMAND * np.minimum(t / RISE, 1.0) * share
    current = command * CURRENT / COMMAND
    head = Head(seed, NOISE, 2 * seed)
    heated = Linear.lags(heating_lag(seed, mesh)).simulate(t, command)
    lag = wire.lag + wire.latent * mean_slope(wire)
    return Arbitrary(
        t=t,
        command=command,
        angle=np.asarray(head.drive(t, np.array([current, np.zeros(t.size)])).y[0]),
        predicted={
            "power": wire.simulate(t, current),
            "mesh": mesh.simulate(heated),
            "ideal": Linear.lags(lag).simulate(t, wire.operator.simulate(current**2)),
        },
    )


def identify_mesh(seed: int, surroundings: Surroundings | None = None) -> Identification:
    """Identify the first axis as the paper does: reversal curves on a mesh of commands in V."""
    mesh = uniform_levels(0.0, COMMAND, MESH)
    commands = excitation.reversal_curves(mesh)
    settled = _settled(seed, 0, commands * CURRENT / COMMAND, surroundings)[:, 0]
    return identify_settled(commands, settled, levels=mesh, relay="unipolar", prior="none")


def identify_head(seed: int) -> tuple[tuple[HeatedWire, HeatedWire], FloatArray]:
    """Identify both wires of one specimen and the coupling of its sensors, for its control."""
    wires, coupling = _identified(seed)
    return (wires[0].model, wires[1].model), coupling


def _identified(seed: int) -> tuple[tuple[HeatedIdentification, ...], FloatArray]:
    wires, readings = zip(*(_wire(seed, axis) for axis in range(2)), strict=True)
    return wires, identify_coupling(readings)


def _wire(seed: int, axis: int) -> tuple[HeatedIdentification, FloatArray]:
    """Identify one axis from a first loop, holds where it moves, minor loops too, and a step.

    The second value are the readings (2, n) of both sensors while only this axis moved.
    """
    up = np.linspace(0.0, CURRENT, FIRST_LOOP)
    loop = np.concatenate([up, up[-2::-1]])
    levels: Levels = moving_levels(loop, _settled(seed, axis, loop)[:, axis], BANDS)
    holds = wire_holds(levels, minor_loops=True)
    readings = _settled(seed, axis, holds)
    t, current, angle = step_record(seed, axis)
    found = identify_heating(holds, readings[:, axis], step=(t, current, angle), levels=levels)
    return found, readings.T


def _settled(
    seed: int, axis: int, currents: npt.ArrayLike, surroundings: Surroundings | None = None
) -> FloatArray:
    """Return the readings (n, 2) at the ends of holds of one axis, the other one cold."""
    head = _head(seed, axis, surroundings)
    inputs = np.zeros((np.size(currents), 2))
    inputs[:, axis] = currents
    return np.array([np.asarray(head.apply(u, HOLD, HOLD).y)[:, -1] for u in inputs])


def step_record(
    seed: int, axis: int, surroundings: Surroundings | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, currents and readings of a step of one axis to full current and back."""
    on, off, end = STEP
    interval = 2 * TICK
    t = np.arange(0.0, end, interval)
    current = np.where((t >= on) & (t < off), CURRENT, 0.0)
    head, inputs = _head(seed, axis, surroundings), np.zeros((t.size, 2))
    inputs[:, axis] = current
    read = [np.asarray(head.apply(u, interval, interval).y)[axis, -1] for u in inputs[:-1]]
    return t, current, np.array([0.0, *read])


def _head(seed: int, axis: int, surroundings: Surroundings | None = None) -> Head:
    return Head(seed, NOISE, 2 * seed + axis, surroundings=surroundings)

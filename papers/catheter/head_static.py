"""Identification of the head's wires from settled holds: as in the paper, and on power.

Boudjabi, Ferreira and Krupa measure reversal curves on a mesh of 0.1 V over a command of 0 to
1.2 V and interpolate between them. This model is identified here, with the dots of the fibre paper
on the same measurements, and an operator on the heating power with its levels where the wire moves.
All are then tested on random holds and, as in the paper's Fig 5, on an arbitrary continuous input.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Levels, uniform_levels
from minorloop.dynamics.linear import Linear
from minorloop.identification import Identification, excitation
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel
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
from papers.catheter.control.internal_model import mean_lag
from papers.catheter.head_loop import NOISE, TICK
from papers.facts import identify_settled
from papers.harness import Results, rms

COMMAND, CURRENT = 1.2, 0.4
"""Full command in V, and its current in A."""
MESH, BANDS = 12, 16
HOLD = 40.0
"""Seconds of a settled hold: more than five times the slowest time constant of the wire."""
RISE = 20.0
"""Seconds in which the arbitrary input rises, at its beginning and where it leaves the cold."""


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
    inputs = rng.uniform(0.0, COMMAND, 40)
    low, high = paper.model.range
    edge = 0.05 * (high - low)  # near saturation, the inverse is ill-conditioned
    targets = rng.uniform(low + edge, high - edge, 40)
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
    own, (least, most) = 0.02 * np.ptp(wires[0].model.operator.range), wires[0].model.operator.range
    # Holds between the ends of the stroke: at the ends any model is right.
    between = (settled > least + own) & (settled < most - own)
    figures: dict[str, Any] = {
        "static": {
            "rms_deg": rms(errors["power"]),
            "mesh_rms_deg": rms(errors["mesh"]),
            "dots_rms_deg": rms(errors["dots"]),
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

    return float(minimize_scalar(error, bounds=(0.3, 60.0), method="bounded").x)


def _arbitrary(seed: int, wire: HeatedWire, mesh: Preisach) -> Results:
    """Drive the first axis by an arbitrary continuous input that no model was fitted to.

    ``t`` (T,) in s, ``command`` (T,) in V, measured ``angle`` (T,) in degrees; ``predicted``
    are the angles (T,) of the operator on ``power`` with its lag, of the ``mesh`` behind a linear
    lag, and of the ``ideal`` H(s) of Fig 9, whose lag is behind the operator.

    It is a sum of sines, slow enough for the wire to cross its loop and fast enough for the lag to
    count. After 200 s it stays above half of the range: below, the wire is cold, and no reversal is
    a minor loop.
    """
    rng = np.random.default_rng([seed, 6])
    t: FloatArray = 2 * TICK * np.arange(round(600.0 / (2 * TICK)), dtype=np.float64)
    turns = np.outer(1.0 / rng.uniform(30.0, 90.0, 4), t)
    shape = np.sin(2 * np.pi * (turns + rng.uniform(size=(4, 1)))).sum(axis=0)
    share = (shape - shape.min()) / np.ptp(shape)
    floor = 0.5 * np.clip((t - 200.0) / RISE, 0.0, 1.0)
    share = floor + (1.0 - floor) * share
    command = COMMAND * np.minimum(t / RISE, 1.0) * share
    current = command * CURRENT / COMMAND
    head = Head(seed, NOISE, 2 * seed)
    heated = Linear.lags(heating_lag(seed, mesh)).simulate(t, command)
    angle = np.asarray(head.drive(t, np.array([current, np.zeros(t.size)])).y[0])
    predicted = {
        "power": wire.simulate(t, current),
        "mesh": mesh.simulate(heated),
        "ideal": Linear.lags(mean_lag(wire)).simulate(t, wire.operator.simulate(current**2)),
    }
    figures = arbitrary_figures(t, angle, predicted)
    return Results(figures, t=t, command=command, angle=angle, predicted=predicted)


def arbitrary_figures(
    t: FloatArray, angle: FloatArray, predicted: Mapping[str, FloatArray]
) -> dict[str, float]:
    """Return rms errors in degrees, of all samples and of those in which the wire moves.

    Any model predicts a wire at rest. A wire moves if its angle changes by 0.1 degrees per second
    over two seconds: a hundredth of the usual rate, and four times the noise of such a difference.
    Minor loops are reversals from a fall to a rise, of a degree, away from cold.
    """
    later, before = (np.interp(t + off, t, angle) for off in (1.0, -1.0))
    moving = np.abs(later - before) > 0.1 * 2.0
    count, falls, turn, loop = 0, False, float(angle[0]), 1.0
    for now in angle.tolist():
        turn = min(turn, now) if falls else max(turn, now)
        if abs(now - turn) > loop:
            count += falls and turn > 2.0 * loop
            falls, turn = not falls, now
    found = {"moving_share": float(np.mean(moving)), "minor_loops": count}
    for name, each in predicted.items():
        prefix, error = "" if name == "power" else f"{name}_", each - angle
        found[f"{prefix}rms_deg"] = rms(error)
        found[f"{prefix}moving_rms_deg"] = rms(error[moving])
    return found


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
    """Identify one axis by its sensors."""
    return identify_axis(
        axis,
        lambda currents, first: _settled(seed, axis, currents),
        lambda: step_record(seed, axis),
    )


def identify_axis(
    axis: int,
    settled: Callable[[FloatArray, bool], FloatArray],
    step: Callable[[], tuple[FloatArray, FloatArray, FloatArray]],
) -> tuple[HeatedIdentification, FloatArray]:
    """Identify one axis from a first loop, holds where it moves, minor loops too, and a step.

    Returns the model, and the readings (2, n) of both axes while only this one moved.

    ``settled`` returns readings (n, 2) in degrees at the ends of holds of currents (n,) in A, the
    other axis cold, NaN without a reading; its last argument says whether it is the first loop.
    ``step`` returns the same as `step_record`.
    """
    up = np.linspace(0.0, CURRENT, 25)
    loop = np.concatenate([up, up[-2::-1]])
    seen = settled(loop, True)
    good = np.isfinite(seen[:, axis])
    levels: Levels = moving_levels(loop[good], seen[good, axis], BANDS)
    holds = wire_holds(levels, minor_loops=True)
    readings = settled(holds, False)
    found = identify_heating(holds, readings[:, axis], step=step(), levels=levels)
    return found, readings[np.isfinite(readings).all(axis=1)].T


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
    (t, current), interval = step_input(), 2 * TICK
    head, inputs = _head(seed, axis, surroundings), np.zeros((t.size, 2))
    inputs[:, axis] = current
    read = [np.asarray(head.apply(u, interval, interval).y)[axis, -1] for u in inputs[:-1]]
    return t, current, np.array([0.0, *read])


def step_input() -> tuple[FloatArray, FloatArray]:
    """Return times in s, two ticks apart, and currents in A: on at 0.16 s, and off at 25 s."""
    t: FloatArray = np.arange(0.0, 40.0, 2 * TICK)
    return t, np.where((t >= 0.16) & (t < 25.0), CURRENT, 0.0)


def _head(seed: int, axis: int, surroundings: Surroundings | None = None) -> Head:
    return Head(seed, NOISE, 2 * seed + axis, surroundings=surroundings)

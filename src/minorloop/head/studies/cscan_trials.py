"""Sweeps of partly flooded pipes drawn by seed, and what is found in them, scored after the sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from minorloop.head.geometry import Mount, Probe
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.sweep import Sweep, SweepState
from minorloop.head.procedures.values import NOTHING, Reading
from minorloop.head.studies import scoring
from minorloop.head.twins.camera import LENS
from minorloop.head.twins.catheter import Catheter
from minorloop.head.twins.pipe import Bore, Pipe, draw_crack, draw_pit
from minorloop.head.twins.rig import GYROSCOPE_NOISE
from minorloop.head.twins.surroundings import Sway
from minorloop.head.twins.ultrasound import INTERVAL, Ultrasound
from minorloop.threads import one_thread

LENGTH = (20e-3, 24e-3)
"""Swept part of the pipe in metres."""
_LEVELS = (-1e-3, 1.5e-3)
_JOINT_NOISE = math.radians(0.05)
_SWAY, _PHASES = Sway(), 1e3
_SETTLE = 0.03e-3
"""Motion in metres within which the twin's echo counts as the same: an eighth of the beam."""


@dataclass(eq=False, kw_only=True)
class SweepTrial:
    calibration: HeadCalibration
    pipe: Pipe
    mount: Mount
    twin: Ultrasound
    catheter: Catheter
    rng: np.random.Generator


def draw_sweep(seed: int, pits: int = 4) -> SweepTrial:
    rng = np.random.default_rng([seed, 41])
    level = float(rng.uniform(*_LEVELS))
    dry = Pipe.draw(seed)
    bores = []
    low, high = LENGTH
    while len(bores) < pits:
        phi, z = float(rng.uniform(0.35, np.pi - 0.35)), float(rng.uniform(low + 0.8e-3, high - 0.8e-3))
        one = draw_pit(rng, phi, z)
        one = replace(one, diameter=float(rng.uniform(0.8e-3, 1.5e-3)), depth=float(rng.uniform(0.3e-3, 1e-3)))
        if all(math.hypot(10e-3 * (phi - o.phi), z - o.z) > 2.5e-3 for o in bores):
            bores.append(one)
    while True:
        crack = draw_crack(rng, float(rng.uniform(0.35, np.pi - 0.35)), float(rng.uniform(low, high)))
        if all(math.hypot(10e-3 * (phi - o.phi), z - o.z) > o.diameter / 2 + 1e-3 for phi, z in crack.points for o in bores):
            break
    pipe = replace(dry, cracks=(crack,), bores=tuple(bores), water=level, thickness=float(rng.uniform(1.5e-3, 4e-3)))
    off = rng.uniform(-0.2e-3, 0.2e-3, 2)
    known = off + rng.normal(0, 0.05e-3, 2)
    warm = float(rng.uniform(12, 30))
    mount = Mount(offset=(float(off[0]), float(off[1])))
    twin = Ultrasound(pipe, mount, specimen=seed, seed=seed, temperature=warm, settle=_SETTLE)
    calibration = HeadCalibration(
        lens=LENS, leds=np.empty((0, 3)), offset=(float(known[0]), float(known[1])),
        thickness=pipe.thickness * float(rng.uniform(0.97, 1.03)),
        temperature=warm + float(rng.normal(0, 0.3)),
    )
    return SweepTrial(calibration=calibration, pipe=pipe, mount=mount, twin=twin,
                      catheter=Catheter(seed, 0.02, seed), rng=rng)


@one_thread()
def sweep(trial: SweepTrial, phi, z) -> tuple[Sweep, SweepState]:
    """Sweep by the procedure, while flow sways the head and friction holds the catheter."""
    scanning = Sweep(calibration=trial.calibration)
    state, request = scanning.begin(phi, z), NOTHING
    twin, rng, catheter = trial.twin, trial.rng, trial.catheter
    joints, begin = np.zeros(2), float(rng.uniform(0.0, _PHASES))
    ticks, place = 0, np.zeros(2)
    was = now = scoring.catheter_place(catheter)
    while not state.done:
        t = ticks * catheter.tick
        joints = joints if request.angles is None else request.angles
        shots = []
        rate = (now - was) / catheter.tick
        for k in range(request.shots):
            advance, roll = (now + k * INTERVAL * rate).tolist()
            twin.move(replace(trial.mount, advance=advance, roll=roll))
            pan, tilt = joints + _SWAY.at(begin + t + k * INTERVAL)
            twin.look(float(pan), float(tilt))
            shots.append(twin.shot())
        reading = Reading(
            t=t, angles=joints + _JOINT_NOISE * rng.standard_normal(2), place=place,
            base=_SWAY.at(begin + t) + GYROSCOPE_NOISE * rng.standard_normal(2),
            shots=tuple(shots), fired=bool(shots),
        )
        state, request = scanning.step(state, reading)
        was = now
        place = np.asarray(catheter.exchange(request.rates / _UNITS)) * _UNITS
        now = scoring.catheter_place(catheter)
        ticks += 1
    return scanning, state


_UNITS = np.array([1e-3, math.radians(1.0)])

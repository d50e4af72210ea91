"""The ionic polymer paper, reproduced on the twin.

Chen, Tan and Shahinpoor (Quasi-static positioning of ionic polymer-metal composite actuators,
2005) measure a strip quasi-statically, identify a Preisach operator, position the strip with its
inverse, and add linear dynamics. They leave open how to follow the slow drift that they observed.
This study does all of it on one specimen, with two more models for comparison, and reaches the
targets at the end of short holds.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, uniform_levels
from minorloop.connect import connect
from minorloop.dynamics.cascade import Cascade, CascadeInversion
from minorloop.identification import excitation
from minorloop.identification.baseline import nrmse
from minorloop.identification.frequency import FrequencyResponse, Preamble, frequency_response
from minorloop.identification.rational import RationalFit
from minorloop.identification.representability import Representability, representability
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import FURTHER, hold_each
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.positioning import (
    AppliedSequence,
    ExperimentProtocol,
    Positioning,
    drive,
    run_positioning,
)
from minorloop.twins.ipmc import Ipmc
from minorloop.twins.ipmc_laser import NOISE
from papers.facts import ProbeInputs, identify_settled, twin_facts
from papers.harness import rms
from papers.short_holds import ShortHolds, run_short_holds
from papers.tracking import DriftTracking, run_tracking, synthetic_figures

CURVATURE_NOISE = 0.025
"""Standard deviation of the curvature in the other experiments, in 1/m: the laser's, converted."""
FINE = 20
"""Bands of the finer identification."""
AMPLITUDES = (0.7, 1.0)
FREQUENCIES = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0)
HALF_HERTZ, HERTZ = 0.5, 1.0
SETTLING = 300.0
"""Seconds before a sine is measured: five times the slowest time constant of the strip."""
PROBES = ProbeInputs(low=-1.2, high=1.2, bands=10, hold=200.0, loop=(0.1, 0.6), excursion=-0.24)
REPEATS = 2
RANDOM_HOLDS = 60
SWEEP_PERIOD, SWEEP_REACH, SWEEP_INTERVAL = 40.0, 5.0, 0.05
"""Period, amplitude and sample interval of the trajectory: seconds, 1/m, seconds."""


@dataclass(frozen=True, eq=False)
class FollowedSweep:
    """A trajectory followed with the inverse of the operator alone and with that of the cascade."""

    inversion: CascadeInversion
    alone: Record
    cascade: Record

    def errors(self) -> dict[str, float]:
        """Root-mean-square errors in 1/m, over the second half."""
        late = slice(self.inversion.t.size // 2, None)
        return {
            f"rms_{name}": rms(record.y[late] - self.inversion.targets[late])
            for name, record in (("operator", self.alone), ("cascade", self.cascade))
        }


@dataclass(frozen=True, eq=False)
class Repetition:
    """A record that returns to the same memories, and the errors of three models."""

    u: FloatArray
    y: FloatArray
    found: Representability
    nrmse: dict[str, float]


@dataclass(frozen=True, eq=False)
class IpmcStudy:
    """All results of one specimen."""

    seed: int
    facts: dict[str, Any]
    major: Record
    positioning: Positioning
    plays_drive: AppliedSequence
    reversible: Positioning
    fine: Positioning
    response: FrequencyResponse
    dynamics: RationalFit
    sweep: FollowedSweep
    tracking: DriftTracking
    synthetic: dict[str, Any]
    repetition: Repetition
    sensing: Record
    short_holds: ShortHolds
    seconds: float

    def figures(self) -> dict[str, Any]:
        """Return all figures by the names under which they are printed."""
        spread = self.response.gain_spread(high=HALF_HERTZ)
        at_one = self.response.gain_spread(HERTZ, HERTZ)
        before, after = self.response.phase_spread(high=HALF_HERTZ)
        tracking, found = self.tracking, self.repetition.found
        return {
            "twin": self.facts,
            "positioning": {
                **_ratios(self.positioning),
                "rms_preisach": self.positioning.preisach.rms,
                "rms_plays": self.plays_drive.rms,
                "rms_quadratic": self.positioning.quadratic.rms,
                "max_preisach": self.positioning.preisach.worst,
                "max_quadratic": self.positioning.quadratic.worst,
                "coverage": self.positioning.coverage,
            },
            "positioning_reversible": {
                **_ratios(self.reversible),
                "rms_preisach": self.reversible.preisach.rms,
                "coverage": self.reversible.coverage,
            },
            "positioning_fine": _ratios(self.fine),
            "gain_spread": {
                "ratio_below_half_hz": spread.ratio,
                "before_db": spread.before,
                "after_db": spread.after,
                "at_one_hz": at_one.ratio,
                "before_at_one_hz_db": at_one.before,
                "after_at_one_hz_db": at_one.after,
            },
            "phases": {"before_deg": before, "after_deg": after, **_phases(self.response)},
            "dynamics": {
                "order": self.dynamics.model.order,
                "relative_error": self.dynamics.error,
                "dc_gain": self.dynamics.model.dc_gain,
                **self.sweep.errors(),
            },
            "recursive": {
                **self.synthetic,
                "twin_over_batch": tracking.rms(tracking.recursive) / tracking.rms(tracking.batch),
                "twin_over_fixed": tracking.rms(tracking.recursive) / tracking.rms(tracking.fixed),
            },
            "representability": {
                "congruency": found.congruency,
                "wiping_out": found.wiping_out,
                "floor": found.floor,
                **{f"{name}_nrmse": value for name, value in self.repetition.nrmse.items()},
            },
            "short_holds": self.short_holds.figures(),
            "sensing": {"peak_to_peak_mv": float(np.ptp(self.sensing.y))},
            "seconds": self.seconds,
        }


def run_study(seed: int) -> IpmcStudy:
    """Carry out the whole study on one specimen.

    Parameters
    ----------
    seed : int
        Seed of specimen, noise, targets and random voltages.
    """
    began = time.perf_counter()
    base = run_positioning(seed, NOISE, ExperimentProtocol(laser=True, diagonal="uniform"))
    reversible = run_positioning(seed, NOISE, ExperimentProtocol(laser=True))
    model = reversible.identification.model
    plays = GeneralisedPrandtlIshlinskii.fit(base.voltages, base.settled)
    setup = base.protocol
    inputs = plays.invert(base.targets, unreachable="clip").u
    response = _response(seed, model)
    dynamics = response.fit()
    return IpmcStudy(
        seed=seed,
        facts=twin_facts(Ipmc, PROBES),
        major=_major_loop(seed, setup),
        positioning=base,
        plays_drive=drive(seed, NOISE, setup, inputs, base.targets, 3),
        reversible=reversible,
        fine=run_positioning(seed, NOISE, ExperimentProtocol(laser=True, bands=FINE)),
        response=response,
        dynamics=dynamics,
        sweep=_sweep(seed, Cascade(model, dynamics.model)),
        tracking=run_tracking(seed),
        synthetic=synthetic_figures(seed),
        repetition=_repetition(seed, setup),
        sensing=_sensing(seed),
        short_holds=run_short_holds(seed),
        seconds=time.perf_counter() - began,
    )


def _ratios(result: Positioning) -> dict[str, float]:
    ratio = result.quadratic.rms / result.preisach.rms
    return {"rms_ratio_min": ratio, "rms_ratio_median": ratio}


def _phases(response: FrequencyResponse) -> dict[str, Any]:
    """Return the phases in degrees at every frequency, a list for each amplitude."""
    found: dict[str, Any] = {"frequencies_hz": response.frequencies.tolist()}
    for name, gains in (("before", response.plant), ("after", response.after)):
        if gains is not None:
            for amplitude, row in zip(response.amplitudes, gains, strict=True):
                found[f"{name}_{amplitude:g}_v"] = np.degrees(np.angle(row)).tolist()
    return found


def _strip(seed: int, experiment: int) -> Ipmc:
    """Return a specimen with a curvature sensor; every experiment has noise of its own."""
    noise_seed = seed + FURTHER * experiment
    strip = connect("twin:ipmc", specimen=seed, noise=CURVATURE_NOISE, seed=noise_seed)
    assert isinstance(strip, Ipmc)  # the only twin with waveforms and sensing here
    return strip


def _major_loop(seed: int, setup: ExperimentProtocol) -> Record:
    """Return the record of Fig 4: up and down, every step held."""
    grid = uniform_levels(-setup.voltage, setup.voltage, setup.bands)
    u = np.concatenate([grid, grid[-2::-1]])
    return hold_each(_strip(seed, 4), u, setup.hold, setup.sample_interval)[0]


def _response(seed: int, model: Preisach) -> FrequencyResponse:
    experiments = itertools.count(100)
    return frequency_response(
        lambda t, u: _strip(seed, next(experiments)).drive(t, u),
        FREQUENCIES,
        AMPLITUDES,
        preamble=Preamble(-1.2, 200.0),
        settling=SETTLING,
        operator=model,
    )


def _sweep(seed: int, cascade: Cascade) -> FollowedSweep:
    """Follow a sine in curvature with growing amplitude, with both inverses."""
    t = np.arange(0.0, 4 * SWEEP_PERIOD, SWEEP_INTERVAL)
    rest = float(cascade.operator.simulate([-1.2, 0.0])[-1])
    swell = np.minimum(t / SWEEP_PERIOD, 1.0)
    targets = rest + SWEEP_REACH * swell * np.sin(2 * np.pi * t / SWEEP_PERIOD)
    start = cascade.operator.step("negative", -1.2)[1]
    inversion = cascade.invert(t, targets, start, before=0.0, unreachable="clip")
    alone = cascade.operator.invert(targets, cascade.operator.step(start, 0.0)[1], "clip").u
    records = []
    for experiment, inputs in enumerate((alone, inversion.u), start=5):
        strip = _strip(seed, experiment)
        strip.apply(-1.2, 400.0, 400.0)
        strip.apply(0.0, 400.0, 400.0)
        records.append(strip.drive(t, np.clip(inputs, -1.2, 1.2)))
    return FollowedSweep(inversion, records[0], records[1])


def _repetition(seed: int, setup: ExperimentProtocol) -> Repetition:
    """Measure two staircases and random levels, in which memories and branches repeat."""
    grid = uniform_levels(-setup.voltage, setup.voltage, setup.bands)
    stairs = excitation.decaying_staircase(grid)
    random = np.random.default_rng(seed).choice(grid, RANDOM_HOLDS)
    u = np.concatenate([*[stairs] * REPEATS, random])
    _, y = hold_each(_strip(seed, 7), u, setup.hold, setup.sample_interval)
    fit = identify_settled(u, y, levels=grid)
    plays = GeneralisedPrandtlIshlinskii.fit(u, y)
    quadratic = np.polyval(np.polyfit(u, y, 2), u)
    errors = {
        "preisach": fit.nrmse,
        "plays": nrmse(plays.simulate(u) - y, y),
        "quadratic": nrmse(quadratic - y, y),
    }
    return Repetition(u, y, representability(u, y), errors)


def _sensing(seed: int) -> Record:
    """Use the strip as a sensor: bend it back and forth, then hold it bent."""
    t = np.arange(0.0, 12.0, 0.02)
    bending = np.where(t < 6.0, 5.0 * np.sin(np.pi * t) ** 2 * np.sign(np.sin(np.pi * t)), 5.0)
    bending[(t >= 6.0) & (t < 6.2)] = np.linspace(0, 5, np.count_nonzero((t >= 6) & (t < 6.2)))
    return _strip(seed, 8).sense(t, bending)

"""The ionic polymer paper, reproduced on the twin.

Chen, Tan and Shahinpoor (Quasi-static positioning of ionic polymer-metal composite actuators,
2005) measure a strip quasi-statically, identify a Preisach operator, position the strip with its
inverse, and add linear dynamics. They leave open how to follow the slow drift that they observed.
This study does all of it on one specimen, with two more models for comparison, and reaches the
targets at the end of short holds.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from minorloop.arrays import FloatArray, uniform_levels
from minorloop.connect import connect
from minorloop.dynamics.cascade import Cascade
from minorloop.identification import excitation
from minorloop.identification.baseline import nrmse
from minorloop.identification.frequency import FrequencyResponse
from minorloop.identification.representability import representability
from minorloop.identification.sine_response import Preamble, frequency_response
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import FURTHER, hold_each
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.positioning import ExperimentProtocol, Positioning, drive, run_positioning
from minorloop.twins.ipmc import Ipmc
from minorloop.twins.ipmc_laser import NOISE
from papers.facts import ProbeInputs, identify_settled, twin_facts
from papers.harness import Results, rms
from papers.short_holds import run_short_holds
from papers.tracking import run_tracking

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


def run_study(seed: int) -> Results:
    """Carry out the whole study on the specimen of a seed.

    ``uniform`` is the paper's experiment with its model, ``ours`` the same with a reversible part
    on the diagonal; ``responses`` are those behind either model. What follows uses ours.
    """
    laser = ExperimentProtocol(laser=True)
    uniform = run_positioning(seed, NOISE, replace(laser, diagonal="uniform"))
    ours = run_positioning(seed, NOISE, laser)
    fine = run_positioning(seed, NOISE, replace(laser, bands=FINE))
    plays = GeneralisedPrandtlIshlinskii.fit(uniform.voltages, uniform.settled)
    inputs = plays.invert(uniform.targets, unreachable="clip").u
    driven = drive(seed, NOISE, laser, inputs, uniform.targets, 3)
    drives = {
        "uniform": uniform.preisach,
        "ours": ours.preisach,
        "plays": driven,
        "quadratic": uniform.quadratic,
    }
    models = {"uniform": uniform.identification.model, "ours": ours.identification.model}
    voltages = np.append(-laser.voltage, uniform.preisach.voltages)
    apart = models["ours"].simulate(voltages) - models["uniform"].simulate(voltages)
    responses = _responses(seed, models)
    dynamics = responses["ours"].fit()
    sweep = _sweep(seed, Cascade(models["ours"], dynamics.model))
    tracking = run_tracking(seed)
    repetition = _repetition(seed, laser)
    short_holds = run_short_holds(seed)
    facts = twin_facts(Ipmc, PROBES)
    found = repetition.found
    figures = {
        "twin": facts,
        "positioning": {
            **_ratios(uniform),
            **{f"rms_{name}": one.rms for name, one in drives.items()},
            **{f"max_{name}": one.worst for name, one in drives.items()},
            "between_levels": rms(apart[1:]),
            "first_target": abs(ours.preisach.errors[0]),
            "later_targets": rms(ours.preisach.errors[1:]),
        },
        "positioning_ours": _ratios(ours),
        "positioning_fine": _ratios(fine),
        **{f"response_{name}": _spreads(one) for name, one in responses.items()},
        "dynamics": {
            "order": dynamics.model.order,
            "relative_error": dynamics.error,
            **sweep.figures(),
        },
        "recursive": tracking.figures(),
        "representability": {
            "congruency": found.congruency,
            "wiping_out": found.wiping_out,
            "floor": found.floor,
            **{f"{name}_nrmse": value for name, value in repetition.nrmse.items()},
        },
        "short_holds": short_holds.figures(),
    }
    return Results(
        figures, seed=seed, facts=facts, major=_major_loop(seed, laser), uniform=uniform, ours=ours,
        drives=drives, responses=responses, dynamics=dynamics, sweep=sweep, tracking=tracking,
        repetition=repetition, short_holds=short_holds,
    )  # fmt: skip


def _ratios(result: Positioning) -> dict[str, float]:
    ratio = result.quadratic.rms / result.preisach.rms
    return {
        "rms_ratio_min": ratio,
        "rms_ratio_median": ratio,
        "coverage_mean": result.coverage,
    }


def _spreads(response: FrequencyResponse) -> dict[str, float]:
    """Return how far the two amplitudes are apart, before and after the operator."""
    low, at_one = response.gain_spread(high=HALF_HERTZ), response.gain_spread(HERTZ, HERTZ)
    before, after = response.phase_spread(high=HALF_HERTZ)
    return {
        "ratio_below_half_hz": low.ratio,
        "before_db": low.before,
        "after_db": low.after,
        "ratio_at_one_hz": at_one.ratio,
        "phase_before_deg": before,
        "phase_after_deg": after,
    }


def _strip(seed: int, experiment: int) -> Ipmc:
    """Return a specimen with a curvature sensor; every experiment has noise of its own."""
    noise_seed = seed + FURTHER * experiment
    strip = connect("twin:ipmc", specimen=seed, noise=CURVATURE_NOISE, seed=noise_seed)
    assert isinstance(strip, Ipmc)  # the only twin with waveforms here
    return strip


def _major_loop(seed: int, setup: ExperimentProtocol) -> Record:
    """Return the record of Fig 4: up and down, every step held."""
    grid = uniform_levels(-setup.voltage, setup.voltage, setup.bands)
    u = np.concatenate([grid, grid[-2::-1]])
    return hold_each(_strip(seed, 4), u, setup.hold, setup.sample_interval)[0]


def _responses(seed: int, models: dict[str, Preisach]) -> dict[str, FrequencyResponse]:
    """Measure the sines once, and return the gains behind each model."""
    measured: dict[int, Record] = {}

    def driven(experiments: Iterator[int]) -> Callable[[FloatArray, FloatArray], Record]:
        def drive_strip(t: FloatArray, u: FloatArray) -> Record:
            number = next(experiments)
            if number not in measured:
                measured[number] = _strip(seed, number).drive(t, u)
            return measured[number]

        return drive_strip

    return {
        name: frequency_response(
            driven(itertools.count(100)),
            FREQUENCIES,
            AMPLITUDES,
            preamble=Preamble(-1.2, 200.0),
            settling=SETTLING,
            operator=model,
        )
        for name, model in models.items()
    }


def _sweep(seed: int, cascade: Cascade) -> Results:
    """Follow a sine in curvature with growing amplitude, with both inverses.

    Figures are rms errors in 1/m over the second half, with the inverse of the operator alone and
    with that of the cascade.
    """
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
    late = slice(t.size // 2, None)
    names, targets = ("rms_operator", "rms_cascade"), inversion.targets
    errors = [rms(record.y[late] - targets[late]) for record in records]
    figures = dict(zip(names, errors, strict=True))
    return Results(figures, inversion=inversion, alone=records[0], cascade=records[1])


def _repetition(seed: int, setup: ExperimentProtocol) -> Results:
    """Measure two staircases and random levels, in which memories and branches repeat.

    The results have the errors of three models on this record.
    """
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
    return Results({}, found=representability(u, y), nrmse=errors)

from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.ultrasound.echoes import Burst, Pulse
from minorloop_head.ultrasound.pits import raster
from minorloop_head.ultrasound.spectra import (
    coverage_fault,
    long_enough,
    rejections,
    spectra_of,
    usable_bursts,
)

from .synthetic import CENTRE, PROBE

DT = 10e-9


def bursts(excess=0.0, amplitude=0.5):
    """One echo of a plain wall for each point of a raster, ``excess`` metres late."""
    rng, made = np.random.default_rng(0), []
    angles = raster(PROBE, CENTRE)
    shape = Pulse().samples(DT)
    for pair, spot in zip(angles, PROBE.spots(angles), strict=True):
        trace = 1e-3 * rng.standard_normal(2048)
        first = round(2 * (spot[2] + excess) / PROBE.speed / DT) - len(shape) // 2
        trace[first : first + len(shape)] += amplitude * shape
        made.append(Burst(trace, DT, pair, 4, 4, 1e-3))
    return made


@pytest.mark.parametrize("excess", [0.0, 50e-6])
def test_phases_count_from_the_echo_of_the_wall(excess):
    found = spectra_of(bursts(excess), PROBE, CENTRE).received
    middle = found[:, found.shape[1] // 2]
    assert np.abs(np.angle(middle)).max() < 2 * np.pi * 10e6 * DT
    assert np.abs(middle).min() > 0.9 * np.abs(middle).max()


def test_without_an_echo_of_the_wall_there_are_no_spectra():
    assert spectra_of(bursts(amplitude=0.0), PROBE, CENTRE) is None


def test_noise_is_that_of_a_window_without_an_echo():
    quiet = spectra_of(bursts(), PROBE, CENTRE, after=5e-6)
    parts = np.concatenate([quiet.received.real.ravel(), quiet.received.imag.ravel()])
    assert parts.std() == pytest.approx(quiet.noise[0], rel=0.1)
    twice = spectra_of([replace(one, noise=2e-3) for one in bursts()], PROBE, CENTRE)
    assert twice.noise == pytest.approx(2 * quiet.noise)


def scan(samples=2048, points=6):
    rng = np.random.default_rng(0)
    return [
        Burst(rng.normal(size=samples), 10e-9, pair, 4, 4, 1e-3)
        for pair in raster(PROBE, CENTRE, points=points)
    ]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({}, ""),
        ({"verdict": "dropout"}, "dropout"),
        ({"angles": np.array([np.nan, 0.0])}, "no angles"),
        ({"noise": 0.0}, "frozen"),
        ({"trace": np.ones(100)}, "not a trace"),
        ({"trace": np.full(2048, np.inf)}, "not a trace"),
    ],
)
def test_each_burst_has_its_reason(changes, reason):
    bursts = scan()
    bursts[5] = replace(bursts[5], **changes)
    assert rejections(bursts) == [""] * 5 + [reason] + [""] * 30
    assert len(usable_bursts(bursts)) == (35 if reason else 36)


def test_a_repeated_trace_is_frozen():
    bursts = scan()
    bursts[7] = replace(bursts[7], trace=bursts[6].trace)
    assert rejections(bursts)[6:8] == ["", "frozen"]


def test_traces_last_until_the_end_of_the_window():
    assert long_enough([], PROBE)
    assert long_enough(scan(), PROBE)
    assert not long_enough(scan(samples=1300), PROBE)
    assert coverage_fault(scan(samples=1300), PROBE, CENTRE, 1.1e-3) == "too short"

from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.pits import raster
from minorloop_head.ultrasound.spectra import (
    coverage_fault,
    long_enough,
    rejections,
    usable_bursts,
)

from .synthetic import CENTRE, PROBE


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

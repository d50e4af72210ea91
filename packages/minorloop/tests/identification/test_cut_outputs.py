import numpy as np
import pytest

import minorloop as ml
from fault_records import plant
from minorloop.identification.curves import Curves
from minorloop.identification.cut_outputs import cut_depth
from minorloop.identification.rough_model import RoughRecord


def rough(u, y):
    return RoughRecord.of(u, y, np.isfinite(y), Curves.whole("negative"), 0)


def sweeps(seed, samples=1500):
    ends = np.r_[0, 1, np.random.default_rng(seed).uniform(size=38)]
    return np.interp(np.linspace(0, 39, samples), np.arange(40), ends)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("noise", [0.003, 0.01, 0.02])
def test_an_output_that_is_cut_before_noise_is_found_at_its_level(noise, way):
    rng = np.random.default_rng(1000)
    u = sweeps(1000)
    y = plant(u)
    level = (way * y).max() - 0.3 * np.ptp(y)
    read = way * np.minimum(way * y, level) + noise * np.ptp(y) * rng.normal(size=u.size)
    depth = cut_depth(rough(u, read), way)
    assert depth == pytest.approx((way * read).max() - level, abs=4 * noise * np.ptp(y))
    assert cut_depth(rough(u, read), -way) is None


@pytest.mark.parametrize("bend", [0.0, 2.0, 4.0])
def test_an_output_that_saturates_smoothly_is_not_cut(bend):
    rng = np.random.default_rng(1001)
    u = sweeps(1001)
    y = plant(u) / np.ptp(plant(u))
    y = np.tanh(bend * y) if bend else y
    y += 0.01 * np.ptp(y) * rng.normal(size=u.size)
    assert [cut_depth(rough(u, y), way) for way in (1, -1)] == [None, None]


@pytest.mark.parametrize(("share", "found"), [(0.03, False), (0.1, True)])
def test_a_level_that_few_readings_reach_is_not_named(share, found):
    rng = np.random.default_rng(1002)
    u = sweeps(1002)
    y = plant(u)
    y = np.minimum(y, np.quantile(y, 1 - share)) + 0.001 * np.ptp(y) * rng.normal(size=u.size)
    assert (cut_depth(rough(u, y), 1) is not None) == found


def test_a_meter_that_stops_after_one_reading_is_said():
    y = np.full(400, 0.5)
    y[0] = 0.1
    assert any("within noise" in said for said in ml.identify(sweeps(1003, 400), y).warnings)

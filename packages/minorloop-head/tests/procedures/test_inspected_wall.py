"""The wall that an inspection saw, its shares, and its figure."""

import numpy as np
import pytest

from minorloop_head.procedures.finding_map import draw_c_scan
from minorloop_head.procedures.inspected_wall import (
    SeenWall,
    c_scan_of,
)
from minorloop_head.procedures.scan import RasterScan, ScannedRaster
from minorloop_head.reconstruction.depth_map import Patch
from minorloop_head.ultrasound.echoes import Burst, Pulse
from minorloop_head.ultrasound.pits import raster

from .fakes import CALIBRATION
from .test_probe_steps import burst

RING = Patch.ring(10e-3, 20e-3, step=0.5e-3)


def seen_between(rows, columns):
    picture = np.full((RING.rows, RING.columns), np.nan)
    picture[slice(*rows), slice(*columns)] = 0.1
    return SeenWall(RING, picture, np.zeros(picture.shape, bool))


def test_the_range_and_the_share_of_what_was_seen():
    every = seen_between((4, 11), (0, RING.columns))
    assert every.along == pytest.approx((13e-3, 14e-3))  # less 1 mm at each end
    assert every.around == (-np.pi, np.pi)
    assert every.seen_share == 1.0
    sector = seen_between((4, 11), (0, 94))
    first, last = np.degrees(sector.around)
    assert first == pytest.approx(-90.0, abs=3.0)
    assert last - first == pytest.approx(360.0 * 93 / RING.columns, abs=3.0)
    assert sector.seen_share == pytest.approx(94 / RING.columns)


def test_a_scan_shows_amplitude_and_depth_of_its_echoes():
    """In the middle of a raster the wall is 0.5 mm farther away."""
    scan, reference = RasterScan(calibration=CALIBRATION), np.array([20e-3, 0.3])
    probe, rng = CALIBRATION.probe_at(reference), np.random.default_rng(1)
    t, middle = 1e-8 * np.arange(2000), tuple(probe.spots(scan.perpendicular)[0, :2].tolist())
    bursts = []
    for n, angles in enumerate(raster(probe, middle)):
        far = 2 * (probe.spots(angles)[0, 2] + 0.5e-3 * (n in (14, 15, 20, 21))) / probe.speed
        trace = 1e-3 * rng.standard_normal(t.size)
        pulse = Pulse().samples(1e-8)
        first = round(far / 1e-8) - pulse.size // 2
        trace[first : first + pulse.size] += 0.5 * pulse
        bursts.append(Burst(trace, 1e-8, angles, 16, 16, 1e-3))
    found = c_scan_of(ScannedRaster(reference=reference, bursts=tuple(bursts)), CALIBRATION)
    depth = found.wall.depth[np.isfinite(found.wall.depth)]
    assert np.ptp(depth) == pytest.approx(0.5e-3, abs=0.05e-3)
    assert np.nanmax(found.amplitude) == pytest.approx(1.0, abs=0.1)
    off = found.wall.patch.off(*middle)
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.1e-3
    figure = draw_c_scan(found)
    assert "amplitude" in figure.axes[0].get_title()
    silent = ScannedRaster(reference=reference, bursts=(burst("no coupling"),))
    assert c_scan_of(silent, CALIBRATION) is None

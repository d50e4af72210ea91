"""Depth of a crack from echoes; most cracks are too narrow for the footprint of the beam."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import SignalError
from minorloop.threads import one_thread
from minorloop_head.geometry import wall_distance, wall_lengths
from minorloop_head.reconstruction.depth_map import BOTH, DepthMap, Patch, camera_map
from minorloop_head.reconstruction.findings import Finding
from minorloop_head.reconstruction.fusion import footprints_of
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.joint_fit import JointFit
from minorloop_head.ultrasound.pit_model import PitModel
from minorloop_head.ultrasound.pits import DEEPER, DEEPEST
from minorloop_head.ultrasound.spectra import FAR, long_enough, spectra_of, usable_bursts

MEASURED, NARROW, SILENT = "measured", "too narrow for a depth", "no floor echo"
_FEWEST, _REACH = 12, 2.4e-3
"""Fewest bursts for a depth, and side of the patch that contains all footprints, in metres."""
_TEXEL = 0.04e-3
_CROSSED = 1e-3  # m, half the side of a raster
_ENOUGH = 60.0
"""Least energy of the floor over the noise, halved, for a depth to be searched."""
_SURE = 20.0
"""Least advantage in cost of a floor over no floor, and of the best depth over any other."""
_APART = 0.03e-3  # m, between depths of different dips of the cost
_UNMODELLED = 12e-6
"""Error of a depth by waves between the flanks, in metres, from scans of the twin."""
_GAINS = (0.25, 0.4, 0.63, 1.0)
"""Shares of the sound in a crack that its floor returns, each 1.6 times the last: between the
flanks sound spreads along the crack, the more the deeper it is."""
_BOUND = 0.8e-3
"""Greatest lower bound of a depth in metres. Floors of cracks of the twin, 0.1 to 0.3 mm wide, are
found down to 0.7 mm. At 1.1 mm that of a wide one is not: waves between its flanks disturb it."""
_DEPTHS: FloatArray = np.arange(0.08e-3, 1.6e-3, 0.01e-3)
"""Tried depths in metres, down to the end of the window."""


@dataclass(frozen=True)
class CrackDepth:
    """Depth of a crack by ultrasound."""

    verdict: str
    """``measured``; ``deeper than 1.25 mm``; ``too narrow for a depth``; ``no floor echo`` (wide
    enough, but no echo from its floor, or none that fits one depth); ``too few echoes``; ``too
    short`` (traces end before the echo of a floor); ``no coupling``."""
    depth: float = np.nan
    depth_sd: float = np.nan
    """Mean over the part under the beams, in metres; NaN where not measured."""
    least_width: float = np.nan
    """Smallest width for which these echoes would give a depth, in metres; NaN without echoes."""
    least_depth: float = np.nan
    """Lower bound in metres where there is no depth: the echoes exclude every floor above it. NaN
    if they exclude none."""


@one_thread()
def crack_depth(
    bursts: Sequence[Burst], probe: CalibratedProbe, places: npt.ArrayLike, width: float
) -> CrackDepth:
    """Measure the depth of a crack from the bursts of a raster across it.

    Raises a `SignalError` if fewer than two places are given, or the width is not positive.

    ``bursts``: as ``average`` made them; ``probe``: the probe in its pipe;
    ``places`` (N, 2): phi and z along the crack as the camera traced it; ``width``: width of the
    crack in the image, in metres.

    Notes
    -----
    The image gives the share of each footprint that falls on the crack. That share of the echo is
    delayed by the depth. The depth and the returned part of that share are the only unknowns. Waves
    between the flanks are neglected.
    """
    course = np.asarray(places, dtype=np.float64)
    if course.ndim != 2 or course.shape[1:] != (2,) or len(course) < 2 or not width > 0:
        raise SignalError(f"a crack of shape {course.shape}, {width} m wide; give (N, 2) places")
    good = usable_bursts(bursts)
    if len(good) < _FEWEST:
        return CrackDepth("too few echoes")
    if not long_enough(good, probe):
        return CrackDepth("too short")
    middle = _middle(good, probe, _dense(course, probe.radius))
    spectra = spectra_of(good, probe, middle)
    if spectra is None:
        return CrackDepth("no coupling")
    model = PitModel(probe, spectra.angles, middle, 0.5e-3)
    patch = Patch.around(*middle, size=_REACH, radius=probe.radius, step=_TEXEL)
    share = footprints_of(model, patch) @ _cover(patch, course, width).ravel()
    fit = JointFit(model, spectra, far=np.argsort(np.abs(share))[:FAR])
    return _estimate(fit, share, width)


def crack_finding(
    places: npt.ArrayLike, width: float, found: CrackDepth, radius: float, *, width_sd: float
) -> Finding:
    """Return a traced crack as a finding; width and length are those along its course.

    ``places`` (N, 2): phi and z along it; ``width``: the median along it, in metres; ``found``: its
    depth by ultrasound; ``radius``: of the pipe, in metres; ``width_sd``: standard deviation of the
    width.
    """
    course = np.asarray(places, dtype=np.float64)
    length = float(wall_lengths(course, radius)[-1])
    phi, z = course[len(course) // 2].tolist()
    verdict = found.verdict
    if verdict == NARROW and np.isfinite(found.least_width):
        verdict += f" (under {1e3 * found.least_width:.2f} mm)"
    if verdict == SILENT and np.isfinite(found.least_depth):
        verdict += f" (at least {1e3 * found.least_depth:.2f} mm deep)"
    place_sd = 0.05e-3
    return Finding(
        "crack", verdict, phi, place_sd / radius, z, place_sd, width, width_sd, length,
        max(0.05 * length, 0.1e-3), found.depth, found.depth_sd,
    )  # fmt: skip


def crack_map(
    places: npt.ArrayLike,
    width: float,
    found: CrackDepth,
    middle: tuple[float, float],
    patch: Patch,
) -> DepthMap:
    """Return the depth map of the wall with a crack, which has the measured depth under the raster.

    ``places`` (N, 2): phi and z along it. ``width``: in metres. ``found``: its depth by ultrasound.
    ``middle``: phi and z in the middle of the raster. Farther than half its side from there the
    depth of the crack is unknown, and everywhere if none was measured. ``patch``: the texels of the
    map.
    """
    course = _dense(np.asarray(places, dtype=np.float64), patch.radius)
    inside = _cover(patch, course, width) >= 0.5
    wall = camera_map(patch, np.ones(inside.shape, dtype=bool), inside)
    crossed = inside & (np.abs(patch.off(*middle)).max(axis=-1) < _CROSSED)
    if not np.isfinite(found.depth):
        return wall
    return DepthMap(
        patch,
        np.where(crossed, found.depth, wall.depth),
        np.where(crossed, found.depth_sd, wall.sd),
        np.where(crossed, BOTH, wall.source).astype(np.uint8),
    )


def _dense(course: FloatArray, radius: float) -> FloatArray:
    """Return the course in steps of 0.1 mm."""
    around = np.unwrap(course[:, 0])
    along = wall_lengths(course, radius)
    fine = np.linspace(0.0, along[-1], max(int(along[-1] / 0.1e-3), 1) + 1)
    return np.stack([np.interp(fine, along, around), np.interp(fine, along, course[:, 1])], axis=1)


def _middle(
    bursts: Sequence[Burst], probe: CalibratedProbe, course: FloatArray
) -> tuple[float, float]:
    """Return the place of a dense course nearest to the middle of the raster."""
    spots = probe.spots(np.array([burst.angles for burst in bursts]))[:, :2]
    phi, z = np.angle(np.exp(1j * spots[:, 0]).mean()), spots[:, 1].mean()
    near = course[int(np.argmin(wall_distance(course, (phi, z), probe.radius)))]
    return float(near[0]), float(near[1])


def _cover(patch: Patch, course: FloatArray, width: float) -> FloatArray:
    """Return the share (rows, columns) of each texel that is on the crack."""
    off = np.full((patch.rows, patch.columns), np.inf)
    for start, stop in pairwise(course):
        first, last = -patch.off(*start), -patch.off(*stop)
        way = last - first
        square = np.maximum((way**2).sum(axis=-1), 1e-18)
        along = np.clip(-(first * way).sum(axis=-1) / square, 0.0, 1.0)
        off = np.minimum(off, np.linalg.norm(first + along[..., None] * way, axis=-1))
    covered: FloatArray = np.clip((width / 2 - off) / patch.step + 0.5, 0.0, 1.0)
    return covered


def _estimate(fit: JointFit, share: FloatArray, width: float) -> CrackDepth:
    """Return the depth at which the delayed share explains the traces, if one stands out."""
    expected = np.abs(fit.pulse * fit.model.plain) ** 2
    energy = float((share**2 * expected.sum(axis=1) / fit.spectra.noise**2).sum() / 2)
    least = width * float(np.sqrt(_ENOUGH / max(energy, 1e-12)))
    if energy < _ENOUGH:
        return CrackDepth(NARROW, least_width=least)
    k, plain = fit.model.sound.wavenumbers, fit.model.plain
    parts = [gain * share[:, None] for gain in _GAINS]
    every = np.array(
        [
            [fit.cost_of(plain * (1 + part * (np.exp(2j * k * d) - 1))) for d in _DEPTHS]
            for part in parts
        ]
    )
    row, best = np.unravel_index(int(np.argmin(every)), every.shape)
    costs = every[row]
    others = every[:, np.abs(_DEPTHS - _DEPTHS[best]) > _APART]
    without = min(fit.cost_of(plain), *(fit.cost_of(plain * (1 - part)) for part in parts))
    if min(without, float(others.min())) - costs[best] < _SURE or best in (0, len(_DEPTHS) - 1):
        bound = _bound(every.min(axis=0) - min(without, float(every.min())))
        return CrackDepth(SILENT, least_width=least, least_depth=bound)
    if _DEPTHS[best] > DEEPEST:
        return CrackDepth(DEEPER, least_width=least, least_depth=DEEPEST)
    before, here, after = costs[best - 1 : best + 2]
    step = float(_DEPTHS[1] - _DEPTHS[0])
    bend = max(before - 2 * here + after, 1e-9)
    depth = float(_DEPTHS[best] + 0.5 * step * (before - after) / bend)
    return CrackDepth(
        MEASURED, depth, float(np.hypot(2 * step / np.sqrt(bend), _UNMODELLED)), least
    )


def _bound(costs: FloatArray) -> float:
    """Return the first depth that costs (D,) over the best explanation do not exclude."""
    possible = int(np.argmax(np.append(costs < _SURE, True)))
    return float(min(np.append(_DEPTHS, np.inf)[possible], _BOUND)) if possible else np.nan

"""Fuse image and echoes into one depth map: outline from the image, floor from the echoes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray
from minorloop.errors import SignalError
from minorloop.threads import one_thread
from minorloop_head.geometry import wall_point
from minorloop_head.reconstruction.depth_map import CAMERA, ECHOES, UNSEEN, WALL_SD, DepthMap, Patch
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.field import CalibratedProbe, as_complex
from minorloop_head.ultrasound.joint_fit import DEPTHS, JointFit
from minorloop_head.ultrasound.pit_model import PitModel
from minorloop_head.ultrasound.pits import PitDepth
from minorloop_head.ultrasound.spectra import long_enough, spectra_of, usable_bursts

_SHARE_ERROR = 0.08
"""Relative error of a depth from two echoes, which neglects waves in a pit."""
_STIFFNESS = 1 / 0.05e-3**2
"""Weight of a squared difference of neighbours inside an outline without edges, in 1/m^2."""
EDGE = 0.15
"""Least difference of the logarithm of the image between neighbours at an edge."""
_UNKNOWN = 0.6e-3
"""Prior standard deviation of an unknown depth, in metres."""
_LEAST_RIM = 0.03e-3
"""Least standard deviation of the place of a rim, in metres: a third of a texel."""
PATCH = 2.4e-3
"""Side of the map about a finding in metres: the raster and a footprint of the beam around it."""


@dataclass(frozen=True, eq=False)
class MeanDepths:
    """Mean depth over the footprint of each trace."""

    values: FloatArray
    sds: FloatArray
    """Shape (K,). In metres."""
    footprints: FloatArray
    """Shape (K, P). Weights of the texels of a patch, which sum to about 1."""


@one_thread()
def mean_depths(
    bursts: Sequence[Burst], probe: CalibratedProbe, patch: Patch, pit: PitDepth
) -> MeanDepths | None:
    """Return the mean depth under the footprint of each trace; None without an echo of the wall.

    Notes
    -----
    A trace is split into an echo of the wall and one delayed by the depth of the floor. The share
    of the second times its depth is, to first order, the mean depth over the footprint, which is
    the square of the pressure.
    """
    good = usable_bursts(bursts)
    enough = len(good) >= 5 and long_enough(good, probe)
    spectra = spectra_of(good, probe, (pit.phi, pit.z)) if enough else None
    if spectra is None:
        return None
    mouth = pit.diameter if np.isfinite(pit.diameter) else 1e-3
    model = PitModel(probe, spectra.angles, (pit.phi, pit.z), mouth / 2)
    fit = JointFit(model, spectra)
    k = model.sound.wavenumbers
    expected = fit.pulse * model.plain
    power = np.abs(expected) ** 2
    depth = pit.depth if np.isfinite(pit.depth) else _common_depth(spectra.received, expected, k)
    values, sds = _shares(spectra.received, expected, k, depth, spectra.noise)
    return MeanDepths(values, sds, footprints_of(model, patch, power))


def footprints_of(model: PitModel, patch: Patch, power: FloatArray | None = None) -> FloatArray:
    """Return the share (K, P) of each texel in the echo of a plain wall, for each beam.

    ``model``: of the beams. ``patch``: the texels of the map. ``power`` (K, F): weights of the
    frequencies; without it, the middle third counts.
    """
    probe, k = model.probe, model.sound.wavenumbers
    if power is None:
        third = len(k) // 3
        middle = np.abs(np.arange(len(k)) - len(k) / 2) < third / 2
        power = np.tile(middle.astype(np.float64), (len(model.angles), 1))
    origins, axes = probe.beams(model.angles)
    places = patch.places.reshape(-1, 2)
    points = wall_point(places[:, 0], places[:, 1], probe.radius)
    pressure = as_complex(model.sound.at(origins, axes, model.spots[:, 2].copy(), points))
    weight = 2j * k * patch.step**2 * power / power.sum(axis=1, keepdims=True)
    footprints: FloatArray = (pressure**2 @ (weight / model.plain)[..., None])[..., 0].real
    return footprints


def _shares(
    received: npt.NDArray[np.complex128],
    expected: npt.NDArray[np.complex128],
    k: FloatArray,
    depth: float,
    noise: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return mean depths (K,) and their standard deviations for a floor at one depth."""
    late = expected * np.exp(2j * k * depth)
    a, b = (np.abs(expected) ** 2).sum(axis=1), (np.conj(expected) * late).real.sum(axis=1)
    p = (np.conj(expected) * received).real.sum(axis=1)
    q = (np.conj(late) * received).real.sum(axis=1)
    determinant = np.maximum(a * a - b * b, 1e-12 * a * a)
    front, floor = (a * p - b * q) / determinant, (a * q - b * p) / determinant
    total = np.maximum(front + floor, 0.2)
    share = np.clip(floor / total, -0.2, 1.2)
    spread = noise * np.sqrt(a / determinant) / total
    return depth * share, depth * np.hypot(spread, _SHARE_ERROR)


def _common_depth(
    received: npt.NDArray[np.complex128], expected: npt.NDArray[np.complex128], k: FloatArray
) -> float:
    """Return the depth at which two echoes explain most of all traces."""
    kept = []
    for depth in DEPTHS:
        late = expected * np.exp(2j * k * depth)
        basis = np.stack([expected, late], axis=-1)
        gram = np.einsum("kfi,kfj->kij", np.conj(basis), basis).real
        right = np.einsum("kfi,kf->ki", np.conj(basis), received).real
        solved = np.linalg.solve(gram + 1e-9 * np.eye(2) * gram[:, :1, :1], right[..., None])
        kept.append(float((right * solved[..., 0]).sum()))
    return float(DEPTHS[int(np.argmax(kept))])


def inside_probability(patch: Patch, pit: PitDepth, outline: npt.ArrayLike | None) -> FloatArray:
    """Return the probability (rows, columns) that a texel is in the mouth of a pit.

    ``patch``: the texels of the map. ``pit``: place and size with their standard deviations.
    ``outline`` (rows, columns): probability of a defect by the image; the logits of both are then
    averaged.
    """
    off = np.linalg.norm(patch.off(pit.phi, pit.z), axis=-1)
    rim = np.sqrt(
        np.nan_to_num(pit.place_sd) ** 2 + (np.nan_to_num(pit.diameter_sd) / 2) ** 2 + _LEAST_RIM**2
    )
    mouth = pit.diameter if np.isfinite(pit.diameter) else 1e-3
    disc = _normal_share((mouth / 2 - off) / rim)
    if outline is None:
        return disc
    seen = np.clip(np.asarray(outline, dtype=np.float64), 0.01, 0.99)
    if seen.shape != disc.shape:
        raise SignalError(f"the outline has shape {seen.shape}; the patch has {disc.shape}")
    sure = np.clip(disc, 1e-4, 1 - 1e-4)
    seen = np.where(np.isfinite(seen), seen, sure)
    logit = 0.5 * (np.log(seen / (1 - seen)) + np.log(sure / (1 - sure)))
    both: FloatArray = 1 / (1 + np.exp(-logit))
    return both


def outline_of(
    image: npt.ArrayLike, patch: Patch, place: tuple[float, float], diameter: float
) -> FloatArray:
    """Return the probability (rows, columns) by the image that a texel is in a mouth.

    ``image`` (rows, columns): logarithm of the unrolled image; NaN where the wall is not seen.
    ``patch``: the texels of the map. ``place``: phi and z of the mouth in the image. ``diameter``:
    in metres.

    Notes
    -----
    The threshold is half way between the median inside and that of a ring around. Texels farther
    than a third of the diameter from the outline follow the outline alone. The result is NaN where
    the image is.
    """
    shade = np.asarray(image, dtype=np.float64)
    off = np.linalg.norm(patch.off(*place), axis=-1)
    if shade.shape != off.shape:
        raise SignalError(f"the image has shape {shade.shape}; the patch has {off.shape}")
    seen = np.isfinite(shade)
    inner = seen & (off < 0.35 * diameter)
    outer = seen & (off > 0.65 * diameter) & (off < 1.1 * diameter)
    disc = _normal_share((diameter / 2 - off) / (0.08 * diameter))
    if inner.sum() < 4 or outer.sum() < 8:
        return np.where(seen, disc, np.nan)
    inside, around = float(np.median(shade[inner])), float(np.median(shade[outer]))
    scatter = float(np.median(np.abs(shade[outer] - around))) * 1.4826
    contrast = inside - around
    if abs(contrast) <= 3 * scatter:
        return np.where(seen, disc, np.nan)
    share = (np.nan_to_num(shade, nan=around) - (inside + around) / 2) / contrast
    width = max(scatter / abs(contrast), 0.12)
    by_level = 1 / (1 + np.exp(np.clip(-share / width, -30.0, 30.0)))
    near = np.abs(off - diameter / 2) < diameter / 3
    return np.where(seen, np.where(near, by_level, disc), np.nan)


@one_thread()
def fuse(
    pit: PitDepth,
    means: MeanDepths | None,
    patch: Patch,
    *,
    image: npt.ArrayLike | None = None,
    outline: npt.ArrayLike | None = None,
) -> DepthMap:
    """Fuse the measurements of a pit into a depth map.

    It is infinitely deep inside a through-hole. Without an echo, the depth is 0 outside of the
    outline, where the camera sees the wall, and unknown inside. Without camera and echo it is
    unknown.

    ``pit``: result of the joint fit. ``means``: of the same bursts on the same patch. ``patch``:
    the texels of the map. ``image`` (rows, columns): logarithm of the unrolled image, NaN where the
    wall is not seen; smoothing stops at its edges. Without it, the whole patch counts as seen.
    ``outline`` (rows, columns): probability of a defect by the image, NaN where the wall is not
    seen.

    Notes
    -----
    The minimum of
    ``sum (a - H d)^2 / sd^2 + stiffness * sum g |grad d|^2 + sum (d - m)^2 / s^2``:
    the mean m and deviation s of a texel are those of a mixture of wall and floor, weighted by
    the probability that it is inside. The posterior is Gaussian; its deviations are the roots of
    the diagonal of the inverse.
    """
    inside = inside_probability(patch, pit, outline)
    seen = np.ones(inside.shape, bool)
    if image is not None:
        seen = np.isfinite(np.asarray(image, dtype=np.float64))
        if seen.shape != inside.shape:
            raise SignalError(f"the image has shape {seen.shape}; the patch has {inside.shape}")
    source = np.where(seen, CAMERA, UNSEEN)
    if means is not None:
        source = source | np.where(_reached(means, patch), ECHOES, UNSEEN)
    if pit.verdict == "through-hole":
        depth, sd = (np.where(inside >= 0.5, np.inf, 0.0), np.where(inside >= 0.5, np.nan, WALL_SD))
    elif means is None:
        depth, sd = np.where(inside < 0.5, 0.0, np.nan), np.where(inside < 0.5, WALL_SD, np.inf)
    else:
        depth, sd = _fused(pit, means, patch, inside, image)
    known = source != UNSEEN
    return DepthMap(
        patch, np.where(known, depth, np.nan), np.where(known, sd, np.inf), source.astype(np.uint8)
    )


def _reached(means: MeanDepths, patch: Patch) -> BoolArray:
    """Return the texels with a footprint above a twentieth of the highest."""
    height = np.abs(means.footprints).max(axis=0, initial=0.0).reshape(patch.rows, patch.columns)
    reached: BoolArray = height > 0.05 * max(float(height.max()), 1e-12)
    return reached


def _fused(
    pit: PitDepth, means: MeanDepths, patch: Patch, inside: FloatArray, image: npt.ArrayLike | None
) -> tuple[FloatArray, FloatArray]:
    """Return depth and standard deviation of texels with echoes."""
    mean, spread, rim = _prior_of(patch, pit, inside)
    mask = ((inside > 0.003) | _reached(means, patch)).ravel()
    depth, sd = np.zeros(mask.size), np.full(mask.size, WALL_SD)
    if mask.any():
        ties = _ties(patch, inside, image, mask)
        depth[mask], sd[mask] = _solve(means, mask, ties, mean.ravel()[mask], spread.ravel()[mask])
    # No footprint resolves the side of the rim on which a single texel is.
    sd = np.hypot(sd, rim.ravel())
    return depth.reshape(inside.shape), sd.reshape(inside.shape)


def _prior_of(
    patch: Patch, pit: PitDepth, inside: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return prior mean and deviation of each texel, and the deviation by its side of the rim."""
    side = np.sqrt(inside * (1 - inside))
    if not np.isfinite(pit.depth):
        spread = np.hypot(_UNKNOWN * inside, (1 - inside) * WALL_SD)
        return 0.5 * _UNKNOWN * inside, spread, 0.5 * _UNKNOWN * side
    off = patch.off(pit.phi, pit.z)
    mouth = max(pit.diameter / 2, patch.step)
    share = np.minimum((off**2).sum(axis=-1) / mouth**2, 1.0)
    dish = float(np.nan_to_num(pit.dish))
    floor = pit.depth + off @ np.array(pit.tilt) + dish * (1 - 2 * share)
    own = np.hypot(pit.depth_sd, 0.01 * mouth)
    spread = np.sqrt((side * floor) ** 2 + inside * own**2 + (1 - inside) * WALL_SD**2)
    return inside * floor, spread, side * floor


def _ties(
    patch: Patch, inside: FloatArray, image: npt.ArrayLike | None, mask: BoolArray
) -> FloatArray:
    """Return the (M, M) matrix of squared differences of neighbours inside, weak across edges."""
    shade = np.zeros(inside.shape) if image is None else np.asarray(image, dtype=np.float64)
    shade = np.nan_to_num(shade)
    flat = np.full(mask.size, -1)
    flat[mask] = np.arange(mask.sum())
    number = flat.reshape(inside.shape)
    ties = np.zeros((int(mask.sum()), int(mask.sum())))
    for axis in (0, 1):
        a, b = np.moveaxis(number, axis, 0)[:-1], np.moveaxis(number, axis, 0)[1:]
        step = np.diff(shade, axis=axis)
        rim = np.diff(inside, axis=axis)
        weight = np.moveaxis(1 / (1 + (step / EDGE) ** 2 + (rim / 0.1) ** 2), axis, 0)
        both = (a >= 0) & (b >= 0)
        i, j, w = a[both], b[both], _STIFFNESS * weight[both]
        np.add.at(ties, (i, i), w)
        np.add.at(ties, (j, j), w)
        np.add.at(ties, (i, j), -w)
        np.add.at(ties, (j, i), -w)
    return ties


def _normal_share(x: FloatArray) -> FloatArray:
    """Return the normal distribution function."""
    from scipy.special import ndtr

    return np.asarray(ndtr(x))


def _solve(
    means: MeanDepths, mask: BoolArray, ties: FloatArray, mean: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean and deviation of the texels inside."""
    from scipy.linalg import cho_factor, cho_solve  # steering a probe does not need it

    weighted = means.footprints[:, mask] / means.sds[:, None]
    normal = weighted.T @ weighted + ties + np.diag(1 / spread**2)
    right = weighted.T @ (means.values / means.sds) + ties @ mean + mean / spread**2
    factor = cho_factor(normal)
    covariance = cho_solve(factor, np.eye(len(normal)))
    return cho_solve(factor, right), np.sqrt(np.diag(covariance))


def wall_about(
    pit: PitDepth,
    bursts: Sequence[Burst],
    probe: CalibratedProbe,
    centre: tuple[float, float],
    diameter: float,
    *,
    seen: Callable[[Patch], FloatArray] | None = None,
) -> DepthMap:
    """Map the depth of the wall about a pit.

    ``pit``: measured pit; ``centre``: phi and z of the mouth by the camera; ``diameter``: of the
    mouth by the camera, in metres; ``seen``: returns the logarithm (rows, columns) of the image of
    a patch.
    """
    patch = Patch.around(pit.phi, pit.z, size=PATCH, radius=probe.radius)
    image = None if seen is None else seen(patch)
    outline = None if image is None else outline_of(image, patch, centre, diameter)
    echoes = mean_depths(bursts, probe, patch, pit) if np.isfinite(pit.depth) else None
    return fuse(pit, echoes, patch, image=image, outline=outline)

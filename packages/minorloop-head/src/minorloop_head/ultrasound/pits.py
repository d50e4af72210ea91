"""Depth of a pit from a raster of echoes about its place in the image.

A floor beyond the measured depths is detected by an echo after the window of the fit; a mouth is a
through-hole if it returns no echo of any time or shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from minorloop.arrays import FloatArray, as_finite, as_whole
from minorloop.errors import ParameterError
from minorloop.threads import one_thread
from minorloop_head.geometry import wall_point
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.field import HIGHEST, LOWEST, CalibratedProbe, ComplexArray
from minorloop_head.ultrasound.joint_fit import (
    CENTRE,
    DEPTHS,
    MOST_UNKNOWN,
    PRIOR,
    STRANGE,
    JointFit,
    JointSolution,
    bent_fit,
    best_fit,
    floor_gains_nothing,
    is_bent,
    moves,
    renewed,
    resolve_ambiguity,
    solve_without_floor,
)
from minorloop_head.ultrasound.pit_model import PitModel
from minorloop_head.ultrasound.spectra import (
    FEW,
    LEAD,
    WINDOW,
    coverage_fault,
    rejections,
    spectra_of,
    tapered,
    usable_bursts,
)
from minorloop_head.ultrasound.wall_shape import FARTHEST

_TIMES: FloatArray = np.arange(-0.5e-6, 2.3e-6, 0.05e-6)
"""Times at which the residual is tested, in seconds after the echo of the wall."""
_SPAN = 8
"""Number of these times in one window, whose power is compared with that of noise."""
_LATE = 0.19e-6
"""Least time of a late window, in seconds."""
_LATE_SURE, _EARLY_SURE, _EARLY_SHARE = 4.0, 5.0, 1e-3
"""Largest residual of a hole late and early, in deviations of the noise (at most 3.7 late in 50
scans of holes); and the share of the missing echo that chamfered edges may return early."""
_DETECTED, ABSENT, UNDECIDED = "detected", "absent", "undecided"
_WINDOWS = ((1.6e-6, 1.3e-3, 2.7e-3), (3.2e-6, 2.6e-3, 4.1e-3))
"""Start of each later window, in seconds after the usual one, and its range of depths in metres."""
_STEP = 0.01e-3
_SURE, _GAIN = 25.0, 0.15
"""Least cost over the noise, and least gain of a flat floor, for a detected floor. By noise alone,
the best of some 280 depths reaches a cost of about 6."""
_USUAL_GAIN, _COULD = 0.5, 15.0
"""Gain of a poor floor, and least cost that it would have, for its absence to be certain."""
POINTS, PITCH = 6, 0.32e-3
"""Points in a row of a raster, which cover the largest pit and wall beside it, and metres between
them, a third of the footprint of the beam."""
FEWEST = 16
"""Fewest bursts for a depth."""
DEEPEST = 1.25e-3
"""Greatest measured depth, in metres."""
MEASURED, HOLE = "measured", "through-hole"
DEEPER, SILENT = "deeper than 1.25 mm", "no floor echo"
NO_PIT, _FAINT = "no pit", "too faint"
_NEAR_DEEPEST = 1e-3
UNEVEN, DISTURBED, AMBIGUOUS = "uneven floor", "disturbed", "ambiguous depth"
ASTRAY = "distances disagree"
_NOTICED, _HOPELESS, _NOTICEABLE = 0.05, 1.15, 3.0
"""Least advantage of a pit over a plain wall, as a share of the cost; cost, over that of a plain
wall, above which no fit is tried; and multiple of the first that a mouth would take from the echo,
for its absence to be certain."""
_OPEN, _UNEVEN = 0.1, 0.6
"""Gain below which there is no floor, and below which it is uneven."""
# Errors that the curvature of the cost does not contain, calibrated on separate scans: chamfered
# mouths and waves outside of the modes, the aim of the beam, the size of the spot. That of the
# speed of sound is added to them.
_WIDER, _UNMODELLED = 2.0, 2.5e-6
_FLAT = 0.02e-3
_POINTING, _SIZE = 34e-6, 0.018
_STRAINED = 2.5
"""Least difference in prior deviations between fitted size and image that shows another echo; the
outline of the camera is used then."""
_WIDE, _WIDEST = 0.1e-3, 0.05e-3
"""Standard deviation of the depth of an uneven floor, and the largest one of a flat floor, in
metres."""
_LOUDEST = 1.3
"""Largest possible echo of a floor, over that of a flat one."""
_ASTRAY = 6e-6
"""Largest disagreement of distances and angles, in metres; 3e-6 is usual."""
_MOST = 100_000
"""Most planned bursts: a bound against typing errors. A raster has 36 points."""


@dataclass(frozen=True)
class PitDepth:
    """Depth of a pit by ultrasound, with a verdict."""

    verdict: str
    """``measured``; ``deeper than 1.25 mm`` (there is an echo of a floor beyond the measured
    depths); ``through-hole`` (no echo out of the mouth, down to the thickness of the wall); ``no
    floor echo`` (no floor, but another echo; or noise or the end of the traces would hide it);
    ``uneven floor`` (it does not echo as a flat one: the depth is a mean, with a wide band);
    ``disturbed`` (something beside the mouth, such as a bead, echoes too: the outline is that of
    the camera, the band wide); ``ambiguous depth`` (another depth explains nearly as much, or the
    floor is louder than possible); ``no pit`` (a plain wall explains all); or the reason why there
    is no depth: ``too faint`` (noise would hide a pit), ``too few echoes``, ``no coupling``,
    ``distances disagree`` (the distances of the wall do not fit a smooth wall where it should be: a
    head that does not move, shots out of time, a bead beside it, water that warms during the scan,
    or sound that is 4 % too fast or slow), ``too short`` (traces end before the echo of a floor),
    ``raster too small`` (no point on the wall beside the mouth), ``part missing`` (of the scan:
    mouth or wall is not covered), ``raster beside the mouth``, ``all at one place``, ``frozen``
    (the same trace again), and the verdicts of ``Burst``."""
    phi: float
    z: float
    """Centre, in radians and metres."""
    diameter: float = np.nan
    depth: float = np.nan
    """In metres; NaN where not measured."""
    place_sd: float = np.nan
    diameter_sd: float = np.nan
    depth_sd: float = np.nan
    """Standard deviations, in metres; that of the place holds for either direction."""
    gain: float = np.nan
    """Echo of the floor over that of a flat one."""
    tilt: tuple[float, float] = (0.0, 0.0)
    """Slopes of the floor around and along the pipe."""
    dish: float = np.nan
    """Depth of the middle of the floor below its mean, in metres."""
    bursts: int = 0
    planned: int = 0
    """Numbers of used and of planned bursts."""

    @property
    def measured(self) -> bool:
        """Whether there is a reliable depth."""
        return self.verdict == MEASURED

    @property
    def whole(self) -> bool:
        """Whether the scan is complete."""
        return 0 < self.bursts >= self.planned


def raster(
    probe: CalibratedProbe,
    centre: tuple[float, float],
    *,
    points: int = POINTS,
    pitch: float = PITCH,
) -> FloatArray:
    """Return pan and tilt (points^2, 2) of a serpentine raster about a place, in radians.

    ``probe``: the probe and how it is mounted; ``centre``: phi and z; ``points``: points in a row;
    ``pitch``: between points, in metres.
    """
    steps = (np.arange(points) - (points - 1) / 2) * pitch
    aims = []
    for row, x in enumerate(steps):
        for y in steps if row % 2 == 0 else steps[::-1]:
            place = wall_point(centre[0] + x / probe.radius, centre[1] + y, probe.radius)
            aims.append(probe.transducer.aim(probe.mount, place))
    return np.array(aims)


@one_thread()
def measure_pit(
    bursts: Sequence[Burst],
    probe: CalibratedProbe,
    centre: tuple[float, float],
    diameter: float,
    *,
    planned: int | None = None,
) -> PitDepth:
    """Measure the depth of a pit from the bursts of a raster, whole or interrupted.

    There is no depth where the echoes contain none; the verdict says why.

    Raises a `ParameterError` if the diameter is not positive, the centre is not finite, or fewer
    bursts were planned than are given.

    ``bursts``: as ``average`` returns them; those with a verdict are left out. ``probe``: the probe
    in its pipe. ``centre``: phi and z of the mouth in the image. ``diameter``: of the mouth in the
    image, in metres. ``planned``: number of bursts of the whole raster if the scan was interrupted;
    that of ``bursts`` without it.
    """
    if not as_finite("diameter of a mouth", diameter) > 0:
        raise ParameterError(f"a mouth of {diameter} m; give a positive diameter")
    place = as_finite("phi of a mouth", centre[0]), as_finite("z of a mouth", centre[1])
    given = len(bursts)
    many = given if planned is None else as_whole("bursts planned", planned, max(given, 1), _MOST)
    good = usable_bursts(bursts)
    reason = _too_few(bursts, good)
    if not reason:
        reason = coverage_fault(good, probe, place, diameter, whole=len(good) >= many)
    found = PitDepth(reason, *place) if reason else _measured(good, probe, place, diameter)
    return replace(found, bursts=len(good), planned=many)


def _measured(
    good: Sequence[Burst], probe: CalibratedProbe, centre: tuple[float, float], diameter: float
) -> PitDepth:
    spectra = spectra_of(good, probe, centre)
    if spectra is None:
        return PitDepth("no coupling", *centre)
    fit = JointFit(PitModel(probe, spectra.angles, centre, diameter / 2), spectra)
    # Without a lens all traces contain the mouth, and none shows the wall alone.
    if np.isfinite(probe.transducer.focus):
        if is_bent(fit, _ASTRAY):
            bent = bent_fit(good, fit) if moves(good) else None
            if bent is None:
                return PitDepth(ASTRAY, *centre)
            fit = bent
        far = fit.model.shape is None and abs(fit.distance) > FARTHEST
        if far or fit.range_error > _ASTRAY or fit.unknown > MOST_UNKNOWN:
            return PitDepth(ASTRAY, *centre)
    start, costs = CENTRE.copy(), fit.sweep(CENTRE, DEPTHS)
    if costs.min() > _HOPELESS * fit.cost_of(fit.model.plain):
        return PitDepth(_no_pit_or_faint(fit, JointSolution(start, float(costs.min()))), *centre)
    start[3] = DEPTHS[np.argmin(costs)]
    best, ambiguous = resolve_ambiguity(fit, best_fit(fit, start))
    if fit.model.shape is not None:
        fit = renewed(fit, best.unknowns)
        best = fit.solve(best.unknowns)
    return _assessed(fit, best, ambiguous, good)


def _too_few(bursts: Sequence[Burst], good: Sequence[Burst]) -> str:
    """Return why there are too few usable bursts for a depth, or an empty string."""
    if len(good) >= FEWEST:
        return ""
    reasons = [reason for reason in rejections(bursts) if reason]
    return max(set(reasons), key=reasons.count) if len(reasons) > len(good) else FEW


def _assessed(
    fit: JointFit, best: JointSolution, ambiguous: bool, bursts: Sequence[Burst]
) -> PitDepth:
    """Return the verdict on a fit, with the values that are certain enough."""
    probe, centre = fit.model.probe, fit.model.centre
    disturbed = abs(best.unknowns[2]) > _STRAINED * PRIOR[2]
    hole = solve_without_floor(fit, best)
    verdict, depth_sd = _verdict(fit, best, hole.cost)
    ambiguous = ambiguous or best.unknowns[4] > _LOUDEST
    if disturbed and verdict in (MEASURED, UNEVEN):
        verdict, depth_sd = DISTURBED, _WIDE
    elif ambiguous and verdict == MEASURED:
        verdict, depth_sd = AMBIGUOUS, np.nan
    verdict = _if_deeper(fit, best, verdict, bursts)
    if verdict == HOLE and not is_through_hole(fit, hole):
        verdict = SILENT
    if verdict in (DEEPER, SILENT):
        depth_sd = np.nan
    if verdict == DISTURBED:
        best = _with_outline_of_camera(fit, best)
    x, y, size, depth, gain, u, v, dish = best.unknowns
    faster, faster_sd = fit.speed_error
    depth, depth_sd = depth * (1 + faster), float(np.hypot(depth_sd, depth * faster_sd))
    sd = PRIOR if verdict == DISTURBED else fit.deviations(best.unknowns)
    mouth = 2 * fit.model.radius * np.exp(size)
    return PitDepth(
        verdict,
        float(centre[0] + x / probe.radius),
        float(centre[1] + y),
        float(mouth),
        depth=float(depth) if np.isfinite(depth_sd) else np.nan,
        place_sd=float(np.hypot(np.hypot(sd[0], sd[1]) / np.sqrt(2), _POINTING)),
        diameter_sd=float(mouth * np.hypot(sd[2], _SIZE)),
        depth_sd=depth_sd,
        gain=float(gain),
        tilt=(float(u), float(v)),
        dish=float(dish),
    )


def _if_deeper(fit: JointFit, best: JointSolution, verdict: str, bursts: Sequence[Burst]) -> str:
    """Return the verdict, or that the floor is too deep to be measured, or not detected."""
    if verdict in (NO_PIT, _FAINT):
        return verdict
    gain = best.unknowns[4]
    if verdict != HOLE and best.unknowns[3] > DEEPEST:
        return DEEPER
    strange = best.cost > STRANGE * fit.usual_cost and best.unknowns[3] > _NEAR_DEEPEST
    if verdict == HOLE or not _UNEVEN <= gain <= _LOUDEST or strange:
        floor = detect_deep_floor(fit, best.unknowns, bursts)
        if floor == _DETECTED:
            return DEEPER
        return SILENT if verdict == HOLE and floor == UNDECIDED else verdict
    return verdict


def _with_outline_of_camera(fit: JointFit, best: JointSolution) -> JointSolution:
    """Return the fit with the outline of the image and a flat floor."""
    start, prior = best.unknowns.copy(), PRIOR.copy()
    start[:3], start[5:] = 0.0, 0.0
    prior[:3], prior[5:] = PRIOR[:3] / 10, PRIOR[5:] / 10
    return fit.solve(start, prior=prior)


def _verdict(fit: JointFit, best: JointSolution, hole: float) -> tuple[str, float]:
    """Return a verdict and the standard deviation of the depth, NaN if there is none."""
    gain, raw_sd = best.unknowns[4], float(fit.deviations(best.unknowns)[3])
    plain = fit.cost_of(fit.model.plain)
    if plain < (1 + _NOTICED) * best.cost:
        return _no_pit_or_faint(fit, best), np.nan
    if gain < _OPEN or floor_gains_nothing(best, hole):
        return HOLE, np.nan
    # The echo of a floor that is not flat weighs its middle and its rim differently.
    bent = max(abs(float(best.unknowns[7])) - _FLAT, 0.0)
    depth_sd = float(np.sqrt((_WIDER * raw_sd) ** 2 + _UNMODELLED**2 + bent**2 + fit.unknown**2))
    return (UNEVEN, _WIDE) if gain < _UNEVEN or depth_sd > _WIDEST else (MEASURED, depth_sd)


def _no_pit_or_faint(fit: JointFit, best: JointSolution) -> str:
    """Return ``no pit`` if a mouth would have been noticed, else ``too faint``."""
    model, (x, y, size) = fit.model, best.unknowns[:3]
    lost = fit.pulse * model.missing(model.mouth(x, y, size), size)
    power = 0.5 * np.abs(lost / fit.spectra.noise[model.near, None]) ** 2
    return NO_PIT if power.sum() > _NOTICEABLE * _NOTICED * best.cost else _FAINT


def last_window_end(thickness: float) -> float:
    """Return the end of the last window, in seconds after the echo of the wall."""
    needed = [after for after, low, _ in _WINDOWS if low < thickness]
    return max(needed, default=0.0) + WINDOW - LEAD


def detect_deep_floor(fit: JointFit, unknowns: FloatArray, bursts: Sequence[Burst]) -> str:
    """Return whether there is a floor between the greatest measured depth and the outer wall.

    It is ``detected``; ``absent``; or ``undecided``, if the traces end too early, or noise would
    hide a floor with half of the echo of a flat one.

    ``fit``: of the same bursts. ``unknowns`` (8,): of its solution; only the outline is used.
    ``bursts``: usable ones.

    Notes
    -----
    At each depth, the gain of a flat floor by least squares over all traces near the mouth is
    compared with the noise.
    """
    model, probe = fit.model, fit.model.probe
    latest = float(model.spots[:, 2].max()) * 2 / probe.speed + last_window_end(probe.thickness)
    if min(burst.trace.size * burst.sample_interval for burst in bursts) < latest:
        return UNDECIDED
    verdict = ABSENT
    for after, low, high in _WINDOWS:
        depths = np.arange(low, min(high, probe.thickness), _STEP)
        if depths.size == 0:
            continue
        gains, power = _gains(fit, unknowns, bursts, depths, after)
        if bool(((gains > _GAIN) & (0.5 * gains**2 * power > _SURE)).any()):
            return _DETECTED
        if 0.5 * _USUAL_GAIN**2 * float(power.min()) < _COULD:
            verdict = UNDECIDED
    return verdict


def _gains(
    fit: JointFit, unknowns: FloatArray, bursts: Sequence[Burst], depths: FloatArray, after: float
) -> tuple[FloatArray, FloatArray]:
    """Return the gain (D,) of a floor at each depth, and the power (D,) of a flat one."""
    model, (x, y, size) = fit.model, unknowns[:3]
    spectra = spectra_of(bursts, model.probe, model.centre, after=after)
    if spectra is None:
        return np.zeros(depths.size), np.zeros(depths.size)
    near = model.near
    squares = model.squares(model.mouth(x, y, size), size, (0.0, 0.0), 0.0)
    pulse = fit.pulse * np.exp(2j * model.sound.wavenumbers * fit.shift[near, None])
    expected = pulse * model.floors(squares, size, depths)
    weight = 1 / spectra.noise[near, None] ** 2
    common = (np.conj(expected) * spectra.received[near] * weight).real.sum(axis=(1, 2))
    power: FloatArray = (np.abs(expected) ** 2 * weight).sum(axis=(1, 2))
    return common / np.maximum(power, 1e-12), power


def is_through_hole(fit: JointFit, hole: JointSolution) -> bool:
    """Return whether the residual of a mouth without a floor is noise alone.

    ``fit``: of the traces; ``hole``: its solution without a floor.

    Notes
    -----
    The power of the residual in windows of 0.4 us is compared with that of noise; each trace is
    weighted by the echo that the mouth removes. A floor that scatters, or is too uneven for the
    fit, leaves a late residual; a bead or a smooth dimple changes the early echo of the wall.
    """
    model, (x, y, size) = fit.model, hole.unknowns[:3]
    echoes = model.echo(hole.unknowns)
    fit.cost_of(echoes)
    residual = _power(fit, fit.residual(echoes))
    taken = np.zeros_like(fit.spectra.received)
    taken[model.near] = model.missing(model.mouth(x, y, size), size)
    lost = _power(fit, fit.pulse * taken).sum(axis=1)
    share = lost / max(float(lost.max()), 1e-12)
    usual = np.interp(_TIMES, WINDOW * np.linspace(0, 1, 512) - LEAD, tapered(512) ** 2)
    # The median of the power of noise gives its mean, even if a few traces contain echoes.
    usual *= np.median(residual / usual) / np.log(2)
    excess = _windows(share @ (residual - usual))
    samples = (_TIMES[1] - _TIMES[0]) * (HIGHEST - LOWEST)
    sure = excess / np.sqrt(_windows(usual**2) * (share**2).sum() / samples)
    late = _TIMES[: excess.size] > _LATE
    early = (sure > _EARLY_SURE) & (excess > _EARLY_SHARE * float(share @ lost))
    return not (early[~late].any() or (sure[late] > _LATE_SURE).any())


def _windows(values: FloatArray) -> FloatArray:
    return np.convolve(values, np.ones(_SPAN), mode="valid")


def _power(fit: JointFit, spectra: ComplexArray) -> FloatArray:
    """Return the power (K, times) of spectra over the mean power of their noise."""
    frequencies = fit.model.sound.wavenumbers * fit.model.probe.speed / (2 * np.pi)
    traces = spectra @ np.exp(-2j * np.pi * frequencies[:, None] * _TIMES)
    power: FloatArray = np.abs(traces) ** 2 / (
        2 * len(frequencies) * fit.spectra.noise[:, None] ** 2
    )
    return power

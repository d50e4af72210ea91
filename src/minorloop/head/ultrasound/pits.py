"""The depth of a pit from a raster of echoes about the place where the camera saw it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from minorloop.arrays import FloatArray, as_finite, as_whole
from minorloop.errors import ParameterError
from minorloop.head.geometry import wall_point
from minorloop.head.ultrasound import deep_pit
from minorloop.head.ultrasound.burst_checks import FEW, reasons_of, too_little, usable
from minorloop.head.ultrasound.deep_pit import FURTHER
from minorloop.head.ultrasound.echoes import Burst
from minorloop.head.ultrasound.field import CalibratedProbe
from minorloop.head.ultrasound.joint_fit import CENTRE, PRIOR, JointFit, JointSolution
from minorloop.head.ultrasound.pit_model import PitModel
from minorloop.head.ultrasound.pit_search import (
    DEPTHS,
    STRANGE,
    best_fit,
    gains_nothing,
    surest,
    without_floor,
)
from minorloop.head.ultrasound.spectra import spectra_of
from minorloop.head.ultrasound.through_hole import is_open
from minorloop.threads import one_thread

POINTS, PITCH = 6, 0.32e-3
"""Of a raster: points in a row, which cover the largest pit that is measured and wall beside it,
and metres between them, a third of the footprint of the beam."""
FEWEST = 16
"""Bursts without which no depth is given."""
DEEPEST = 1.25e-3
"""Depth up to which one is given, in metres."""
MEASURED, HOLE = "measured", "through-hole"
DEEPER, SILENT = "deeper than 1.25 mm", "no floor heard"
NO_PIT, FAINT = "no pit", "too faint"
_NEAR_DEEPEST = 1e-3
UNEVEN, DISTURBED, AMBIGUOUS = "uneven floor", "disturbed", "ambiguous depth"
ASTRAY = "distances disagree"
_NOTICED, _HOPELESS, _NOTICEABLE = 0.05, 1.15, 3.0
"""How much better than a plain wall a pit must explain the traces; how much worse, before any
fit, that none is tried; and how many times the first a mouth must take, for it to be missed."""
_OPEN, _UNEVEN = 0.1, 0.6
# What the curvature of the misfit does not tell, calibrated on scans of its own: broken edges of
# the mouth and waves that the modes leave out, the aim of the beam, the size of the spot.
_WIDER, _UNMODELLED = 2.0, 3.1e-6
_FLAT = 0.02e-3
_POINTING, _SIZE = 34e-6, 0.018
_STRAINED = 2.5
"""Prior deviations of the size, off what the camera saw, from which on the echoes are those of
something else too, and the outline of the camera is kept."""
_WIDE, _WIDEST = 0.1e-3, 0.05e-3
"""Standard deviation of the depth of a floor that is not flat, and up to which one counts as flat
enough, in metres."""
_LOUD = 1.3
"""Echo of a floor, over that of a flat one, beyond which none can be."""
_ASTRAY = 6e-6
"""How far distances may be off the angles, in metres: 3e-6 is usual, more with worse sensors."""
_MOST = 100_000


@dataclass(frozen=True)
class PitDepth:
    """What the echoes tell of a pit.

    Parameters
    ----------
    verdict : str
        ``measured``; ``deeper than 1.25 mm`` (a floor is heard where depths are no longer
        measured); ``through-hole`` (nothing at all comes back out of the mouth, down to the
        thickness of the wall); ``no floor heard`` (no floor, but something else comes back, or
        none would be heard for noise or because traces end too early);
        ``uneven floor`` (heard, but not as a flat one: the depth is a mean, with a wide band);
        ``disturbed`` (something beside the mouth, such as a bead, echoes too: the outline is the
        camera's, the band wide); ``ambiguous depth`` (another depth explains nearly as much, or
        the floor is louder than any can be); ``no pit`` (a plain wall explains all); or why there
        is no depth: ``too faint`` (noise would hide a pit), ``too few echoes``, ``no coupling``,
        ``distances disagree`` (the wall is not as far from place to place as the angles say: a
        head that does not move, shots out of time, or a bent wall), ``too short`` (traces end
        before a floor would be heard), ``raster too small`` (nothing of it falls on the wall
        beside the mouth), ``part missing`` (of the scan, so that mouth or wall is not covered),
        ``raster beside the mouth``, ``all at one place``, ``frozen`` (the same trace again and
        again), and words of ``Burst``.
    phi, z : float
        Centre, in radians and metres.
    diameter, depth : float
        In metres; NaN where not measured.
    place_sd, diameter_sd, depth_sd : float
        Standard deviations, in metres; that of the place is along either direction.
    gain : float
        Echo of the floor over that of a flat one.
    tilt : (float, float)
        Slopes of the floor around and along the pipe.
    dish : float
        How much deeper the middle of the floor is than its mean, in metres.
    bursts, planned : int
        How many were used, and how many were to be.
    """

    verdict: str
    phi: float
    z: float
    diameter: float = np.nan
    depth: float = np.nan
    place_sd: float = np.nan
    diameter_sd: float = np.nan
    depth_sd: float = np.nan
    gain: float = np.nan
    tilt: tuple[float, float] = (0.0, 0.0)
    dish: float = np.nan
    bursts: int = 0
    planned: int = 0

    @property
    def measured(self) -> bool:
        """Whether there is a depth to rely on."""
        return self.verdict == MEASURED

    @property
    def whole(self) -> bool:
        """Whether there is a scan, and nothing of it is missing."""
        return 0 < self.bursts >= self.planned


def raster(
    ear: CalibratedProbe, centre: tuple[float, float], *, points: int = POINTS, pitch: float = PITCH
) -> FloatArray:
    """Pan and tilt (points^2, 2), in radians, of a raster about a place, row by row and back.

    Parameters
    ----------
    ear : CalibratedProbe
        The probe and how it is mounted.
    centre : (float, float)
        Phi and z.
    points : int
        In a row.
    pitch : float
        Between points, in metres.
    """
    steps = (np.arange(points) - (points - 1) / 2) * pitch
    aims = []
    for row, x in enumerate(steps):
        for y in steps if row % 2 == 0 else steps[::-1]:
            place = wall_point(centre[0] + x / ear.radius, centre[1] + y, ear.radius)
            aims.append(ear.probe.aim(ear.mount, place))
    return np.array(aims)


@one_thread()
def measure_pit(
    bursts: Sequence[Burst],
    ear: CalibratedProbe,
    centre: tuple[float, float],
    diameter: float,
    *,
    planned: int | None = None,
) -> PitDepth:
    """Measure the depth of a pit from the bursts of a raster, whole or interrupted.

    Parameters
    ----------
    bursts : sequence of Burst
        As ``average`` made them; those with a verdict are left out.
    ear : CalibratedProbe
        The probe and what is known of the pipe.
    centre : (float, float)
        Of the mouth as the camera saw it, phi and z.
    diameter : float
        Of the mouth as the camera saw it, in metres.
    planned : int, optional
        Bursts of the whole raster, where a scan was interrupted; without it, those given.

    Returns
    -------
    PitDepth
        With a verdict; no depth is made up where the echoes do not hold one.

    Raises
    ------
    ParameterError
        If the diameter is not a positive number, the centre is not finite, or fewer bursts were
        planned than are given.
    """
    if not as_finite("diameter of a mouth", diameter) > 0:
        raise ParameterError(f"a mouth of {diameter} m; give a positive diameter")
    place = as_finite("phi of a mouth", centre[0]), as_finite("z of a mouth", centre[1])
    given = len(bursts)
    many = given if planned is None else as_whole("bursts planned", planned, max(given, 1), _MOST)
    good = usable(bursts)
    nothing = _too_few(bursts, good)
    if not nothing:
        nothing = too_little(good, ear, place, diameter, whole=len(good) >= many)
    found = PitDepth(nothing, *place) if nothing else _measured(good, ear, place, diameter)
    return replace(found, bursts=len(good), planned=many)


def _measured(
    good: Sequence[Burst], ear: CalibratedProbe, centre: tuple[float, float], diameter: float
) -> PitDepth:
    spectra = spectra_of(good, ear, centre)
    if spectra is None:
        return PitDepth("no coupling", *centre)
    fit = JointFit(PitModel(ear, spectra.angles, centre, diameter / 2), spectra)
    # Without a lens all traces hear the mouth, and none tells the wall alone.
    if np.isfinite(ear.probe.focus) and fit.strayed > _ASTRAY:
        return PitDepth(ASTRAY, *centre)
    start, costs = CENTRE.copy(), fit.sweep(CENTRE, DEPTHS)
    if costs.min() > _HOPELESS * fit.cost_of(fit.model.plain):
        return PitDepth(_if_noticed(fit, JointSolution(start, float(costs.min()))), *centre)
    start[3] = DEPTHS[np.argmin(costs)]
    return _judged(fit, *surest(fit, best_fit(fit, start)), good)


def _too_few(bursts: Sequence[Burst], good: Sequence[Burst]) -> str:
    """Why there are too few usable bursts for a depth, or nothing."""
    if len(good) >= FEWEST:
        return ""
    reasons = [reason for reason in reasons_of(bursts) if reason]
    return max(set(reasons), key=reasons.count) if len(reasons) > len(good) else FEW


def _judged(
    fit: JointFit, best: JointSolution, ambiguous: bool, bursts: Sequence[Burst]
) -> PitDepth:
    """The verdict on a fit, with what of it can be told."""
    ear, centre = fit.model.ear, fit.model.centre
    disturbed = abs(best.unknowns[2]) > _STRAINED * PRIOR[2]
    hole = without_floor(fit, best)
    verdict, depth_sd = _verdict(fit, best, hole.cost)
    ambiguous = ambiguous or best.unknowns[4] > _LOUD
    if verdict == MEASURED and (disturbed or ambiguous):
        verdict, depth_sd = (DISTURBED, _WIDE) if disturbed else (AMBIGUOUS, np.nan)
    verdict = _if_deeper(fit, best, verdict, bursts)
    if verdict == HOLE and not is_open(fit, hole):
        verdict = SILENT
    if verdict in (DEEPER, SILENT):
        depth_sd = np.nan
    if verdict == DISTURBED:
        best = _as_seen(fit, best)
    x, y, size, depth, gain, u, v, dish = best.unknowns
    sd = PRIOR if verdict == DISTURBED else fit.deviations(best.unknowns)
    mouth = 2 * fit.model.radius * np.exp(size)
    return PitDepth(
        verdict,
        float(centre[0] + x / ear.radius),
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
    """The verdict, or that the floor is deeper than is measured, or that none can be told."""
    if verdict in (NO_PIT, FAINT):
        return verdict
    gain = best.unknowns[4]
    if verdict != HOLE and (best.unknowns[3] > DEEPEST or _further(fit, best)):
        return DEEPER
    strange = best.cost > STRANGE * fit.usual_cost and best.unknowns[3] > _NEAR_DEEPEST
    if verdict == HOLE or not _UNEVEN <= gain <= _LOUD or strange:
        floor = deep_pit.deep_floor(fit, best.unknowns, bursts)
        if floor == deep_pit.HEARD:
            return DEEPER
        return SILENT if verdict == HOLE and floor == deep_pit.UNTOLD else verdict
    return verdict


def _further(fit: JointFit, best: JointSolution) -> bool:
    """Whether the floor found, or a flat one, would fit better deeper than is measured."""
    flat = best.unknowns.copy()
    flat[4:] = [1.0, 0.0, 0.0, 0.0]
    near = best.unknowns[3] > _NEAR_DEEPEST
    return any(
        fit.sweep(unknowns, FURTHER).min() < best.cost
        for unknowns in ([best.unknowns, flat] if near else [best.unknowns])
    )


def _as_seen(fit: JointFit, best: JointSolution) -> JointSolution:
    """The fit with the outline that the camera saw, and a flat floor."""
    start, prior = best.unknowns.copy(), PRIOR.copy()
    start[:3], start[5:] = 0.0, 0.0
    prior[:3], prior[5:] = PRIOR[:3] / 10, PRIOR[5:] / 10
    return fit.solve(start, prior=prior)


def _verdict(fit: JointFit, best: JointSolution, hole: float) -> tuple[str, float]:
    """A verdict and the standard deviation of the depth, NaN where there is none."""
    gain, raw_sd = best.unknowns[4], float(fit.deviations(best.unknowns)[3])
    plain = fit.cost_of(fit.model.plain)
    if plain < (1 + _NOTICED) * best.cost:
        return _if_noticed(fit, best), np.nan
    if gain < _OPEN or gains_nothing(best, hole):
        return HOLE, np.nan
    # What a floor that is not flat returns weighs its middle and its rim in its own way.
    bent = max(abs(float(best.unknowns[7])) - _FLAT, 0.0)
    depth_sd = float(np.sqrt((_WIDER * raw_sd) ** 2 + _UNMODELLED**2 + bent**2))
    return (UNEVEN, _WIDE) if gain < _UNEVEN or depth_sd > _WIDEST else (MEASURED, depth_sd)


def _if_noticed(fit: JointFit, best: JointSolution) -> str:
    """That there is no pit, if the mouth of one would have been noticed."""
    model, (x, y, size) = fit.model, best.unknowns[:3]
    gone = fit.pulse * model.missing(model.mouth(x, y, size), size)
    power = 0.5 * np.abs(gone / fit.spectra.noise[model.near, None]) ** 2
    return NO_PIT if power.sum() > _NOTICEABLE * _NOTICED * best.cost else FAINT

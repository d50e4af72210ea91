"""Fit the traces of a raster where the wall about the pit is bent, as in or beside a dent."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.ultrasound.echoes import DEAD_TIME, Burst, Pulse, matched
from minorloop_head.ultrasound.joint_fit import CENTRE, JointFit
from minorloop_head.ultrasound.pit_model import PitModel
from minorloop_head.ultrasound.spectra import Spectra, first_echo, least_deviations
from minorloop_head.ultrasound.wall_shape import WallShape, changes_in_time, smooth_shape

BESIDE = 0.1e-3
"""Distance from the rim from which on the wall gives most of an echo, in metres: half the beam is
within 0.12 mm of its axis."""
FEWEST = 10
"""Fewest distances that give a shape."""
MOST_UNKNOWN = 15e-6
"""Largest standard deviation of the wall at the rim, in metres, with which a depth is given."""
_STEEP = 0.02
"""Slope of the wall from which on it is fitted as bent: four times that by the error of the
pivot."""
_ROUNDS = 3
"""Renewals of a shape: from the second on, it changes by less than a distance errs."""
_EQUAL, _STILL = 5.0, 0.5
"""Largest correlation of the difference of two traces with a pulse, in deviations of the noise, up
to which they are equal: noise alone reaches it once in some thousand pairs; and share of pairs in a
row that may be: traces of a head that does not move are equal, and show no bent wall."""
_ASTRAY = 0.1e-3
"""Distance of a first echo from a curved wall in metres from which on it is that of something else:
dents from which echoes return are within 0.05 mm of one."""


def is_bent(fit: JointFit, most: float) -> bool:
    """Return whether the wall is steep, or its distances differ from a plane by more than most."""
    off = fit.model.off()
    plane = np.linalg.lstsq(np.column_stack([np.ones(len(off)), off]), fit.spectra.beyond)[0]
    return bool(np.hypot(*plane[1:]) > _STEEP or fit.range_error > most)


def moves(bursts: Sequence[Burst]) -> bool:
    """Return whether the traces of a raster differ by more than noise, as those of places do."""
    equal = []
    for one, other in pairwise(bursts):
        interval, noise = one.sample_interval, np.hypot(one.noise, other.noise)
        change = np.abs(matched(one.trace - other.trace, interval, Pulse()))
        equal.append(change[int(DEAD_TIME / interval) :].max() < _EQUAL * noise)
    return bool(np.mean(equal) < _STILL)


def bent_fit(bursts: Sequence[Burst], fit: JointFit) -> JointFit | None:
    """Return a fit about a mouth in a bent wall; None where too few bursts show one.

    ``bursts``: usable ones; ``fit``: of them, with a wall that is not bent.

    Notes
    -----
    The first echoes of the bursts beside the mouth give a shape, and the distances at which their
    traces fit the echoes of this shape give a better one. Water that warms during the raster shifts
    echoes too, and shows no bent wall.
    """
    plain, speed = fit.model, fit.model.probe.speed
    expected = 2 * plain.spots[:, 2] / speed
    first = [first_echo(burst, float(t)) for burst, t in zip(bursts, expected, strict=True)]
    ranges = 0.5 * speed * (np.array(first) - expected)
    beside = np.flatnonzero(np.isfinite(ranges) & _beside(plain))
    if beside.size < FEWEST:
        return None
    depths = ranges[beside] * plain.facing[beside]
    x, y = plain.off()[beside].T
    curved = np.stack([np.ones(len(x)), x, y, x * x, x * y, y * y], axis=1)
    sane = np.abs(depths - curved @ least_deviations(curved, depths)) < _ASTRAY
    beside, depths = beside[sane], depths[sane]
    if beside.size < FEWEST or changes_in_time(beside, plain.off()[beside], depths):
        return None
    fit = _fitted(plain, fit.spectra, beside, depths)
    for _ in range(_ROUNDS - 1):
        fit = renewed(fit, _open_mouth())
    return fit


def renewed(fit: JointFit, unknowns: FloatArray) -> JointFit:
    """Return a fit with the shape of the wall by its traces about a pit."""
    model = fit.model
    assert model.shape is not None
    fit.cost_of(model.echo(unknowns))
    beside = fit.far
    assert beside is not None
    depths = model.shape.depth(model.off()[beside]) + fit.shift[beside] * model.facing[beside]
    return _fitted(model, fit.spectra, beside, depths)


def _fitted(
    model: PitModel, spectra: Spectra, beside: npt.NDArray[np.intp], depths: FloatArray
) -> JointFit:
    shape: WallShape = smooth_shape(model.off()[beside], depths)
    bent = PitModel(model.probe, model.angles, model.centre, model.radius, spectra.beyond, shape)
    return JointFit(bent, spectra, far=beside)


def _beside(model: PitModel) -> npt.NDArray[np.bool_]:
    """Return for each trace whether its echo comes from the wall."""
    found: npt.NDArray[np.bool_] = np.linalg.norm(model.off(), axis=1) > model.radius + BESIDE
    return found


def _open_mouth() -> FloatArray:
    """Return the unknowns of a mouth as in the image, without a floor."""
    unknowns = CENTRE.copy()
    unknowns[4] = 0.0
    return unknowns

"""Fit one pit to all traces of a raster at once, from several starts.

Each trace contains echoes of the rim and of the floor of the pit, in shares that depend on the
place of the beam. The pulse is estimated from the traces far from the pit; each trace has a free
distance from the wall, and all share one pit. A waveform also fits when it is shifted by whole half
waves, so that one start is not enough. The wall about the pit may be bent, as in or beside a dent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.ultrasound import _field_kernels as kernels
from minorloop_head.ultrasound.echoes import DEAD_TIME, Burst, Pulse, matched
from minorloop_head.ultrasound.field import ComplexArray, as_parts
from minorloop_head.ultrasound.pit_model import PitModel
from minorloop_head.ultrasound.spectra import FAR, Spectra, first_echo, least_deviations
from minorloop_head.ultrasound.wall_shape import (
    WallShape,
    changes_in_time,
    smooth_shape,
    speed_error,
)

DEPTHS: FloatArray = np.arange(0.08e-3, 1.25e-3, 0.01e-3)
"""Depths of a sweep in metres: from half a wavelength at 10 MHz on, seven per half wavelength."""
_WEAK, STRANGE = 0.3, 1.2
"""Gain below which there may be no floor; and cost over that of noise alone above which a fit is
incomplete."""
_STARTS = 2
_HALF_WAVE = 0.033e-3  # m, half a wave there and back, where another fit may lie
_RIVAL, _AMBIGUOUS = 0.8, 0.87
"""Least shares of the explanation by the best depth with which a second depth is tried too, and
makes the depth ambiguous."""
_APART, _OTHER = 0.02e-3, 0.045e-3
"""Largest differences in m of depths in one dip of the cost, and in one start of the search."""
_CLEAR_GAIN = 20.0
"""Least advantage in cost of the best depth; noise at 4 dB changes the difference by 10."""
_USUAL, _UNSURE = 1.06, 0.88  # times the cost of noise alone; gain of a floor
_DISHES = (0.0, 0.03e-3, 0.05e-3)
_SLOPES = (-0.06, 0.0, 0.06)
"""Initial dishes in metres and slopes of floors in the search: they tilt by up to 4 degrees."""
CENTRE = np.array([0.0, 0.0, 0.0, 0.6e-3, 1.0, 0.0, 0.0, 0.0])
PRIOR = np.array([0.085e-3, 0.085e-3, 0.08, 1e-3, 0.3, 0.05, 0.05, 0.04e-3])
"""Means and standard deviations of the unknowns before the scan, as in ``pit_model.NAMES``: place
and size come from the image."""
# Bounds of the unknowns, steps of finite differences, and largest steps of an iteration.
_LOW = np.array([-4e-4, -4e-4, -0.4, 0.03e-3, 0.0, -0.2, -0.2, -1.5e-4])
_HIGH = np.array([4e-4, 4e-4, 0.4, 1.4e-3, 2.0, 0.2, 0.2, 1.5e-4])
_STEPS = np.array([2e-6, 2e-6, 2e-3, 0.5e-6, 0.01, 1e-3, 1e-3, 0.5e-6])
_LARGEST_STEPS = np.array([6e-5, 6e-5, 0.08, 3e-5, 0.5, 0.05, 0.05, 3e-5])
_SLIP = 12e-6
"""Standard deviation of the distance of a trace from the plane through all, in metres."""
_TRIALS = np.arange(-4 * _SLIP, 4.01 * _SLIP, _SLIP / 3)
"""Initial distances of the search for the best one, in metres."""
_ROUNDS = 8
"""Most Gauss-Newton steps of a fit, by trial."""


@dataclass(frozen=True, eq=False)
class JointSolution:
    """The result of a fit."""

    unknowns: FloatArray
    """Shape (8,). In the order of ``pit_model.NAMES``."""
    cost: float
    """Half the sum of squares over the noise, with less weight for traces that do not fit, plus
    that of the prior."""


@dataclass(eq=False)
class JointFit:
    """A fit of one pit to the traces of a raster."""

    model: PitModel
    """Model of the echoes of the same beams."""
    spectra: Spectra
    """Spectra of the traces."""
    scale: float = 1.0
    """Misfit above which a trace has less weight, in units of its noise."""
    far: npt.NDArray[np.intp] | None = None
    """Traces of plain wall, which give the pulse; without it, the farthest from the pit."""
    pulse: ComplexArray = field(init=False)
    shift: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        far = self.far
        if far is None:
            far = np.argsort(-np.linalg.norm(self.model.off(), axis=1))[:FAR]
        self._k = self.model.sound.wavenumbers
        self._received = as_parts(self.spectra.received)
        self._trial_turns = as_parts(np.exp(2j * self._k * _TRIALS[:, None]))
        self.shift = np.zeros(len(self.spectra.received))
        plain, received = self.model.plain[far], self.spectra.received[far]
        for _ in range(4):
            self.pulse = _pulse(plain, received, self._turn()[far])
            self.shift[far] = self._shifts(self.pulse * plain, far)
        self._far = far
        self._weights = np.ones(len(self.spectra.received))

    @property
    def usual_cost(self) -> float:
        """Cost where the residual is noise alone."""
        count = self.spectra.received.size
        return float(4 * self.scale * np.log1p(1 / (4 * self.scale)) * count)

    @property
    def unknown(self) -> float:
        """Standard deviation of the wall at the rim of the pit, in metres; 0 if it is not bent."""
        shape = self.model.shape
        return 0.0 if shape is None else shape.rim(0.0, 0.0, self.model.radius)[1]

    @property
    def distance(self) -> float:
        """Distance of the wall behind the nominal one by the assumed speed of sound, in metres."""
        return float(np.median(self.spectra.beyond))

    @property
    def speed_error(self) -> tuple[float, float]:
        """Relative error of the assumed speed of sound, and its standard deviation.

        Zeros without a lens: its band of depths is far wider.
        """
        if not np.isfinite(self.model.probe.transducer.focus):
            return 0.0, 0.0
        standoff = float(np.median(self.model.spots[:, 2]))
        bent = 0.0 if self.model.shape is None else self.model.shape.height
        return speed_error(self.distance, standoff, bent)

    @property
    def range_error(self) -> float:
        """Distance of the wall from its plane in the traces that give the pulse, in metres.

        It is the root mean square of the smallest three quarters, so that another pit near by has
        little weight, less the part of the noise.
        """
        far = self._far
        slope = 2 * self._k * np.abs(self.pulse * self.model.plain[far])
        information = (slope**2).sum(axis=1) / self.spectra.noise[far] ** 2
        square = np.sort(
            self._shifts(self.pulse * self.model.plain[far], far) ** 2 - 1 / information
        )
        return float(np.sqrt(max(square[: -(-3 * far.size // 4)].mean(), 0.0)))

    def sweep(self, unknowns: FloatArray, depths: FloatArray) -> FloatArray:
        """Return costs (D,) at evenly spaced depths, with the other unknowns unchanged."""
        x, y, size, _, gain, u, v, dish = unknowns
        pressure = self.model.mouth(x, y, size)
        missing = self.model.missing(pressure, size)
        squares = self.model.squares(pressure, size, (u, v), dish)
        floors = self.model.floors(squares, size, depths)
        return np.array(
            [self.cost_of(self.model.with_pit(missing, gain * floor)) for floor in floors]
        )

    def cost_of(self, model: ComplexArray) -> float:
        """Return the cost of echoes (K, F) with the best shifts, without the prior."""
        self.shift = self._shifts(self.pulse * model, slice(None))
        relative = self._misfit(model) / (4 * self.scale)
        self._weights = 1 / (1 + relative)
        return float(4 * self.scale * np.log1p(relative).sum() * len(self._k))

    def solve(
        self,
        start: FloatArray,
        *,
        centre: FloatArray = CENTRE,
        prior: FloatArray = PRIOR,
        rounds: int = _ROUNDS,
    ) -> JointSolution:
        """Minimise the cost from a start by damped Gauss-Newton steps with Cauchy weights.

        ``start`` (8,): unknowns in the order of ``pit_model.NAMES``; ``centre``, ``prior`` (8,):
        means and standard deviations before the scan; ``rounds``: largest number of steps.
        """
        theta, damping = start.copy(), 1e-3
        model = self.model.echo(theta)
        cost = self.cost_of(model) + _penalty(theta, centre, prior)
        for _ in range(rounds):
            normal, slope = self._normal(theta, model, centre, prior)
            moved = False
            for _ in range(4):
                step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
                trial = np.clip(theta + np.clip(step, -_LARGEST_STEPS, _LARGEST_STEPS), _LOW, _HIGH)
                candidate = self.model.echo(trial)
                new = self.cost_of(candidate) + _penalty(trial, centre, prior)
                if new < cost:
                    moved = True
                    break
                damping *= 8
            if not moved:
                break
            gained, damping = cost - new, damping / 5
            theta, model, cost = trial, candidate, new
            if gained < 1e-3 + 1e-5 * cost:
                break
        return JointSolution(theta, cost)

    def deviations(self, unknowns: FloatArray) -> FloatArray:
        """Return standard deviations (8,) from the curvature of the cost."""
        model = self.model.echo(unknowns)
        self.cost_of(model)
        normal, _ = self._normal(unknowns, model, CENTRE, PRIOR)
        deviations: FloatArray = np.sqrt(np.diag(np.linalg.inv(normal)))
        return deviations

    def refine_pulse(self, unknowns: FloatArray) -> None:
        """Estimate the pulse again, from all traces and the fitted pit."""
        model = self.model.echo(unknowns)
        self.cost_of(model)
        root = (np.sqrt(self._weights) / self.spectra.noise)[:, None]
        self.pulse = _pulse(model * root, self.spectra.received * root, self._turn())

    def _turn(self) -> ComplexArray:
        turn: ComplexArray = np.exp(2j * self._k * self.shift[:, None])
        return turn

    def _shifts(self, model: ComplexArray, which: npt.NDArray[np.intp] | slice) -> FloatArray:
        """Return the best distances (K,) of the traces from the plane."""
        product = np.conj(model) * self.spectra.received[which]
        product = product / self.spectra.noise[which][:, None] ** 2
        shift = np.empty(len(product))
        kernels.best_shifts(as_parts(product), self._k, _TRIALS, self._trial_turns, _SLIP, shift)
        return shift

    def residual(self, model: ComplexArray) -> ComplexArray:
        """Return the spectra less the echoes (K, F), at the present shifts."""
        left: ComplexArray = self.spectra.received - self.pulse * model * self._turn()
        return left

    def _misfit(self, model: ComplexArray) -> FloatArray:
        """Return the mean square residual (K,) over the noise, at the present shifts."""
        power, expected = np.empty(len(model)), as_parts(self.pulse * model)
        kernels.residual_power(self._received, expected, self._k, self.shift, power)
        misfit: FloatArray = power / (2 * self.spectra.noise**2)
        return misfit

    def _normal(
        self, theta: FloatArray, model: ComplexArray, centre: FloatArray, prior: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return normal matrix and right side, with the shift of each trace eliminated."""
        near = self.model.near
        scale = (np.sqrt(self._weights) / self.spectra.noise)[near, None]
        turned = self.pulse * self._turn()[near] * scale
        left = self.spectra.received[near] * scale - model[near] * turned
        slopes = self.model.slopes(theta, _STEPS) * turned  # (P, N, F)
        shifting = 2j * self._k * model[near] * turned
        power = (np.abs(shifting) ** 2).sum(axis=1) + 1 / _SLIP**2
        along = (np.conj(shifting) * slopes).real.sum(axis=2)  # (P, N)
        rest = (np.conj(shifting) * left).real.sum(axis=1)
        flat = np.concatenate([slopes.real, slopes.imag], axis=2).reshape(len(_STEPS), -1)
        normal = flat @ flat.T - (along / power) @ along.T
        right = (np.conj(slopes) * left).real.sum(axis=(1, 2)) - (along / power) @ rest
        right -= (theta - centre) / prior**2
        normal[np.diag_indices(len(theta))] += 1 / prior**2
        return normal, right


def _penalty(theta: FloatArray, centre: FloatArray, prior: FloatArray) -> float:
    return float(0.5 * (((theta - centre) / prior) ** 2).sum())


def _pulse(model: ComplexArray, received: ComplexArray, turn: ComplexArray) -> ComplexArray:
    """Return the pulse (F,) that explains spectra best, by least squares."""
    expected = model * turn
    power = (np.abs(expected) ** 2).sum(axis=0)
    pulse: ComplexArray = (np.conj(expected) * received).sum(axis=0) / power
    return pulse


def best_fit(fit: JointFit, start: FloatArray) -> JointSolution:
    """Return the best solution from several starts."""
    first = fit.solve(start)
    fit.refine_pulse(first.unknowns)
    best = fit.solve(first.unknowns)
    if best.cost < _USUAL * fit.usual_cost and best.unknowns[4] > _UNSURE:
        return best
    flat = best.unknowns.copy()
    flat[4:] = [1.0, 0.0, 0.0, 0.0]
    taken = float(best.unknowns[3])
    slipped = [taken + slip for slip in (-_HALF_WAVE, _HALF_WAVE) if taken + slip > 0.04e-3]
    dips = _dips(fit, flat)
    starts = [_at_depth(flat, depth) for depth in slipped]
    starts += [dip.unknowns for dip in _others(dips, taken, 1.4 * dips[0].cost, _OTHER)]
    starts += _shaped(fit, flat, (0.0,), _DISHES[1:], DEPTHS)[:1]
    best = _better(fit, best, starts)
    gain = best.unknowns[4]
    if gain < _WEAK and _is_through(fit, best):
        return best
    if gain < _UNSURE or best.cost > STRANGE * fit.usual_cost:
        near = DEPTHS[np.abs(DEPTHS - best.unknowns[3]) < 0.125e-3]
        depths = near if gain > 0.5 else DEPTHS
        best = _better(fit, best, _shaped(fit, flat, _SLOPES, _DISHES, depths)[: 2 * _STARTS])
    fit.refine_pulse(best.unknowns)
    return fit.solve(best.unknowns)


def resolve_ambiguity(fit: JointFit, best: JointSolution) -> tuple[JointSolution, bool]:
    """Return the better of a solution and its rival at another depth, and whether it is ambiguous.

    With a lens, the starts of ``best_fit`` cover other depths, and only noise may swap two dips.
    """
    if np.isfinite(fit.model.probe.transducer.focus):
        return _with_slips(fit, best)
    rival, share = _rival(fit, best)
    if share < _RIVAL:
        return best, False
    other = fit.solve(rival)
    fit.refine_pulse(other.unknowns)
    other = fit.solve(other.unknowns)
    if other.cost > best.cost:
        fit.refine_pulse(best.unknowns)
        other = fit.solve(best.unknowns)
    return other, _rival(fit, other)[1] > _AMBIGUOUS


def solve_without_floor(fit: JointFit, best: JointSolution) -> JointSolution:
    """Fit a mouth without a floor."""
    without, prior = best.unknowns.copy(), PRIOR.copy()
    without[4], prior[3:] = 0.0, 1e-6
    prior[3] = 1e-9
    return fit.solve(without, centre=without, prior=prior, rounds=3)


def floor_gains_nothing(best: JointSolution, hole: float) -> bool:
    """Return whether a mouth without a floor, of cost ``hole``, fits equally well."""
    return hole < 1.02 * best.cost + 10


def _with_slips(fit: JointFit, best: JointSolution) -> tuple[JointSolution, bool]:
    """Return the best of a solution and near dips of the cost, and whether noise could swap two."""
    if best.unknowns[4] < _WEAK:
        return best, False
    dips = _others(_dips(fit, best.unknowns), best.unknowns[3], best.cost + 3 * _CLEAR_GAIN)
    found = [best, *(fit.solve(dip.unknowns, rounds=4) for dip in dips)]
    least = min(found, key=lambda solution: solution.cost)
    others = [one.cost for one in found if abs(one.unknowns[3] - least.unknowns[3]) > _APART]
    return least, min(others, default=np.inf) < least.cost + _CLEAR_GAIN


def _rival(fit: JointFit, best: JointSolution) -> tuple[FloatArray, float]:
    """Return the second best dip, and its explanation as a share of that of the best."""
    gained = max(fit.cost_of(fit.model.plain) - best.cost, 1e-9)
    for dip in _others(_dips(fit, best.unknowns), best.unknowns[3], np.inf):
        return dip.unknowns, float(1 - (dip.cost - best.cost) / gained)
    return best.unknowns, 0.0


def _is_through(fit: JointFit, best: JointSolution) -> bool:
    """Return whether a mouth without a floor explains the traces up to noise."""
    hole = solve_without_floor(fit, best).cost
    return floor_gains_nothing(best, hole) and hole < 1.1 * fit.usual_cost


def _better(fit: JointFit, best: JointSolution, starts: list[FloatArray]) -> JointSolution:
    """Return the better of a solution and a full fit from the most promising other start."""
    others = [fit.solve(start, rounds=3) for start in starts]
    other = min(others, key=lambda solution: solution.cost, default=best)
    if other.cost > 1.5 * best.cost:
        return best
    return min(best, fit.solve(other.unknowns), key=lambda solution: solution.cost)


def _dips(fit: JointFit, unknowns: FloatArray, depths: FloatArray = DEPTHS) -> list[JointSolution]:
    """Return the local minima of the cost over the depth, the lowest first."""
    costs = fit.sweep(unknowns, depths)
    padded = np.pad(costs, 1, constant_values=np.inf)
    dips = np.flatnonzero((costs <= padded[:-2]) & (costs <= padded[2:]))
    lowest = dips[np.argsort(costs[dips])]
    return [JointSolution(_at_depth(unknowns, depths[n]), float(costs[n])) for n in lowest]


def _others(
    dips: list[JointSolution], depth: float, most: float, apart: float = _APART
) -> list[JointSolution]:
    """Return the first dips at other depths than this one, of less than the greatest cost."""
    other = [dip for dip in dips if abs(dip.unknowns[3] - depth) > apart and dip.cost < most]
    return other[:_STARTS]


def _at_depth(unknowns: FloatArray, depth: float) -> FloatArray:
    moved = unknowns.copy()
    moved[3] = depth
    return moved


def _shaped(
    fit: JointFit,
    flat: FloatArray,
    slopes: tuple[float, ...],
    dishes: tuple[float, ...],
    depths: FloatArray,
) -> list[FloatArray]:
    """Return starts with a tilted or dished floor, the best first."""
    found = []
    for u, v, dish in product(slopes, slopes, dishes):
        begun = flat.copy()
        begun[5:] = u, v, dish
        found += _dips(fit, begun, depths)[:2]
    return [dip.unknowns for dip in sorted(found, key=lambda dip: dip.cost)]


BESIDE = 0.1e-3
"""Least distance in metres from the rim at which the wall gives most of an echo: half the beam is
within 0.12 mm of its axis."""
FEWEST = 10
"""Fewest distances for a shape."""
MOST_UNKNOWN = 15e-6
"""Largest standard deviation of the wall at the rim for a depth, in metres."""
_STEEP = 0.02
"""Least slope of a wall that is fitted as bent: four times the slope by the error of the pivot."""
_RENEWALS = 3
"""Renewals of a shape: from the second on, it changes by less than the error of a distance."""
_EQUAL, _STILL = 5.0, 0.5
"""Largest correlation of the difference of two equal traces with a pulse, in deviations of the
noise, which reaches it once in some thousand pairs; and largest share of equal consecutive pairs:
traces of a head that does not move are equal, and show no bent wall."""
_ASTRAY = 0.1e-3
"""Largest distance in metres of a first echo from a curved wall: dents that return echoes are
within 0.05 mm of one."""


def is_bent(fit: JointFit, most: float) -> bool:
    """Return whether the wall is steep, or its distances differ from a plane by more than most."""
    off = fit.model.off()
    plane = np.linalg.lstsq(np.column_stack([np.ones(len(off)), off]), fit.spectra.beyond)[0]
    return bool(np.hypot(*plane[1:]) > _STEEP or fit.range_error > most)


def moves(bursts: Sequence[Burst]) -> bool:
    """Return whether the traces of a raster differ by more than noise, because the head moved."""
    equal = []
    for one, other in pairwise(bursts):
        interval, noise = one.sample_interval, np.hypot(one.noise, other.noise)
        change = np.abs(matched(one.trace - other.trace, interval, Pulse()))
        equal.append(change[int(DEAD_TIME / interval) :].max() < _EQUAL * noise)
    return bool(np.mean(equal) < _STILL)


def bent_fit(bursts: Sequence[Burst], fit: JointFit) -> JointFit | None:
    """Return a fit about a mouth in a bent wall; None where too few bursts show one.

    ``bursts``: usable ones; ``fit``: their fit with a wall that is not bent.

    Notes
    -----
    The first echoes of the bursts beside the mouth give a shape, and the distances at which their
    traces fit the echoes of this shape give a better one. Water that warms during the raster also
    shifts echoes, but is no bent wall.
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
    for _ in range(_RENEWALS - 1):
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
    """Return the unknowns of a mouth with the outline of the image, without a floor."""
    unknowns = CENTRE.copy()
    unknowns[4] = 0.0
    return unknowns

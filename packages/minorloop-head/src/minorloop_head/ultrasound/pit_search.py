"""Search for the pit that explains the traces best, from several starts.

A waveform also fits when it is shifted by whole half waves, so that one start is not enough.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.ultrasound.joint_fit import PRIOR, JointFit, JointSolution

DEPTHS: FloatArray = np.arange(0.08e-3, 1.25e-3, 0.01e-3)
"""Depths of a sweep, in metres: from half a wavelength at 10 MHz on, seven in each."""
_WEAK, STRANGE = 0.3, 1.2
"""Gain of a floor below which there may be none; cost, over that of noise alone, above which a fit
is incomplete."""
_STARTS = 2
_SLIP = 0.033e-3  # m, half a wave there and back, where another fit may lie
_RIVAL, _AMBIGUOUS = 0.8, 0.87
"""A second depth that explains more than these shares of what the best one explains is tried too,
and makes the depth ambiguous."""
_APART = 0.02e-3
"""Depths nearer than this belong to one dip of the cost, in metres."""
_CLEAR_GAIN = 20.0
"""Cost by which the best depth must beat any other; noise at 4 dB changes the difference by 10."""
_USUAL, _UNSURE = 1.06, 0.88  # times the cost of noise alone; gain of a floor
_DISHES = (0.0, 0.03e-3, 0.05e-3)
_SLOPES = (-0.06, 0.0, 0.06)
"""Dishes in metres and slopes at which the search starts: floors are tilted by up to 4 degrees."""


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
    starts = [_at_depth(flat, taken + slip) for slip in (-_SLIP, _SLIP) if taken + slip > 0.04e-3]
    starts += _dips(fit, flat, taken)
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
    other = fit.solve(_at_depth(best.unknowns, rival))
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
    """Return whether a mouth without a floor, of cost ``hole``, fits as well."""
    return hole < 1.02 * best.cost + 10


def _with_slips(fit: JointFit, best: JointSolution) -> tuple[JointSolution, bool]:
    """Return the best of a solution and near dips of the cost, and whether noise could swap two."""
    if best.unknowns[4] < _WEAK:
        return best, False
    costs = fit.sweep(best.unknowns, DEPTHS)
    near = [
        float(DEPTHS[n])
        for n in _lowest(costs)
        if abs(DEPTHS[n] - best.unknowns[3]) > _APART and costs[n] < best.cost + 3 * _CLEAR_GAIN
    ]
    starts = [_at_depth(best.unknowns, depth) for depth in near[:_STARTS]]
    found = [best, *(fit.solve(start, rounds=4) for start in starts)]
    least = min(found, key=lambda solution: solution.cost)
    others = [one.cost for one in found if abs(one.unknowns[3] - least.unknowns[3]) > _APART]
    return least, min(others, default=np.inf) < least.cost + _CLEAR_GAIN


def _rival(fit: JointFit, best: JointSolution) -> tuple[float, float]:
    """Return the depth of the second best dip, and its share of what the best explains."""
    costs = fit.sweep(best.unknowns, DEPTHS)
    gained = max(fit.cost_of(fit.model.plain) - best.cost, 1e-9)
    taken = float(best.unknowns[3])
    for n in _lowest(costs):
        if abs(DEPTHS[n] - taken) > _APART:
            return float(DEPTHS[n]), float(1 - (costs[n] - best.cost) / gained)
    return np.nan, 0.0


def _is_through(fit: JointFit, best: JointSolution) -> bool:
    """Return whether a mouth without a floor explains the traces up to noise."""
    hole = solve_without_floor(fit, best).cost
    return floor_gains_nothing(best, hole) and hole < 1.1 * fit.usual_cost


def _better(fit: JointFit, best: JointSolution, starts: list[FloatArray]) -> JointSolution:
    """Return the better of a solution and the most promising other start, fitted to its end."""
    others = [fit.solve(start, rounds=3) for start in starts]
    other = min(others, key=lambda solution: solution.cost, default=best)
    if other.cost > 1.5 * best.cost:
        return best
    return min(best, fit.solve(other.unknowns), key=lambda solution: solution.cost)


def _dips(fit: JointFit, flat: FloatArray, taken: float) -> list[FloatArray]:
    """Return starts at the lowest dips over the depth, except the present one."""
    costs = fit.sweep(flat, DEPTHS)
    dips = [
        n
        for n in _lowest(costs)
        if abs(DEPTHS[n] - taken) > 0.045e-3 and costs[n] < 1.4 * costs.min()
    ]
    return [_at_depth(flat, DEPTHS[n]) for n in dips[:_STARTS]]


def _lowest(costs: FloatArray) -> list[int]:
    """Return the indices of the local minima of costs, the lowest first."""
    padded = np.pad(costs, 1, constant_values=np.inf)
    dips = np.flatnonzero((costs <= padded[:-2]) & (costs <= padded[2:]))
    return [int(n) for n in dips[np.argsort(costs[dips])]]


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
        costs = fit.sweep(begun, depths)
        found += [(float(costs[n]), _at_depth(begun, depths[n])) for n in _lowest(costs)[:2]]
    found.sort(key=lambda pair: pair[0])
    return [begun for _, begun in found]

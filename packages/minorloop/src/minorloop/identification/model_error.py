"""Error of a model beyond its posterior, learnt from left-out parts of the record.

No actuator is a Preisach operator, and the residual of a fit does not show its error on other
inputs. Parts of the record (its groups, if it has any) are left out and predicted by fits to the
other parts. The variance of their errors has three components: the variance of the posterior; one
that grows with the closed travel of the input, because loops of actuators creep a little whenever
they close; and one that grows with the distance in the memory plane from the cells that the other
parts reach. Each begins at its own value, which counts as a few independent parts of a record, and
keeps it if the record does not show it.

References
----------
Fevotte and Idier, Algorithms for nonnegative matrix factorization with the beta-divergence, Neural
Computation 23, 2011: the iteration, for the likelihood of variances (Itakura and Saito).
Papadopoulos, Vovk and Gammerman, Regression conformal prediction with nearest neighbours, JAIR 40,
2011: bands from quantiles of errors over their predicted size.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray, uniform_levels
from minorloop.identification import _prior_kernels as _kernels
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.likelihood import ManyOutputs
from minorloop.identification.posterior import DenseSystem, Posterior
from minorloop.identification.prior import PlanePrior
from minorloop.identification.prior_fit import Regression, on_finer_plane, scale_outputs
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Preisach
from minorloop.threads import one_thread

PARTS, _SEGMENTS = 5, 3
"""Parts of a record without groups, and contiguous segments of each."""
FEWEST = 50
"""Least samples of a record without groups of which parts are left out."""
MOST_BANDS = 40
"""Most bands of the plane, so that the fits without a part take less than a second."""
_CELLS = 25
"""Bands of the plane on which cells count as reached."""
_NEAR, _FARTHEST = 0.25, 3.0
"""Distance, in ranges of the input, within which travel counts as closed, and its largest value."""
_BEGIN = np.array([1.0, 0.2, 0.7])
"""First standard deviations of the components: of the posterior, over its own; of a closed travel
and of a distance of one range, over the opening of the major loop."""
_WEIGHT = np.array([20.0, 0.3, 1.0])
"""Number of independent parts of a record that each counts as: twice the inverse variances of the
logarithms of their squares."""
_STEPS, _ROUNDS = 40, 3
_WIDTH = 0.06
"""Width of the average of squared errors along the input, in ranges."""
_BINS = 60
_TINY = 1e-6


@dataclass(frozen=True, eq=False)
class Reach:
    """Distance in the memory plane from the cells that a record reached."""

    spec: PlaneSpec
    """Plane of even cells."""
    distance: FloatArray
    """Shape (K + 1,). Distance of each cell, in ranges of the input, from the nearest cell in which
    a measured sample evaluates the Everett function. The last number, zero, is for saturation."""

    @classmethod
    def of(cls, spec: PlaneSpec, corner: IntArray) -> Reach:
        """Return the reach of samples that evaluate the Everett function in these cells."""
        places = np.stack(np.tril_indices(spec.bands), axis=1) / spec.bands
        reached = places[np.unique(corner[corner >= 0])]
        distance = np.zeros(len(places) + 1)
        if len(reached):
            away = np.linalg.norm(places[:, None] - reached, axis=2)
            distance[:-1] = away.min(axis=1)
        return cls(spec, distance)

    def covariates(self, u: FloatArray, measured: BoolArray, start: Start) -> FloatArray:
        """(M, 2) closed travel and squared distance of measured samples, in ranges of the input.

        Closed travel is the travel of the input since it was last a quarter of its range away,
        minus the shortest travel through the same inputs.
        """
        span = float(self.spec.levels[-1] - self.spec.levels[0])
        travel = np.zeros(u.size)
        _kernels.closed_travel(u / span, _NEAR, _FARTHEST, travel)
        corner = DesignMatrix(self.spec, u, measured, start).corner
        return np.column_stack([travel[measured], self.distance[corner] ** 2])


def width(scores: FloatArray, probability: float, parts: int, least: float = 0.0) -> float:
    """Factor of standard deviations for which normal bands contain this share of left-out samples.

    Errors of one part are alike. So the factor is that of Student's distribution with one degree of
    freedom less than parts, and few parts weigh little against the normal distribution.

    ``scores`` (M,): errors of left-out samples over their standard deviations; ``probability``:
    probability of the bands; ``parts``: number of independent parts; ``least``: least ratio of the
    scores to those of a normal distribution.
    """
    from scipy.special import ndtri, stdtrit  # scipy.stats takes a second to import

    side = (1 + probability) / 2
    normal = float(ndtri(side))
    found = max(float(np.quantile(scores, probability)) / normal, least)
    # The normal distribution has the weight of eight independent parts
    share = parts / (parts + 8)
    student = float(stdtrit(max(parts - 1, 1), side)) / normal
    return student * (share * found + 1 - share)


@dataclass(frozen=True, eq=False)
class ModelError:
    """Variance of the outputs of a model in addition to that of its posterior."""

    parts: int
    """Number of independent parts of the record: groups, or visits to cells of the plane over the
    number of cells within a quarter of the range, where errors are alike."""
    reach: Reach
    """Cells that the record reached."""
    factors: FloatArray
    """Shape (3,). Factors of the components."""
    scores: FloatArray
    """Shape (M,). Errors of left-out samples over their standard deviations, in increasing order.
    """
    inputs: FloatArray
    variance: FloatArray
    """``inputs`` and ``variance``: shape (B,). Variance of other groups, by input; zero without
    groups."""
    shown: FloatArray = field(default_factory=lambda: np.full(2, np.inf))
    """Shape (2,). Largest covariates of left-out samples; infinite if a file does not keep them."""

    def deviation(
        self,
        u: FloatArray,
        measured: BoolArray,
        start: Start,
        known: FloatArray,
        probability: float,
    ) -> tuple[FloatArray, BoolArray]:
        """Standard deviations (M,) of readings after some inputs.

        Also returns (M,) whether a reading is farther off than all left-out samples, so that its
        deviation is assumed. Half a normal band of this probability is as wide as the errors on
        left-out parts, and wider for few parts.

        ``u`` (T,): inputs, delayed as the output is; ``measured`` (T,) of bool: whether to predict
        a reading after an input; ``start``: memory before the first input; ``known`` (M,): standard
        deviation by the posterior, with noise; ``probability``: probability of the band.
        """
        own = known**2 + np.interp(u[measured], self.inputs, self.variance)
        off = self.reach.covariates(u, measured, start)
        factor = width(self.scores, probability, self.parts, least=1.0)
        sd = factor * np.sqrt(np.column_stack([own, off]) @ self.factors)
        return sd, np.asarray((off > self.shown).any(axis=1))


def learn(
    regression: Regression,
    posterior: Posterior,
    model: Preisach,
    part: IntArray,
    errors: FloatArray | None = None,
    groups: int | None = None,
) -> ModelError:
    """Learn the model error from the parts of a record.

    Parameters
    ----------
    regression : Regression
        Regression of the M fitted outputs.
    posterior : Posterior
        Posterior distribution of its unknowns.
    model : Preisach
        The model.
    part : (M,) array of int
        Number of the part of each output.
    errors : (M,) array, optional
        Errors of outputs that were predicted without their group. Without these, contiguous parts
        are predicted here, with the prior and its hyperparameters.
    groups : int, optional
        Number of groups; without groups, the outputs of a visit to a cell of the plane count as
        one.
    """
    matrix, h, weight = regression.matrix, posterior.hyperparameters, regression.weight
    if errors is None:
        signed = bool((model.weights < 0).any())
        square, known = _left_out(regression, posterior, part, signed)
        known += (h.discrepancy**2 + h.noise**2) * posterior.unit**2
    else:
        sd = posterior.deviation(matrix.inputs, matrix.start, matrix.sampled)
        square, known = errors**2, sd**2
    low, high = matrix.spec.levels[[0, -1]]
    spec = PlaneSpec(uniform_levels(low, high, _CELLS))
    coarse = DesignMatrix(spec, matrix.inputs, matrix.sampled, matrix.start)
    covariates = np.empty((part.size, 2))
    for k in np.unique(part):
        reach = Reach.of(spec, coarse.corner[part != k])
        found = reach.covariates(matrix.inputs, matrix.sampled, matrix.start)
        covariates[part == k] = found[part == k]
    parts = groups
    if parts is None:
        visits = 1 + int(np.count_nonzero(np.diff(coarse.corner)))
        parts = max(round(visits / (_NEAR * _CELLS)), 1)
    weight = weight * min(parts / weight.sum(), 1.0)
    scale = _scale(model, float(np.ptp(regression.y)))
    known = np.maximum(known, (_TINY * scale) ** 2)  # a record may have no noise
    components = np.column_stack([known, scale**2 * covariates])
    inputs, variance = matrix.u[[0]], np.zeros(1)
    factors = _BEGIN**2
    for _ in range(0 if errors is None else _ROUNDS):
        excess = square - known - components[:, 1:] @ factors[1:]
        inputs, variance = by_input(matrix.u, excess, float(np.mean(square)))
        components[:, 0] = known + np.interp(matrix.u, inputs, variance)
        factors = _factors(components, square, weight)
    if errors is None:
        factors = _factors(components, square, weight)
    scores = np.sort(np.sqrt(square / (components @ factors)))
    factors = factors * np.array([1.0, scale**2, scale**2])
    reach = Reach.of(spec, coarse.corner)
    return ModelError(parts, reach, factors, scores, inputs, variance, covariates.max(axis=0))


def contiguous_parts(samples: int) -> IntArray:
    """(M,) number of the part of each sample."""
    return np.arange(samples) * PARTS * _SEGMENTS // samples % PARTS


def _left_out(
    regression: Regression, posterior: Posterior, part: IntArray, signed: bool
) -> tuple[FloatArray, FloatArray]:
    """(M,) squared errors and variances of the outputs of each part, predicted by the others."""
    matrix = regression.matrix.at_most(MOST_BANDS)
    spec, weight = matrix.spec, regression.weight
    scaled, unit, _ = scale_outputs(spec, regression.y)
    plane, h = PlanePrior(spec), posterior.hyperparameters
    h = on_finer_plane(h, posterior.spec, spec)
    square, known = np.empty(part.size), np.empty(part.size)
    places = np.flatnonzero(matrix.sampled)
    with one_thread():
        for k in np.unique(part):
            left = part == k
            evidence = ManyOutputs.of(matrix, scaled, weight * ~left)
            system = DenseSystem(evidence, plane, h, signed)
            x, _ = system.bounded()
            square[left] = unit**2 * ((matrix.forward(x) - scaled)[left] ** 2)
            at_left = np.zeros(matrix.inputs.size, dtype=np.bool_)
            at_left[places[left]] = True
            one = system.posterior(unit, part.size, 0.0)
            known[left] = one.variances(matrix.inputs, at_left, matrix.start)
    return square + regression.within, known


def _scale(model: Preisach, span: float) -> float:
    """Opening of the major loop, at most three tenths of the range of the output."""
    up = np.linspace(model.levels[0], model.levels[-1], 101)
    branches = model.simulate(np.concatenate([up, up[::-1]]))
    opening = float(np.abs(branches[101:][::-1] - branches[:101]).max())
    # Largest scale of the components, in ranges of the output
    return max(min(opening, 0.3 * span), _TINY * span)


def _factors(components: FloatArray, square: FloatArray, weight: FloatArray) -> FloatArray:
    """(3,) factors of the components (M, 3) of greatest posterior density of squared errors (M,).

    The logarithm of a factor is normal about its first value. So a factor becomes small if a record
    shows no such errors, even if its first value is large.
    """
    factors = _BEGIN**2
    for _ in range(_STEPS):
        variance, more = components @ factors, np.log(factors / _BEGIN**2)
        prior = _WEIGHT * (1 + np.maximum([-more, more], 0.0)) / factors
        shown = np.array([weight * square / variance**2, weight / variance]) @ components
        up, down = prior + shown
        factors = factors * np.sqrt(up / down)
    return factors


def by_input(u: FloatArray, squares: FloatArray, least: float) -> tuple[FloatArray, FloatArray]:
    """Inputs (B,), and the average of ``squares`` (M,) near each, at least ``least`` / 100.

    A mean of few rows is shifted towards the mean of all.
    """
    low, high = float(u.min()), float(u.max())
    edges = np.linspace(low, high, _BINS + 1)
    inputs = (edges[1:] + edges[:-1]) / 2
    place = np.clip(np.searchsorted(edges, u, side="right") - 1, 0, _BINS - 1)
    count = np.bincount(place, minlength=_BINS).astype(float)
    sums = np.bincount(place, squares, _BINS)
    kernel = np.exp(-0.5 * ((inputs[:, None] - inputs) / (_WIDTH * (high - low) or 1.0)) ** 2)
    smooth = (kernel @ sums + float(sums.sum() / count.sum())) / (kernel @ count + 1)
    return inputs, np.maximum(smooth, 0.01 * least)

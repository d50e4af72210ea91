"""A Gaussian prior on the Preisach plane, and what measurements make of it.

Before anything is measured, weights of neighbouring cells are alike and fade away from the
diagonal; how much is learnt from the measurements themselves, as hyperparameters of greatest
marginal likelihood. No actuator is a Preisach operator: a discrepancy, alike where the
present input and the last extrema are alike, stands beside the noise, so that repeating a
measurement does not make the model surer than it can be.

All is computed on scaled quantities: inputs from 0 to 1 over the levels, outputs with a range
of 1. What is minimised is (y - A x)' R^-1 (y - A x) + x' S^-1 x, with weights x not negative,
the regressors A, the prior covariance S and the covariance R of discrepancy and noise.

References
----------
Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2 and 5.4.
Kennedy and O'Hagan, Bayesian calibration of computer models, JRSS B 63, 2001: the discrepancy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray
from minorloop.identification import _prior_kernels as _kernels
from minorloop.identification import active_set
from minorloop.identification.areas import DesignMatrix, PlaneSpec
from minorloop.operators.memory import Memory, Start
from minorloop.operators.plane import cell_areas, relay_outputs, swing
from minorloop.operators.preisach import Preisach
from minorloop.threads import one_thread

LEVEL_VARIANCE = 4.0
"""Of offset and slope, in squared ranges of the output."""
ALIKE = (0.25, 0.35, 0.7)
"""Lengths over which the discrepancy is alike, in present input and the last two extrema."""
SHARED = 0.8
"""Share of the discrepancy that is alike; the rest is each sample's own."""
MOST_CORRELATED = 400
"""Samples up to which the correlation of the discrepancy counts; of more, each is taken to err
on its own, as the matrices would not fit."""
MANY = 10**9
"""Samples of hyperparameters that are given, not learnt."""
FINEST = 20
"""Bands of the plane on which hyperparameters are sought."""
FINEST_OF_FEW = 40
"""The same where samples are few."""

_NAMES = ("decay", "along", "across", "bulk", "reversible", "discrepancy", "own")
_CENTRES = np.log([0.3, 0.3, 0.4, 0.15, 0.3, 0.006, 0.3])
_SPREADS = np.array([0.8, 0.6, 0.6, 1.0, 1.0, 1.0, 2.0])
_NOISE_CENTRE, _NOISE_SPREAD = float(np.log(0.003)), 1.0
_HEAVY = np.array([False] * 7 + [True])
_TAIL = 3.0
_FURTHEST = 4.0
_FURTHEST_HEAVY = 5.0
_DIFFERENCE = 1e-4
_ROUNDS = 60
_LEAST_NOISE = 1e-6
_REFINEMENTS = 2


@dataclass(frozen=True)
class Hyperparameters:
    """What the prior is like, in ranges of input and output.

    Parameters
    ----------
    decay : float
        Distance alpha - beta over which weights fade by e.
    along, across : float
        Distances along (alpha + beta) / 2 and alpha - beta over which weights are alike.
    bulk : float
        Standard deviation of all irreversible weight together.
    reversible : float
        That of all reversible weight.
    discrepancy : float
        Standard deviation of what no weights can follow.
    own : float
        Variance of a weight about its neighbours', over the variance that it shares with them:
        near 0 on smooth planes, above 1 where weights have nothing to do with each other.
    noise : float
        Standard deviation of a measured output.
    """

    decay: float = 0.3
    along: float = 0.3
    across: float = 0.4
    bulk: float = 0.15
    reversible: float = 0.3
    discrepancy: float = 0.006
    own: float = 0.3
    noise: float = 0.003


class PlanePrior:
    """The prior covariance of the unknowns of a form, for any hyperparameters."""

    def __init__(self, form: PlaneSpec) -> None:
        self.form = form
        grid = (form.levels - form.levels[0]) / (form.levels[-1] - form.levels[0])
        middle, width = (grid[1:] + grid[:-1]) / 2, np.diff(grid)
        i, j = np.tril_indices(form.bands)
        self._diagonal = np.flatnonzero(i == j)
        self._along = (middle[i] + middle[j]) / 2
        # The centre of a triangle is a third of its width from the diagonal.
        self._across = np.where(i == j, width[i] / 3, middle[i] - middle[j])
        self._area = cell_areas(grid)[i, j]
        self._width, self._middle = width, middle
        self._unit = 2.0 / swing(form.relay)
        self._none = np.zeros(form.bands)

    def scale(self, h: Hyperparameters) -> FloatArray:
        """(n,) standard deviations that the unknowns have, roughly; all positive."""
        fading = np.exp(-self._across / h.decay) * self._area
        bulk = h.bulk * fading / fading.sum()
        sizes = bulk.copy()
        sizes[self._diagonal] = np.hypot(bulk[self._diagonal], h.reversible * self._width)
        levels = np.full(self.form.unknowns - self.form.cells, np.sqrt(LEVEL_VARIANCE))
        return np.concatenate([self._unit * sizes, levels])

    def covariance(self, h: Hyperparameters) -> FloatArray:
        """(n, n) covariance of the unknowns over the products of their scales."""
        cells, n = self.form.cells, self.form.unknowns
        alike = np.empty((cells, cells))
        _kernels.matern(self._along, self._across, h.along, h.across, alike)
        alike += 1.0
        alike[np.diag_indices(cells)] += h.own
        fading = np.exp(-self._across / h.decay) * self._area
        scale = self.scale(h)
        own = self._unit * h.bulk * fading / fading.sum() / scale[:cells]
        whole = np.zeros((n, n))
        whole[:cells, :cells] = own[:, None] * alike * own
        strip = np.empty((self.form.bands, self.form.bands))
        _kernels.matern(self._middle, self._none, h.along, 1.0, strip)
        strip += 1.0
        strip[np.diag_indices(self.form.bands)] += h.own
        size = self._unit * h.reversible * self._width / scale[self._diagonal]
        whole[np.ix_(self._diagonal, self._diagonal)] += size[:, None] * strip * size
        whole[np.arange(cells, n), np.arange(cells, n)] = 1.0
        return whole


@dataclass(frozen=True, eq=False)
class Evidence:
    """Measurements on scaled outputs, reduced to what the prior needs of them.

    ``rows`` (M, n) regressors and ``marks`` (M, 3), kept where the discrepancy is correlated;
    otherwise ``gram`` (n, n) and ``slope`` (n,), A'A and A'y. ``y`` (M,).
    """

    form: PlaneSpec
    y: FloatArray
    rows: FloatArray | None = None
    marks: FloatArray | None = None
    gram: FloatArray | None = None
    slope: FloatArray | None = None

    def information(self, h: Hyperparameters) -> tuple[FloatArray, FloatArray, float, float]:
        """A'R^-1 A, A'R^-1 y, y'R^-1 y and the logarithm of the determinant of R."""
        if self.rows is None or self.marks is None:
            assert self.gram is not None
            assert self.slope is not None
            variance = h.noise**2 + h.discrepancy**2
            square = float(self.y @ self.y) / variance
            logarithm = self.y.size * float(np.log(variance))
            return self.gram / variance, self.slope / variance, square, logarithm
        root = np.linalg.cholesky(disturbance(self.marks, h))
        white = _solved(root, np.column_stack([self.rows, self.y]))
        a, y = white[:, :-1], white[:, -1]
        return a.T @ a, a.T @ y, float(y @ y), 2 * float(np.log(root.diagonal()).sum())


@dataclass(frozen=True, eq=False)
class Posterior:
    """What is believed of the unknowns after the measurements, in the unit of the output.

    Parameters
    ----------
    form : PlaneSpec
        The unknowns, (n,): packed weights, offset, slope.
    hyperparameters : Hyperparameters
        Of the prior, in ranges.
    unit : float
        Range of the measured outputs.
    factor : (n, n) array
        F with F F' the posterior covariance, in squared units; positivity is not counted in.
    samples : int
        Measurements that the hyperparameters were learnt from. Variances are raised by
        samples / (samples - 7), at most doubled, for the seven that these took.
    """

    form: PlaneSpec
    hyperparameters: Hyperparameters
    unit: float
    factor: FloatArray
    samples: int

    def deviation(self, u: FloatArray, start: Start) -> FloatArray:
        """Standard deviation of the outputs that inputs (T,) will really have.

        What the weights leave open and what no weights can follow; not the noise of a sensor
        that looks at it.
        """
        rows, _ = regressors(self.form, u, np.ones(u.size, dtype=np.bool_), start)
        return self.row_deviation(rows)

    def row_deviation(self, rows: FloatArray) -> FloatArray:
        """The same for regressors (T, n)."""
        spread = np.einsum("tk,tk->t", *[rows @ self.factor] * 2)
        spread += (self.hyperparameters.discrepancy * self.unit) ** 2
        raised = min(self.samples / max(self.samples - len(_NAMES), 1), 2.0)
        return np.asarray(np.sqrt(raised * spread))


@dataclass(frozen=True, eq=False)
class PriorFit:
    """Unknowns, how optimal they are, and the belief around them."""

    x: FloatArray
    kkt: float
    belief: Posterior
    surprises: FloatArray | None
    """(M,) each measurement less what the others predict, in standard deviations."""
    learnt: Hyperparameters
    """As the search found them; those of the belief have a discrepancy that was raised to what
    weights that may not be negative left over."""


def fit_prior(
    areas: DesignMatrix,
    y: FloatArray,
    marked: tuple[FloatArray, FloatArray] | None,
    *,
    signed: bool = False,
    noise: float | None = None,
    guess: Hyperparameters | None = None,
    coarse: tuple[PlaneSpec, FloatArray] | None = None,
) -> PriorFit:
    """Fit with the prior.

    Parameters
    ----------
    areas : DesignMatrix
        Regressors of M measurements.
    y : (M,) array
        Outputs.
    marked : tuple, optional
        Rows and marks as `regressors` gives them, up to `MOST_CORRELATED` samples.
    signed : bool
        Let weights and slope be negative.
    noise : float, optional
        Standard deviation of a measured output, in its unit; found with the rest if not given.
    guess : Hyperparameters, optional
        Where to begin the search.
    coarse : tuple, optional
        A form and rows of few samples, as `coarse_rows` gives them.
    """
    if marked is not None:
        return fit_marked(
            areas.form, y, marked, signed=signed, noise=noise, guess=guess, coarse=coarse
        )
    with one_thread(areas.form.unknowns):
        return _fit_summed(areas, y, signed, noise, guess)


def _fit_summed(
    areas: DesignMatrix,
    y: FloatArray,
    signed: bool,
    noise: float | None,
    guess: Hyperparameters | None,
) -> PriorFit:
    form, (scaled, unit, shift) = areas.form, _scaled(areas.form, y)
    known = _known(noise, unit)
    small = areas
    while small.form.bands > FINEST:
        small = small.coarser()
    found = _summed(areas, scaled)
    coarse = found if small is areas else _summed(small, scaled)
    h = search(coarse, known, guess)
    # What is a coarse cell's own is the mean of what is its parts' own.
    h = replace(h, own=h.own * form.cells / small.form.cells)
    plane = PlanePrior(form)
    x, kkt, factor = _solve(plane, found, h, signed)
    if coarse is not found:
        for _ in range(_REFINEMENTS):
            h = _rescaled(found, areas, h, x, factor, known)
            x, kkt, factor = _solve(plane, found, h, signed)
    learnt = h
    for _ in range(_REFINEMENTS):
        raised = _raised(h, scaled - areas.forward(x))
        if raised is h:
            break
        h = raised
        x, kkt, factor = _solve(plane, found, h, signed)
    belief = Posterior(form, h, unit, factor * unit, y.size)
    return PriorFit(_unscaled(form, x, unit, shift), kkt, belief, None, learnt)


def fit_marked(
    form: PlaneSpec,
    y: FloatArray,
    marked: tuple[FloatArray, FloatArray],
    *,
    signed: bool = False,
    noise: float | None = None,
    guess: Hyperparameters | None = None,
    coarse: tuple[PlaneSpec, FloatArray] | None = None,
) -> PriorFit:
    """Fit few samples, whose rows (M, n) and marks (M, 3) are at hand; see `fit_prior`.

    ``coarse`` is a form, and its rows, on which the hyperparameters are sought instead.
    """
    scaled, unit, shift = _scaled(form, y)
    found = Evidence(form, scaled, *marked)
    plane = PlanePrior(form)
    with one_thread(form.unknowns):
        if coarse is None:
            learnt = h = search(found, _known(noise, unit), guess)
        else:
            small = Evidence(coarse[0], scaled, coarse[1], marked[1])
            learnt = search(small, _known(noise, unit), guess)
            h = replace(learnt, own=learnt.own * form.cells / coarse[0].cells)
        x, kkt, factor = _solve(plane, found, h, signed)
        surprises = _surprises(plane, found, h)
        for _ in range(_REFINEMENTS):
            raised = _raised(h, scaled - marked[0] @ x)
            if raised is h:
                break
            h = raised
            x, kkt, factor = _solve(plane, found, h, signed)
    belief = Posterior(form, h, unit, factor * unit, y.size)
    return PriorFit(_unscaled(form, x, unit, shift), kkt, belief, surprises, learnt)


def _scaled(form: PlaneSpec, y: FloatArray) -> tuple[FloatArray, float, float]:
    unit = float(np.ptp(y)) or 1.0
    shift = float(y.mean()) if form.offset else 0.0
    return (y - shift) / unit, unit, shift


def _unscaled(form: PlaneSpec, x: FloatArray, unit: float, shift: float) -> FloatArray:
    x = x * unit
    if form.offset:
        x[form.cells] += shift
    return x


def _known(noise: float | None, unit: float) -> float | None:
    return None if noise is None else max(noise / unit, _LEAST_NOISE)


def believe(
    form: PlaneSpec, h: Hyperparameters, marked: tuple[FloatArray, FloatArray]
) -> Posterior:
    """What would be believed after measurements with these rows and marks, range one."""
    found = Evidence(form, np.zeros(marked[0].shape[0]), *marked)
    _, _, factor = _solve(PlanePrior(form), found, h, signed=True)
    return Posterior(form, h, 1.0, factor, MANY)


def coarse_rows(
    areas: DesignMatrix, u: FloatArray, measured: BoolArray, start: Start
) -> tuple[PlaneSpec, FloatArray] | None:
    """A plane coarse enough to seek hyperparameters on, and its rows; None if this one is."""
    small = areas
    while small.form.bands > FINEST_OF_FEW:
        small = small.coarser()
    return None if small is areas else (small.form, regressors(small.form, u, measured, start)[0])


def regressors(
    form: PlaneSpec, u: FloatArray, measured: BoolArray, start: Start
) -> tuple[FloatArray, FloatArray]:
    """Dense regressors (M, n) and marks (M, 3) of a record of inputs (T,)."""
    blank = Preisach(form.levels, np.zeros((form.bands, form.bands)), diagonal=form.diagonal)
    memory: Memory = blank.memory(start)
    count = int(np.count_nonzero(measured))
    shares, marks = np.empty((count, form.cells)), np.empty((count, 3))
    past = np.array(memory.extrema, dtype=np.float64)
    levels = np.asarray(form.levels, dtype=np.float64)
    _kernels.walk(levels, form.diagonal == "uniform", past, u, measured, shares, marks)
    columns = [relay_outputs(form.relay, shares)]
    if form.offset:
        columns.append(np.ones((count, 1)))
    if form.slope:
        columns.append(u[measured][:, None])
    return np.hstack(columns), marks


def disturbance(marks: FloatArray, h: Hyperparameters) -> FloatArray:
    """(M, M) covariance of discrepancy and noise."""
    apart = (marks[:, None, :] - marks[None, :, :]) / np.array(ALIKE)
    alike = SHARED * np.exp(-0.5 * np.sum(apart**2, axis=2))
    own = (1 - SHARED) * h.discrepancy**2 + h.noise**2
    covariance: FloatArray = h.discrepancy**2 * alike + own * np.eye(marks.shape[0])
    return covariance


def search(
    evidence: Evidence, noise: float | None, guess: Hyperparameters | None = None
) -> Hyperparameters:
    """Hyperparameters of greatest posterior probability."""
    from scipy.optimize import minimize

    centres, spreads = _CENTRES, _SPREADS
    if noise is None:
        centres, spreads = np.append(centres, _NOISE_CENTRE), np.append(spreads, _NOISE_SPREAD)
    plane = PlanePrior(evidence.form)

    def cost(theta: FloatArray) -> float:
        return _unlikely((theta - centres) / spreads) - likelihood(
            plane, evidence, _as_hyper(theta, noise)
        )

    def both(theta: FloatArray) -> tuple[float, FloatArray]:
        here = cost(theta)
        steps = _DIFFERENCE * np.eye(theta.size)
        return here, np.array([(cost(theta + d) - cost(theta - d)) for d in steps]) / (
            2 * _DIFFERENCE
        )

    begin = centres if guess is None else _as_theta(guess, noise)
    furthest = np.where(_HEAVY[: centres.size], _FURTHEST_HEAVY, _FURTHEST) * spreads
    bounds = list(zip(centres - furthest, centres + furthest, strict=True))
    begin = np.clip(begin, *np.transpose(bounds))
    options: Any = {"maxiter": _ROUNDS, "ftol": 1e-7}
    answer = minimize(both, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    return _as_hyper(answer.x, noise)


def _unlikely(away: FloatArray) -> float:
    """Minus the logarithm of the density of hyperparameters, in spreads from their centres.

    The tail of the noise is that of a t distribution: sensors are good as a rule, and where one
    is fifty times worse the measurements must be able to say so. The discrepancy has none: on
    rough planes it would take for its own what more holds can still tell.
    """
    heavy = _HEAVY[: away.size]
    tails = (_TAIL + 1) / 2 * np.log1p(away[heavy] ** 2 / _TAIL)
    return float(0.5 * np.sum(away[~heavy] ** 2) + np.sum(tails))


def likelihood(plane: PlanePrior, evidence: Evidence, h: Hyperparameters) -> float:
    """Logarithm of the marginal likelihood, up to a constant."""
    scale = plane.scale(h)
    if evidence.rows is not None and evidence.marks is not None:
        rows = evidence.rows * scale
        outer = np.linalg.cholesky(
            rows @ plane.covariance(h) @ rows.T + disturbance(evidence.marks, h)
        )
        left = _solved(outer, evidence.y)
        return -0.5 * float(left @ left) - float(np.log(outer.diagonal()).sum())
    gram, slope, square, logarithm = evidence.information(h)
    root = np.linalg.cholesky(plane.covariance(h)) * scale[:, None]
    inner = np.linalg.cholesky(np.eye(scale.size) + root.T @ gram @ root)
    part = _solved(inner, root.T @ slope)
    spent = 2 * float(np.log(inner.diagonal()).sum())
    return -0.5 * (square - float(part @ part) + spent + logarithm)


def _solve(
    plane: PlanePrior, evidence: Evidence, h: Hyperparameters, signed: bool
) -> tuple[FloatArray, float, FloatArray]:
    """Unknowns with their signs kept, the optimality, and the factor of the covariance."""
    gram, slope, square, _ = evidence.information(h)
    scale, prior = plane.scale(h), plane.covariance(h)
    root = np.linalg.cholesky(prior)
    inverse = _solved(root, np.eye(scale.size))
    inverse = inverse.T @ inverse
    quadratic = scale[:, None] * gram * scale + inverse
    unit = 1 / np.sqrt(quadratic.diagonal())
    scale, quadratic = scale * unit, unit[:, None] * quadratic * unit
    linear = scale * slope
    bounded = np.full(scale.size, not signed)
    if plane.form.offset:
        bounded[plane.form.cells] = False
    solution = active_set.solve(
        np.tril(quadratic),
        lambda z: quadratic @ z - linear,
        lambda z: quadratic @ z,
        bounded,
        float(np.sqrt(square)) or 1.0,
    )
    inner = np.linalg.cholesky(quadratic)
    factor = scale[:, None] * _solved(inner, np.eye(scale.size)).T
    return solution.z * scale, solution.kkt, factor


def _surprises(plane: PlanePrior, evidence: Evidence, h: Hyperparameters) -> FloatArray:
    """Each measurement less what the others predict, over the standard deviation of that.

    Sundararajan and Keerthi, Predictive approaches for choosing hyperparameters in Gaussian
    processes, Neural Computation 13, 2001.
    """
    assert evidence.rows is not None
    assert evidence.marks is not None
    scale = plane.scale(h)
    half = np.asarray(evidence.rows * scale) @ np.linalg.cholesky(plane.covariance(h))
    inverse = np.linalg.inv(half @ half.T + disturbance(evidence.marks, h))
    return np.asarray((inverse @ evidence.y) / np.sqrt(inverse.diagonal()))


def _summed(areas: DesignMatrix, y: FloatArray) -> Evidence:
    """Evidence of many samples."""
    lower = areas.gram()
    gram = np.tril(lower) + np.tril(lower, -1).T
    return Evidence(areas.form, y, gram=gram, slope=areas.adjoint(y))


def _rescaled(
    evidence: Evidence,
    areas: DesignMatrix,
    h: Hyperparameters,
    x: FloatArray,
    factor: FloatArray,
    noise: float | None,
) -> Hyperparameters:
    """With the errors of a plane finer than that on which hyperparameters were sought.

    MacKay, Bayesian interpolation, Neural Computation 4, 1992, section 4: squared residuals over
    samples less well-determined unknowns.
    """
    assert evidence.gram is not None
    determined = float(np.sum((evidence.gram @ factor) * factor)) / (h.noise**2 + h.discrepancy**2)
    left = float(np.sum((evidence.y - areas.forward(x)) ** 2))
    variance = left / max(evidence.y.size - determined, 1.0)
    own = 0.0 if noise is None else noise
    rest = max(variance - own**2, _LEAST_NOISE**2)
    return replace(h, discrepancy=float(np.sqrt(rest)), noise=own)


def _raised(h: Hyperparameters, left: FloatArray) -> Hyperparameters:
    """With at least the discrepancy that the fitted samples show.

    The likelihood knows nothing of signs: of an output that falls it learns that negative weights
    follow it, and that little is left. What is left of them (M,) without these is what counts.
    """
    rest = float(np.mean(left**2)) - h.noise**2
    if rest <= h.discrepancy**2:
        return h
    return replace(h, discrepancy=float(np.sqrt(rest)))


def _solved(lower: npt.NDArray[Any], right: npt.NDArray[Any]) -> FloatArray:
    from scipy.linalg import solve_triangular

    return np.asarray(solve_triangular(lower, right, lower=True, check_finite=False))


def _as_hyper(theta: FloatArray, noise: float | None) -> Hyperparameters:
    values = np.exp(theta)
    last = float(values[-1]) if noise is None else noise
    named = dict(zip(_NAMES, map(float, values[: len(_NAMES)]), strict=True))
    return Hyperparameters(**named, noise=last)


def _as_theta(h: Hyperparameters, noise: float | None) -> FloatArray:
    names = [*_NAMES, "noise"] if noise is None else _NAMES
    return np.log([getattr(h, name) for name in names])

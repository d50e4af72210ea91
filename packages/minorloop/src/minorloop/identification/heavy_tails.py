"""Weights of which a few are many times the others: a prior with heavy tails for what is rough.

With a normal distribution of the independent part of the weights, single large weights are drawn
towards zero, and the small ones take over what is missing. With a t distribution of one degree of
freedom they are not. It is a normal distribution whose variance is drawn anew for each weight; the
variances are found by variational Bayes, in which the posterior stays normal. Which of the two
distributions is used, the marginal likelihood decides.

References
----------
Tipping and Lawrence, Variational inference for Student-t models, Neurocomputing 69, 2005. Bishop,
Pattern Recognition and Machine Learning, 2006, section 10.1: the bound on the likelihood.
"""

from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.identification.field_prior import FieldPrior
from minorloop.identification.likelihood import (
    Evidence,
    cholesky,
    cholesky_inverse,
    triangular_solve,
)
from minorloop.identification.prior import Hyperparameters, PlanePrior
from minorloop.identification.prior_system import SparseEvidence, sparse_system

ROUGH = 0.1
"""Nugget from which the distribution of the independent part matters."""
_ROUNDS = 8
"""Rounds of the variances; later ones change outputs by less than their error."""
_LEAST = 1e-12
"""Least squared weight, over its prior variance."""


@dataclass(frozen=True, eq=False)
class _Round:
    """Result for some variances of the independent part."""

    likelihood: float
    """Logarithm of the marginal likelihood with these variances, up to a constant."""
    squares: FloatArray
    """Shape (K,). Mean squares of the independent part of each weight."""
    determined: FloatArray
    """Shape (K,). Share of its variance that the measurements remove."""


def independent_variances(
    evidence: Evidence | SparseEvidence, h: Hyperparameters
) -> tuple[FloatArray | None, float]:
    """Variances of the independent parts of the weights, if their distribution has heavy tails.

    Parameters
    ----------
    evidence : Evidence or SparseEvidence
        Many measurements.
    h : Hyperparameters
        Hyperparameters of the normal prior.

    Returns
    -------
    tuple
        (K,) variances over those of the nugget, or None if the normal distribution is as likely;
        and how much the logarithm of the marginal likelihood rises.
    """
    plane = PlanePrior(evidence.spec)
    spec = plane.spec
    field, usual = FieldPrior(plane), plane.nugget_variances(h)
    share, scale, rise = np.ones(usual.size), 1.0, -np.inf
    normal = found = _posterior_of(evidence, field, h, usual)
    for left in range(_ROUNDS - 1, -1, -1):
        share = (scale + np.maximum(found.squares / usual, _LEAST)) / 2
        scale = 1 / float(np.mean(1 / share))
        field.plane = PlanePrior(spec, independent=share)
        found = _posterior_of(evidence, field, h, share * usual)
        ratio, before = scale / share, rise
        spent = np.sum(1 - ratio / 2 + np.log(ratio / (2 * np.pi)) / 2)
        # For a weight that no measurement determines, the bound is too low by so much.
        spent += (np.log(2 * np.pi) - 1) / 2 * np.sum(1 - found.determined)
        rise = found.likelihood + float(spent) - normal.likelihood
        if before > -np.inf and rise + left * max(rise - before, 0.0) <= 0:
            return None, 0.0  # the bound rises less and less from round to round
    return (share, rise) if rise > 0 else (None, 0.0)


def _posterior_of(
    evidence: Evidence | SparseEvidence,
    field: FieldPrior,
    h: Hyperparameters,
    variances: FloatArray,
) -> _Round:
    if isinstance(evidence, Evidence):
        return _posterior(evidence, field, h, variances)
    return _sparse_posterior(evidence, field, h, variances)


def _sparse_posterior(
    evidence: SparseEvidence, field: FieldPrior, h: Hyperparameters, variances: FloatArray
) -> _Round:
    """Posterior of the independent part, by the sparse system."""
    centre = np.zeros(field.plane.spec.unknowns)
    system = sparse_system(evidence, field, h, True, centre)
    likelihood, (given, mean, apart) = system.likelihood, system.apart
    share = variances * given / (h.noise**2 + h.discrepancy**2)
    determined = np.clip(share * (1 - given * apart), 0.0, 1.0)
    squares = (share * mean) ** 2 + variances * (1 - determined)
    return _Round(likelihood, squares, determined)


def _posterior(
    evidence: Evidence, field: FieldPrior, h: Hyperparameters, variances: FloatArray
) -> _Round:
    """Posterior of the independent part, by the normal equations of unknowns and field.

    With r the independent part, V its variances and C the covariance of the outputs, its mean is
    V A' C^-1 y and its covariance V - V A' C^-1 A V.
    """
    gram, slope, square, spent = evidence.information(h)
    precision, cells = field.precision(h, 1.0), variances.size
    own, given = precision.own, precision.own[:cells]
    matrix = gram.copy()
    matrix[np.diag_indices(own.size)] += own
    root = cholesky(matrix)
    inverse = cholesky_inverse(root)
    factors = precision.factors.toarray()
    linked = inverse[:, :cells] @ (given[:, None] * factors)
    of_field = cholesky(precision.field - (given[:, None] * factors).T @ linked[:cells])
    half = triangular_solve(of_field, linked.T @ slope)
    values = triangular_solve(of_field, half, transposed=True)
    mean = inverse @ slope + linked @ values
    half = triangular_solve(of_field, (linked[:cells] - factors).T)
    loose = inverse.diagonal()[:cells] + np.einsum("mk,mk->k", half, half)
    share = variances * given
    own_mean = share * (mean[:cells] - factors @ values)  # A' C^-1 y would be rounding
    determined = np.clip(share * (1 - given * loose), 0.0, 1.0)
    logarithms = np.log(root.diagonal()).sum() + np.log(of_field.diagonal()).sum()
    spent += 2 * float(logarithms) - precision.logarithm
    return _Round(
        -0.5 * (square - float(slope @ mean) + spent),
        own_mean**2 + variances * (1 - determined),
        determined,
    )

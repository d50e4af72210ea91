"""Bands of a fit without the prior.

Their widths are those of the prior on a plane of at most 50 bands, with the variance of an output
from the residuals of the fit. Where so many unknowns reproduce the readings that the residuals say
nothing, it is that of the known noise, or else what the prior has learnt. The squared difference
between the fit and the mean of the prior's posterior is added to the variance: where the record
leaves the plane open, both are guesses.
"""

from dataclasses import replace

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.identification.fitting import Regression
from minorloop.identification.least_squares import reproduces
from minorloop.identification.likelihood import MOST_SEARCH_BANDS, Evidence, search
from minorloop.identification.posterior import Posterior
from minorloop.identification.prior import PlanePrior
from minorloop.identification.prior_fit import (
    correlation_time,
    on_finer_plane,
    scale_outputs,
    with_residual_variance,
)
from minorloop.identification.prior_system import dense_system
from minorloop.threads import one_thread

_MOST_BANDS = 50
"""Bands of the plane at most; the outputs hardly depend on what is finer."""
_OVERFIT = 0.5
"""Share of the samples from which so many determined unknowns leave no reliable residuals."""
_LEAST_FREE = 1.0
"""Samples beyond the determined unknowns from which an exact fit shows that there is no noise."""


def plain_posterior(regression: Regression, x: FloatArray, determined: float) -> Posterior:
    """Posterior of the prior, with the residuals of unknowns that were fitted without it.

    Parameters
    ----------
    regression : Regression
        What they were fitted to.
    x : (n,) array
        The unknowns.
    determined : float
        Number of unknowns that the samples determined, at least.
    """
    matrix, weight = regression.matrix, regression.weight
    scaled, unit, middle = scale_outputs(matrix.spec, regression.y)
    small, medium = matrix.at_most(MOST_SEARCH_BANDS), matrix.at_most(_MOST_BANDS)
    # Neighbours whose errors are alike count as one sample.
    weight = weight / correlation_time(matrix, regression.y, x)
    within, count = regression.within / unit**2, float(weight.sum())
    off = (matrix.forward(x) - regression.y) / unit
    left = float(weight @ off**2) + within * count
    with one_thread():
        learnt = search(Evidence.of_many(small, scaled, weight, within), None)
        evidence, plane = Evidence.of_many(medium, scaled, weight), PlanePrior(medium.spec)
        h = on_finer_plane(learnt, small.spec, medium.spec)
        h = with_residual_variance(h, left, count, None)
        determined = max(determined, dense_system(plane, evidence, h, signed=True).determined)
        free, noise = count - determined, None
        if determined > _OVERFIT * count:
            known, reproduced = regression.noise, reproduces(matrix, x, regression.y)
            if reproduced and known:
                noise = known / unit
            elif not reproduced or (known is None and free < _LEAST_FREE):
                variance = learnt.discrepancy**2 + learnt.noise**2
                left = max(left, max(free, 1.0) * variance)
        h = with_residual_variance(h, left, free, noise)
        system = dense_system(plane, evidence, h, signed=True)
        into = matrix.spec.sums(medium.spec)
        other = np.bincount(into, x, medium.spec.unknowns)
        if medium.spec.offset:
            other[medium.spec.cells] -= middle
        found = system.posterior(unit, round(count), determined)
        return replace(found, dense=np.column_stack([found.dense, other - unit * system.mean]))

"""What is weak about an identification, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from minorloop.identification import active_set
from minorloop.identification.refinement import UNSETTLED

if TYPE_CHECKING:
    from minorloop.identification.result import Identification

WELL_EXCITED = 0.5
"""Share of the cells below which a record is said not to identify the plane."""
_OVERFIT = 2.0
_HARDLY = 0.8
_AGAINST = -0.5
_ROUNDING = 1e-9
_FALLS = (
    "the output falls as the input rises, and weights that are not negative cannot follow that: "
    "turn the sign of the output, or let them be negative with signed=True (--signed)"
)


def advice(result: Identification) -> Iterator[str]:
    """Sentences, most important first; none where nothing is weak."""
    yield from _suspects(result)
    yield from _excitation(result)
    yield from _accuracy(result)
    yield from _numerics(result)


def grave(result: Identification) -> Iterator[str]:
    """The part of the advice that tells of something wrong with actuator, sensor or sign."""
    yield from _suspects(result)
    if _falls(result):
        yield _FALLS


def _suspects(result: Identification) -> Iterator[str]:
    for index in result.suspects:
        yield (
            f"sample {index} (input {result.u[index]:.6g}, output {result.y[index]:.6g}) lies far "
            "outside the band that all others give, and was set aside; repeat it"
        )


def _excitation(result: Identification) -> Iterator[str]:
    excited, cells = int(np.count_nonzero(result.excited)), result.areas.form.cells
    few = result.samples < result.unknowns
    if few and result.belief is not None:
        yield (
            f"{result.samples} samples for {result.unknowns} unknowns, {excited} of {cells} cells "
            f"excited, and {_pattern(result)}: the rest is filled in by the prior, and the bands "
            "say how surely"
        )
    elif excited < WELL_EXCITED * cells:
        yield (
            f"{excited} of {cells} cells of the plane are excited ({excited / cells:.0%}): "
            f"{_pattern(result)}; weights elsewhere are guesses. Measure a decaying staircase "
            "(minorloop plan decaying) or reversal curves, or use fewer levels"
        )
    if few and result.belief is None:
        smooth = "filled in by smoothness" if result.smoothness else "arbitrary: use fewer levels"
        yield f"{result.samples} samples for {result.unknowns} unknowns: the rest is {smooth}"
    low, high = result.model.levels[[0, -1]]
    beyond = int(np.count_nonzero((result.u < low) | (result.u > high)))
    if beyond:
        yield (
            f"{beyond} inputs lie beyond the levels [{low:g}, {high:g}], where the relays are "
            "saturated; widen the levels"
        )


def _pattern(result: Identification) -> str:
    """What the input looks like to the plane."""
    moving = result.u[np.append(True, np.diff(result.u) != 0)]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(moving)))) + 1
    levels = result.areas.form.levels
    ends = (moving[turns] <= levels[1]) | (moving[turns] >= levels[-2])
    if ends.all():
        return "the input runs along one major loop, which says nothing of minor loops"
    if result.samples <= turns.size + 2:
        return "it was measured at its reversal points only"
    return "the input leaves parts of the plane untouched"


def _accuracy(result: Identification) -> Iterator[str]:
    held, base = result.holdout_nrmse, result.baseline_nrmse
    score = result.nrmse if held is None else held
    span = float(np.ptp(result.y[result.fitted])) or 1.0
    if held is None:
        yield (
            "no data were held out, so nothing here says how the model does on an input it has "
            "not seen; pass holdout=0.3 (--holdout 0.3)"
        )
    elif _rmse_held_out(result) > _OVERFIT * max(result.rmse, _ROUNDING * span):
        yield (
            f"error on held-out data ({held:.2%} of its range, "
            f"{_rmse_held_out(result) / span:.2%} of the fitted range) is more than twice that on "
            f"fitted data ({result.nrmse:.2%}): fit inputs more like those you mean to apply, or "
            "fewer levels"
        )
    if _falls(result):
        yield _FALLS
    elif score > base and score > _ROUNDING:
        yield (
            f"a polynomial of the delayed input does better ({base:.2%} against {score:.2%}): "
            'the hysteresis here is weak or rate-dependent; try lag="auto" and slope=True '
            "(--lag auto --slope), and for loops like butterflies signed=True (--signed)"
        )
    elif score > _HARDLY * base and score > _ROUNDING:
        yield (
            f"a polynomial of the delayed input does nearly as well ({base:.2%} against "
            f"{score:.2%}): there is little hysteresis in this record, or it is lost in noise"
        )


def _rmse_held_out(result: Identification) -> float:
    residual = (result.prediction - result.y)[result.held_out]
    return float(np.sqrt(np.mean(residual**2)))


def _falls(result: Identification) -> bool:
    """Whether the output goes against the input, and the weights may not."""
    weights = result.model.weights
    u, y = result.u[result.fitted], result.y[result.fitted]
    against = float(np.corrcoef(u, y)[0, 1]) < _AGAINST if np.ptp(u) > 0 else False
    return against and bool((weights >= 0).all())


def _numerics(result: Identification) -> Iterator[str]:
    if result.kkt > active_set.ACCEPTABLE:
        yield (
            f"the fit did not converge: the solver stopped at an optimality of {result.kkt:.1e}, "
            f"short of {active_set.ACCEPTABLE:.0e}; this is the best solution it met. Use fewer "
            "levels or a positive smoothness"
        )
    elif not result.converged:
        yield (
            "the fit did not converge: the record hardly determines some of the weights, and "
            f"others of them fit better by more than {UNSETTLED:.0e} of the error squared. Use "
            "fewer levels or a positive smoothness"
        )
    if not result.model.monotone:
        yield (
            "the model is not monotone and cannot be inverted; if the output falls as the input "
            "rises, turn its sign, otherwise signed=False gives one that can"
        )

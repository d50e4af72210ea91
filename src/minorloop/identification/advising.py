"""What is weak about an identification, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from minorloop.identification import active_set

if TYPE_CHECKING:
    from minorloop.identification.result import Identification

WELL_EXCITED = 0.5
"""Share of the cells below which a record is said not to identify the plane."""
MANY_SAMPLES = 4
_OVERFIT = 2.0


def advice(result: Identification) -> Iterator[str]:
    """Sentences, most important first; none where nothing is weak."""
    yield from _suspects(result)
    yield from _excitation(result)
    yield from _accuracy(result)
    yield from _numerics(result)


def _suspects(result: Identification) -> Iterator[str]:
    for index in result.suspects:
        yield (
            f"sample {index} (input {result.u[index]:.6g}, output {result.y[index]:.6g}) lies far "
            "outside the band that all others give, and was set aside; repeat it"
        )


def _excitation(result: Identification) -> Iterator[str]:
    excited, cells = int(np.count_nonzero(result.excited)), result.areas.form.cells
    if excited < WELL_EXCITED * cells and result.belief is None:
        yield (
            f"the input excites {excited} of {cells} cells of the plane ({excited / cells:.0%}): "
            f"{_pattern(result)}; weights elsewhere are guesses. Measure a decaying staircase "
            "(minorloop plan decaying) or reversal curves, or use fewer levels"
        )
    if result.samples < result.unknowns:
        if result.belief is not None:
            remedy = "the rest is filled in by the prior, and the bands say how surely"
        elif result.smoothness:
            remedy = "the rest is filled in by smoothness"
        else:
            remedy = "the rest is arbitrary: use fewer levels, or the prior"
        yield f"{result.samples} samples for {result.unknowns} unknowns: {remedy}"
    low, high = result.model.levels[[0, -1]]
    beyond = int(np.count_nonzero((result.u < low) | (result.u > high)))
    if beyond:
        yield (
            f"{beyond} inputs lie beyond the levels [{low:g}, {high:g}], where the relays are "
            "saturated; widen the levels"
        )


def _pattern(result: Identification) -> str:
    """What the input looks like to the plane."""
    bands = result.areas.form.bands
    turns = np.diff(np.sign(np.diff(result.u)[np.diff(result.u) != 0]))
    reversals = int(np.count_nonzero(turns))
    if np.count_nonzero(result.excited) <= 2 * bands:
        if result.samples <= reversals + 2:
            return "it was measured at its reversal points only"
        return "it runs along one major loop, which says nothing of minor loops"
    return "it leaves parts of the plane untouched"


def _accuracy(result: Identification) -> Iterator[str]:
    held, base = result.holdout_nrmse, result.baseline_nrmse
    score = result.nrmse if held is None else held
    if held is None:
        yield (
            "no data were held out, so nothing here says how the model does on an input it has "
            "not seen; pass holdout=0.3 (--holdout 0.3)"
        )
    elif held > _OVERFIT * max(result.nrmse, 1e-6):
        yield (
            f"error on held-out data ({held:.2%}) is more than twice that on fitted data "
            f"({result.nrmse:.2%}): fit inputs more like those you mean to apply, or fewer levels"
        )
    if score > base:
        yield (
            f"a polynomial of the delayed input does better ({base:.2%} against {score:.2%}): "
            'the hysteresis here is weak or rate-dependent; try lag="auto" and slope=True '
            "(--lag auto --slope)"
        )


def _numerics(result: Identification) -> Iterator[str]:
    if result.kkt > active_set.ACCEPTABLE:
        yield (
            f"the solver stopped at an optimality of {result.kkt:.1e}, short of "
            f"{active_set.ACCEPTABLE:.0e}; this is the best solution it met. Use fewer levels or "
            "a positive smoothness"
        )
    if not result.model.monotone:
        yield "the model is not monotone and cannot be inverted; signed=False gives one that can"

"""Advice: what is weak about an identification, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from minorloop.arrays import BoolArray
from minorloop.errors import are, counted
from minorloop.identification import active_set
from minorloop.identification.baseline import lateness, percent, polynomial_nrmse, rms
from minorloop.identification.refinement import UNSETTLED
from minorloop.identification.residual_advice import residual_advice
from minorloop.identification.residuals import noise_in
from minorloop.lab.codes import codes

if TYPE_CHECKING:
    from minorloop.identification.fitted import Fit

WELL_EXCITED = 0.5
"""Share of excited cells below which a record does not identify the plane."""
_OVERFIT = 2.0
"""Error on held-out over error on fitted data from which a model is called overfitted."""
_LATE = 4.0
"""Error on other inputs over that on fitted data where a lag was found, at most: filters are no
pure lag, and their error grows with the rate."""
_UNLIKE = 2.0
"""Error on the worst group over that on the median one from which groups are not alike."""
_NEARLY_AS_GOOD = 0.8
_FALLING = -0.5
"""Correlation of input and output below which the output falls."""
_CLOCKWISE, _SURE = -0.5, -4.0
"""Lateness of the output, and the same in its standard deviations, from which it comes before the
input."""
_ROUNDING = 1e-9
_SHOWN = 6
_RARE = 10
"""Samples for each input that may be a sentinel; more of them are inputs."""
_WORST, _WRONG = 0.1, 0.05
"""Error, as a share of the range of the output, above which a model is not to be trusted; and the
same for what is to be expected of it on other inputs, noise not counted."""
_FALLS = (
    "the output falls as the input rises, which weights that are not negative cannot describe: "
    "reverse the sign of the output (reduce --flip), or allow negative weights with signed=True "
    "(--signed)"
)


def advice(result: Fit) -> Iterator[str]:
    """Give sentences, most important first; none where nothing is weak."""
    yield from warnings(result)
    yield from _codes(result)
    yield from _outliers(result)
    yield from residual_advice(result)
    yield from _lag(result)
    yield from _excitation(result)
    yield from _accuracy(result)
    yield from _numerics(result)


def warnings(result: Fit) -> Iterator[str]:
    """Give the part of the advice for which the model is not to be trusted."""
    yield from (finding.text for finding in result.findings)
    yield from _input_codes(result)
    yield from _error_warnings(result)


def fault_warnings(result: Fit) -> Iterator[str]:
    """Give the part of the advice about faults of actuator, sensor or sign."""
    yield from (finding.text for finding in result.findings)
    yield from _codes(result)
    yield from _outliers(result)
    if _falls(result):
        yield _FALLS


def _codes(result: Fit) -> Iterator[str]:
    if not result.codes:
        return
    shown = [f"sample {code.sample} ({code.value:.6g})" for code in result.codes[:_SHOWN]]
    more = len(result.codes) - len(shown)
    listed = ", ".join(shown) + (f" and {more} more" if more else "")
    one = len(result.codes) == 1
    yield (
        f"{'a reading is a code' if one else f'{len(result.codes)} readings are codes'} of the "
        f"instrument and no measurement: {listed}; the model was fitted without "
        f"{'it' if one else 'them'}, as if the {'cell' if one else 'cells'} were empty. Check the "
        "range of the instrument and repeat"
    )


def _input_codes(result: Fit) -> Iterator[str]:
    """Name sentinels among the inputs, which are not left out: memory depends on every input."""
    found = codes(result.u)
    if found and len(found) <= max(result.u.size // _RARE, 1):
        shown = [f"sample {code.sample} ({code.value:.6g})" for code in found[:_SHOWN]]
        more = f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
        one = len(found) == 1
        yield (
            f"{'an input is a code' if one else f'{len(found)} inputs are codes'} of a logger, far "
            f"from all others: {', '.join(shown)}{more}; give what was applied, or cut these rows"
        )


def _outliers(result: Fit) -> Iterator[str]:
    for index in result.suspects:
        yield (
            f"sample {index} (input {result.u[index]:.6g}, output {result.y[index]:.6g}) lies far "
            "outside the band of a fit without it, and was left out; repeat it"
        )


def _lag(result: Fit) -> Iterator[str]:
    """Say how many rows a lag leaves out at the beginnings of curves."""
    if result.lag and result.curves.begins.size > 1:
        known = result.curves.positions(result.u.size) >= result.lag
        out, rows = np.count_nonzero(result.fitted & ~known), np.count_nonzero(result.fitted)
        if out:
            yield (
                f"the lag of {counted(result.lag, 'sample')} leaves {out} of {rows} samples out, "
                "at the beginnings of curves, because the inputs before them are not known; lag=0 "
                "(--lag 0) fits all"
            )


def _excitation(result: Fit) -> Iterator[str]:
    excited, cells = int(np.count_nonzero(result.excited)), result.matrix.spec.cells
    few = result.samples < result.unknowns
    if few and result.posterior is not None:
        yield (
            f"{result.samples} samples for {result.unknowns} unknowns, {excited} of {cells} cells "
            f"excited, and {_pattern(result)}: the prior determines the rest, and the bands show "
            "how accurately"
        )
    elif excited < WELL_EXCITED * cells:
        yield (
            f"{excited} of {cells} cells of the plane are excited ({excited / cells:.0%}): "
            f"{_pattern(result)}; weights elsewhere are guesses. Measure a decaying staircase "
            "(minorloop plan decaying) or reversal curves, or use fewer levels"
        )
    if few and result.posterior is None:
        smooth = "set by the smoothness" if result.smoothness else "arbitrary: use fewer levels"
        yield f"{result.samples} samples for {result.unknowns} unknowns: the rest is {smooth}"
    low, high = result.model.levels[[0, -1]]
    beyond = int(np.count_nonzero((result.u < low) | (result.u > high)))
    # With dynamics, the levels follow inputs that were filtered otherwise.
    if beyond and result.measured is None:
        yield (
            f"{counted(beyond, 'input')} {are(beyond)} beyond the levels [{low:g}, {high:g}], "
            "where the relays are saturated; widen the levels"
        )


def _pattern(result: Fit) -> str:
    """Describe how the input covers the plane."""
    moving = result.u[np.append(True, np.diff(result.u) != 0)]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(moving)))) + 1
    levels = result.matrix.spec.levels
    ends = (moving[turns] <= levels[1]) | (moving[turns] >= levels[-2])
    if ends.all():
        return "the input follows one major loop, which does not show minor loops"
    if result.samples <= turns.size + 2:
        return "it was measured at its reversal points only"
    return "the input leaves parts of the plane untouched"


def _accuracy(result: Fit) -> Iterator[str]:
    held_out, base = result.holdout_accuracy, result.baseline_nrmse
    span = result.span(result.fitted)
    if held_out is None and result.groups_nrmse is not None:
        if result.groups_nrmse > _OVERFIT * max(result.nrmse, _ROUNDING):
            yield (
                f"the error on left-out groups ({percent(result.groups_nrmse)}) is more than twice "
                f"that on fitted data ({percent(result.nrmse)}): the groups differ, or are too few "
                f"for so many levels. {_of_another_group(result)}"
            )
    elif held_out is None:
        yield (
            "no data were held out, so the error on other inputs is unknown; pass holdout=0.3 "
            "(--holdout 0.3)"
        )
    elif held_out.rmse > _OVERFIT * max(result.rmse, _ROUNDING * span):
        yield (
            f"error on held-out data ({percent(held_out.nrmse)} of its range, "
            f"{percent(held_out.rmse / span)} of the fitted range) is more than twice "
            f"that on fitted data ({percent(result.nrmse)}): fit inputs similar to those you will "
            "apply, or use fewer levels"
        )
    score, base = _scores_without_outliers(result)  # as where the polynomial is better
    if base >= score > max(_NEARLY_AS_GOOD * base, _ROUNDING) and not _falls(result):
        yield (
            f"a polynomial of the delayed input is nearly as good ({percent(base)} against "
            f"{percent(score)}): this record has little hysteresis, or it is hidden by noise"
        )


def _of_another_group(result: Fit) -> str:
    """Say what the errors on left-out groups promise, which groups that are not alike do not."""
    usual, worst = np.quantile(result.each_group_nrmse, [0.5, 1.0])
    if worst <= _UNLIKE * usual:
        return "Expect that error for another group"
    return (
        f"They are not alike: it is {percent(usual)} for the median group and {percent(worst)} for "
        "the worst. Expect up to the latter for another group, and more where its inputs go where "
        "no group was; the bands count this"
    )


def _error_warnings(result: Fit) -> Iterator[str]:
    """Give warnings about the errors of the model."""
    score, base = _scores_without_outliers(result)
    parts, expected = _parts(result), _expected(result)
    errors = [rms((result.prediction - result.y)[rows]) for rows in parts.values()]
    if expected > _WRONG or max(errors, default=0.0) > _WORST * _whole(result):
        listed = [
            f"on {which} data is {percent(error / result.span(rows))} of range"
            for error, (which, rows) in zip(errors, parts.items(), strict=True)
        ]
        without = "without the outliers, " if _has_outliers(result) else ""
        more = f"; expect {expected:.0%} on other inputs, beyond noise" if expected > _WRONG else ""
        yield (
            f"{without}the error {' and '.join(listed)}{more}; the residual shows what the model "
            "cannot describe"
        )
    if _falls(result):
        yield _FALLS
    elif _clockwise(result):
        yield (
            "loops run clockwise: the output turns before the input, which weights that are not "
            "negative cannot describe. If the columns of input and output are exchanged, exchange "
            "them; otherwise allow negative weights with signed=True (--signed)"
        )
    elif score > base and score > _ROUNDING:
        yield (
            f"a polynomial of the delayed input is better ({percent(base)} "
            f"against {percent(score)}): the hysteresis here is weak or rate-dependent; try "
            f"{_untried(result)}"
        )


def _untried(result: Fit) -> str:
    """Name the options that were neither given nor compared."""
    compared = {choice.name for choice in result.choices}
    options = [] if result.searched else ['lag="auto" (--lag auto)']
    if not result.matrix.spec.slope and "structure" not in compared:
        options.append("slope=True (--slope)")
    return " and ".join([*options, "for butterfly loops signed=True (--signed)"])


def _known(result: Fit) -> BoolArray:
    """(T,) measured rows that are no outliers."""
    known = np.isfinite(result.y)
    for finding in result.findings:
        if finding.kind == "outlier":
            known[list(finding.samples)] = False
    return known


def _has_outliers(result: Fit) -> bool:
    return any(finding.kind == "outlier" for finding in result.findings)


def _parts(result: Fit) -> dict[str, BoolArray]:
    """Fitted and held-out rows that are no outliers, where there are some."""
    parts = {"fitted": result.fitted & _known(result), "held-out": result.held_out & _known(result)}
    return {name: rows for name, rows in parts.items() if rows.any()}


def _whole(result: Fit) -> float:
    """Range of the output in fitted and held-out rows that are no outliers."""
    return result.span((result.fitted | result.held_out) & _known(result))


def _scores_without_outliers(result: Fit) -> tuple[float, float]:
    """Error over the range and that of the polynomial, on held-out rows or else on fitted ones."""
    scored = result.held_out if result.held_out.any() else result.fitted
    known = _known(result)
    if not (scored & known).any():
        return 0.0, 0.0
    scored = scored & known
    base = result.baseline_nrmse
    if (result.held_out | result.fitted)[~known].any():
        base = polynomial_nrmse(result.u, result.y, result.fitted & known, scored, result.curves)
    return rms((result.prediction - result.y)[scored]) / result.span(scored), base


def _expected(result: Fit) -> float:
    """Error to expect on other inputs without noise, over the range of the output.

    The greatest of twice that on fitted data, four times that with a lag, that on held-out data,
    and that on held-out data over their own range, as far as it is more than twice the noise: a
    range may be small.
    """
    parts, error = _parts(result), result.prediction - result.y
    square = {x: float(np.mean(error[parts[x]] ** 2)) for x in parts}
    fitted, held_out = square.get("fitted", 0.0), square.get("held-out", 0.0)
    noise = noise_in(error[parts["fitted"]], result.y[parts["fitted"]]) ** 2 if fitted else 0.0
    own = result.span(parts["held-out"]) if held_out else 1.0
    more = _LATE if result.lag else _OVERFIT
    beyond = (
        (more**2 * (fitted - noise), result.span(result.fitted)),
        (held_out - noise, _whole(result)),
        (held_out - _OVERFIT**2 * noise, own),
    )
    return max(float(np.sqrt(max(excess, 0.0))) / span for excess, span in beyond)


def _falls(result: Fit) -> bool:
    """Whether the output falls as the input rises, but no weight is negative."""
    weights = result.model.weights
    u, y = result.u[result.fitted], result.y[result.fitted]
    against = float(np.corrcoef(u, y)[0, 1]) < _FALLING if np.ptp(u) > 0 else False
    return against and bool((weights >= 0).all())


def _clockwise(result: Fit) -> bool:
    """Whether the output comes before the input, but no weight is negative."""
    known = result.fitted & _known(result)
    late = lateness(result.u, result.y, known, result.curves)
    sure = late * np.sqrt(np.count_nonzero(known)) < _SURE
    return late < _CLOCKWISE and bool(sure and (result.model.weights >= 0).all())


def _numerics(result: Fit) -> Iterator[str]:
    if result.kkt > active_set.ACCEPTABLE:
        yield (
            f"the fit did not converge: the solver stopped at an optimality of {result.kkt:.1e}, "
            f"above {active_set.ACCEPTABLE:.0e}; this is the best solution it found. Use fewer "
            "levels or a positive smoothness"
        )
    elif not result.converged:
        yield (
            "the fit did not converge: the record hardly determines some of the weights, and "
            f"other values reduce the squared error by more than {UNSETTLED:.0e}. Use "
            "fewer levels or a positive smoothness"
        )
    if not result.model.monotone:
        yield (
            "the model is not monotone and cannot be inverted; if the output falls as the input "
            "rises, reverse its sign; otherwise signed=False gives a model that can be inverted"
        )

"""Rules of advice on a plane: the weaknesses of a fit, and remedies."""

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np

from minorloop.arrays import BoolArray
from minorloop.errors import are, counted
from minorloop.identification import active_set
from minorloop.identification.baseline import lateness, percent, polynomial_nrmse, rms
from minorloop.identification.choosing import TRAVEL
from minorloop.identification.dense_solver import UNSETTLED
from minorloop.identification.residuals import PARTS, noise_in
from minorloop.lab.faults import codes, far_from_others

Fit: TypeAlias = Any
"""An `Identification`, which has these rules and so cannot be imported."""

_WELL_EXCITED = 0.5
"""Share of excited cells below which a record does not identify the plane."""
_OVERFIT = 2.0
"""Ratio of the errors on held-out and fitted data from which a model counts as overfitted."""
_NEARLY_AS_GOOD = 0.8
_FALLING = -0.5
"""Correlation of input and output below which the output falls."""
_ROUNDING = 1e-9
_RARE = 10
"""Least number of samples per sample of a sentinel; a more frequent value is an input."""
_WORST, _WRONG = 0.1, 0.05
"""Errors above which a model is not to be trusted, over the range of the output: on its data, and
the error to expect on other inputs, without noise."""
_LEAST_DRIFT = 0.005
"""Least drift or step that is reported, in ranges."""
_ALIKE, _LEAST_ERROR = 0.8, 0.005
"""Autocorrelation from which a residual is not noise; and its least size in ranges."""
_FALLS = (
    "the output falls as the input rises, which weights that are not negative cannot describe: "
    "reverse the sign of the output (reduce --flip output), or allow negative weights with "
    "signed=True (--law signed=yes)"
)


def _findings(fit: Fit) -> Iterator[str]:
    yield from map(str, fit.findings)


def _codes(fit: Fit) -> Iterator[str]:
    yield from map(str, fit.codes)


def _input_codes(fit: Fit) -> Iterator[str]:
    """Name sentinels among the inputs, which are fitted: memory depends on every input."""
    for fault in codes(fit.u, "input"):
        if len(fault.samples) <= max(fit.u.size // _RARE, 1):
            yield str(fault)


def _outliers(fit: Fit) -> Iterator[str]:
    """Name the outliers that were not fitted."""
    if fit.suspects:
        yield str(far_from_others(fit.y, np.array(fit.suspects)))


def _residual(fit: Fit) -> Iterator[str]:
    """Report start-up, step, drift and uneven errors of the residual."""
    found = fit.residual
    if found.startup is not None:
        first = "the first row is" if found.startup.rows == 1 else None
        first = first or f"the first {found.startup.rows} rows are"
        yield (
            f"{first} off by up to {found.startup.largest:.1%} of range and "
            f"{'has' if found.startup.rows == 1 else 'have'} {found.startup.share:.0%} of the "
            "squared error, a start-up that the model does not follow: let them set the memory "
            f"without fitting them, skip={found.startup.rows} "
            f"(--record skip={found.startup.rows}), or give the start state of the record"
        )
    large = fit.nrmse >= _LEAST_ERROR
    if large:
        yield from _starts(fit)
    if found.step is not None and abs(found.step.size) > _LEAST_DRIFT:
        yield (
            f"from sample {found.step.sample} on the output is shifted by {found.step.size:+.2%} "
            "of range: the sensor or its mount moved, or its zero was reset; identify the rows "
            "before and after separately (--record rows=A:B), or subtract the shift from the output"
        )
    if abs(found.drift) > _LEAST_DRIFT:
        yield (
            f"the output drifts by {abs(found.drift):.2%} of range along the record: let "
            "actuator and sensor warm up and measure again, or subtract the drift from the output"
        )
    if large:
        yield from _uneven(fit)


def _starts(fit: Fit) -> Iterator[str]:
    """Report a common error of the first rows of curves, as after another initial memory."""
    curves, start = fit.curves, fit.start
    if curves.begins.size == 1 or not isinstance(start, str):
        return
    rows = np.flatnonzero(fit.fitted)
    position = curves.positions(fit.u.size)
    length = np.diff(np.append(curves.begins, fit.u.size))
    # The first tenth of the rows of a curve. Their mean error is reported from 0.6 times the error
    # of all rows: without a common error it is far smaller
    first = rows[position[rows] * 10 < np.repeat(length, length)[rows]]
    if not first.size:
        return
    off = float((fit.prediction - fit.y)[first].mean()) / fit.span(fit.fitted)
    if abs(off) >= max(0.6 * fit.nrmse, _LEAST_ERROR):
        others = [name for name in ("negative", "positive", "demagnetised") if name != start]
        yield (
            f"the first rows of the curves have a common error, {-off:+.2%} of range in the mean: "
            f"the memory before them may not be {start!r}; try "
            f'start_of_curve="{others[1]}" or "{others[0]}" (--record start_of_curve)'
        )


def _uneven(fit: Fit) -> Iterator[str]:
    """Say in which groups, at which amplitudes and at which rates the error is large."""
    found = fit.residual
    if found.groups is not None:
        gain = found.groups.gain
        gains = f" and gains of up to {gain:.1%}" if gain else ""
        yield (
            f"the {found.groups.groups} groups differ from one another, by offsets of up to "
            f"{found.groups.offset:.2%} of range{gains}, which are {found.groups.share:.0%} of the "
            "squared error: no option of one model removes it; identify each group by itself "
            "(minorloop fleet), or correct the offset of the sensor"
        )
    for parts, small, large, todo in (
        (
            found.by_amplitude,
            "small loops",
            "large loops",
            "measure more loops of that size, or use more levels",
        ),
        (
            found.by_rate,
            "slow inputs",
            "fast inputs",
            "measure at the rate that you will use"
            + ("" if fit.searched else ', try lag="auto" (--law lag=auto)')
            + ", or add linear dynamics",
        ),
    ):
        # Ratio of amplitudes or rates below which they are all alike
        if len(parts) < PARTS or parts[-1][0] <= 1.5 * parts[0][1]:
            continue
        first, last = parts[0][2], parts[-1][2]
        # Ratio of the errors of parts that is reported
        if max(first, last) >= 2.5 * min(first, last):
            where = large if last > first else small
            yield (
                f"the error is {max(first, last):.2%} of range at {where} and "
                f"{min(first, last):.2%} at {large if where == small else small}: {todo}"
            )
    explained = found.groups or found.step or found.drift
    if found.autocorrelation > _ALIKE and not explained:
        yield (
            f"neighbouring residuals are alike (autocorrelation {found.autocorrelation:.2f}), so "
            f"they are an error of the model, not noise: {_remedy(fit)}"
        )


def _remedy(fit: Fit) -> str:
    if any(choice.name == "structure" for choice in fit.choices):
        more = (
            "; Dynamics() (--time COLUMN --law dynamics) shows whether rate or creep"
            if fit.measured is None
            else ""
        )
        return (
            "the options that were compared do not remove it, so it may depend on the rate, creep "
            f"or temperature{more}"
        )
    lag = "" if fit.searched else ' or lag="auto" (--law lag=auto)'
    return f'other levels, slope="auto" (--law slope=auto){lag} may reduce it'


def _lag(fit: Fit) -> Iterator[str]:
    """Report a lag that may be hysteresis, and the rows that it leaves out where curves begin."""
    if fit.lag and any(choice.chosen.endswith(TRAVEL) for choice in fit.choices):
        yield (
            f"the lag of {counted(fit.lag, 'sample')} may be hysteresis that this model does not "
            "have, because the input changes at one rate: at other rates the output may be "
            "predicted late; record at two rates, or give lag=0 (--law lag=0)"
        )
    if fit.lag and fit.curves.begins.size > 1:
        early = np.isfinite(fit.y) & (fit.curves.positions(fit.u.size) < fit.lag)
        out = int(np.count_nonzero(early)) - fit.skipped
        rows = out + int(np.count_nonzero(fit.fitted))
        if out > 0:
            yield (
                f"the lag of {counted(fit.lag, 'sample')} leaves {out} of {rows} samples out, "
                "at the beginnings of curves, because the inputs before them are not known; lag=0 "
                "(--law lag=0) fits all"
            )


def _excitation(fit: Fit) -> Iterator[str]:
    excited, cells = int(np.count_nonzero(fit.excited)), fit.matrix.spec.cells
    few = fit.samples < fit.unknowns
    if few and fit.posterior is not None:
        yield (
            f"{fit.samples} samples for {fit.unknowns} unknowns, {excited} of {cells} cells "
            f"excited, and {_pattern(fit)}: the prior determines the rest, and the bands show "
            "how accurately"
        )
    elif excited < _WELL_EXCITED * cells:
        yield (
            f"{excited} of {cells} cells of the plane are excited ({excited / cells:.0%}): "
            f"{_pattern(fit)}; weights elsewhere are guesses. Measure a decaying staircase "
            "(minorloop plan decaying) or reversal curves, or use fewer levels"
        )
    if few and fit.posterior is None:
        smooth = "set by the smoothness" if fit.smoothness else "arbitrary: use fewer levels"
        yield f"{fit.samples} samples for {fit.unknowns} unknowns: the rest is {smooth}"
    low, high = fit.model.levels[[0, -1]]
    beyond = int(np.count_nonzero((fit.u < low) | (fit.u > high)))
    # With dynamics, the levels are those of inputs with another filter.
    if beyond and fit.measured is None:
        yield (
            f"{counted(beyond, 'input')} {are(beyond)} beyond the levels [{low:g}, {high:g}], "
            "where the relays are saturated; widen the levels"
        )


def _pattern(fit: Fit) -> str:
    """Describe how the input covers the plane."""
    moving = fit.u[np.append(True, np.diff(fit.u) != 0)]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(moving)))) + 1
    levels = fit.matrix.spec.levels
    ends = (moving[turns] <= levels[1]) | (moving[turns] >= levels[-2])
    if ends.all():
        return "the input follows one major loop, which does not show minor loops"
    if fit.samples <= turns.size + 2:
        return "it was measured at its reversal points only"
    return "the input leaves parts of the plane untouched"


def _accuracy(fit: Fit) -> Iterator[str]:
    held_out, base = fit.holdout_accuracy, fit.baseline_nrmse
    span = fit.span(fit.fitted)
    if held_out is None and fit.groups_nrmse is not None:
        if fit.groups_nrmse > _OVERFIT * max(fit.nrmse, _ROUNDING):
            yield (
                f"the error on left-out groups ({percent(fit.groups_nrmse)}) is more than twice "
                f"that on fitted data ({percent(fit.nrmse)}): the groups differ, or are too few "
                f"for so many levels. {_of_another_group(fit)}"
            )
    elif held_out is None:
        yield (
            "no data were held out, so the error on other inputs is unknown; pass holdout=0.3 "
            "(--holdout 0.3)"
        )
    elif held_out.rmse > _OVERFIT * max(fit.rmse, _ROUNDING * span):
        yield (
            f"error on held-out data ({percent(held_out.nrmse)} of its range, "
            f"{percent(held_out.rmse / span)} of the fitted range) is more than twice "
            f"that on fitted data ({percent(fit.nrmse)}): fit inputs similar to those you will "
            "apply, or use fewer levels"
        )
    score, base = _scores_without_outliers(fit)  # as where the polynomial is better
    if base >= score > max(_NEARLY_AS_GOOD * base, _ROUNDING) and not _falls(fit):
        yield (
            f"a polynomial of the delayed input is nearly as good ({percent(base)} against "
            f"{percent(score)}): this record has little hysteresis, or it is hidden by noise"
        )


def _of_another_group(fit: Fit) -> str:
    """Say which error to expect for another group; groups that are not alike do not tell it."""
    usual, worst = np.quantile(fit.each_group_nrmse, [0.5, 1.0])
    # Ratio of the errors on the worst and the median group from which groups are not alike
    if worst <= 2.0 * usual:
        return "Expect that error for another group"
    return (
        f"They are not alike: it is {percent(usual)} for the median group and {percent(worst)} for "
        "the worst. Expect up to the latter for another group, and more for inputs that no group "
        "has; the bands include this"
    )


def _errors(fit: Fit) -> Iterator[str]:
    """Give warnings about the errors of the model."""
    score, base = _scores_without_outliers(fit)
    parts, expected = _parts(fit), _expected(fit)
    errors = [rms((fit.prediction - fit.y)[rows]) for rows in parts.values()]
    if expected > _WRONG or max(errors, default=0.0) > _WORST * _whole(fit):
        listed = [
            f"on {which} data is {percent(error / fit.span(rows))} of range"
            for error, (which, rows) in zip(errors, parts.items(), strict=True)
        ]
        without = "without the outliers, " if _has_outliers(fit) else ""
        more = f"; expect {expected:.0%} on other inputs, beyond noise" if expected > _WRONG else ""
        yield (
            f"{without}the error {' and '.join(listed)}{more}; the residual shows what the model "
            "cannot describe"
        )
    if _falls(fit):
        yield _FALLS
    elif _clockwise(fit):
        yield (
            "loops run clockwise: the output turns before the input, which weights that are not "
            "negative cannot describe. If the columns of input and output are exchanged, exchange "
            "them; otherwise allow negative weights with signed=True (--law signed=yes)"
        )
    elif score > base and score > _ROUNDING:
        yield (
            f"a polynomial of the delayed input is better ({percent(base)} "
            f"against {percent(score)}): the hysteresis here is weak or rate-dependent; try "
            f"{_untried(fit)}"
        )


def _untried(fit: Fit) -> str:
    """Name the options that were neither set nor compared."""
    compared = {choice.name for choice in fit.choices}
    options = [] if fit.searched else ['lag="auto" (--law lag=auto)']
    if not fit.matrix.spec.slope and "structure" not in compared:
        options.append("slope=True (--law slope=yes)")
    if _is_positive(fit):
        options.append(
            "signed=True (--law signed=yes) where the output both rises and falls along a branch, "
            "as in butterfly loops"
        )
    return " and ".join(options) or "dynamics, or inputs at one rate"


def _known(fit: Fit) -> BoolArray:
    """(T,) measured rows without outliers."""
    known: BoolArray = np.isfinite(fit.y)
    for finding in fit.findings:
        if finding.kind == "outlier":
            known[list(finding.samples)] = False
    return known


def _has_outliers(fit: Fit) -> bool:
    return any(finding.kind == "outlier" for finding in fit.findings)


def _parts(fit: Fit) -> dict[str, BoolArray]:
    """Fitted and held-out rows without outliers; parts without rows are left out."""
    parts = {"fitted": fit.fitted & _known(fit), "held-out": fit.held_out & _known(fit)}
    return {name: rows for name, rows in parts.items() if rows.any()}


def _whole(fit: Fit) -> float:
    """Range of the output in fitted and held-out rows without outliers."""
    return float(fit.span(fit.scored & _known(fit)))


def _scores_without_outliers(fit: Fit) -> tuple[float, float]:
    """Errors of model and polynomial over the range, on held-out rows or else on fitted rows."""
    scored = fit.held_out if fit.held_out.any() else fit.fitted
    known = _known(fit)
    if not (scored & known).any():
        return 0.0, 0.0
    scored = scored & known
    base = fit.baseline_nrmse
    if (fit.held_out | fit.fitted)[~known].any():
        base = polynomial_nrmse(fit.u, fit.y, fit.fitted & known, scored, fit.curves)
    return rms((fit.prediction - fit.y)[scored]) / fit.span(scored), base


def _expected(fit: Fit) -> float:
    """Error to expect on other inputs without noise, over the range of the output.

    It is the greatest of: twice the error on fitted data (four times with a lag); the error on
    held-out data; and the error on held-out data over their own range, as far as it is more than
    twice the noise, because their range may be small.
    """
    parts, error = _parts(fit), fit.prediction - fit.y
    square = {x: float(np.mean(error[parts[x]] ** 2)) for x in parts}
    fitted, held_out = square.get("fitted", 0.0), square.get("held-out", 0.0)
    noise = noise_in(error[parts["fitted"]], fit.y[parts["fitted"]]) ** 2 if fitted else 0.0
    own = fit.span(parts["held-out"]) if held_out else 1.0
    # Largest ratio of the errors on other inputs and on fitted data if a lag was found: a filter is
    # not a pure lag, and its error grows with the rate
    more = 4.0 if fit.lag else _OVERFIT
    beyond = (
        (more**2 * (fitted - noise), fit.span(fit.fitted)),
        (held_out - noise, _whole(fit)),
        (held_out - _OVERFIT**2 * noise, own),
    )
    return max(float(np.sqrt(max(excess, 0.0))) / span for excess, span in beyond)


def _is_positive(fit: Fit) -> bool:
    """Whether no weight is negative."""
    return bool((fit.model.weights >= 0).all())


def _falls(fit: Fit) -> bool:
    """Whether the output falls as the input rises, but no weight is negative."""
    u, y = fit.u[fit.fitted], fit.y[fit.fitted]
    varied = np.ptp(u) > 0 and np.ptp(y) > 0
    against = float(np.corrcoef(u, y)[0, 1]) < _FALLING if varied else False
    return against and _is_positive(fit)


def _clockwise(fit: Fit) -> bool:
    """Whether the output comes before the input, but no weight is negative."""
    known = fit.fitted & _known(fit)
    late = lateness(fit.u, fit.y, known, fit.curves)
    # The output comes before the input from these values of its lateness, and of its lateness in
    # standard deviations
    sure = late * np.sqrt(np.count_nonzero(known)) < -4.0
    return late < -0.5 and bool(sure) and _is_positive(fit)


def _numerics(fit: Fit) -> Iterator[str]:
    if fit.kkt > active_set.ACCEPTABLE:
        yield (
            f"the fit did not converge: the solver stopped at an optimality of {fit.kkt:.1e}, "
            f"above {active_set.ACCEPTABLE:.0e}; this is the best solution it found. Use fewer "
            "levels or a positive smoothness"
        )
    elif not fit.converged:
        yield (
            "the fit did not converge: the record hardly determines some of the weights, and "
            f"other values reduce the squared error by more than {UNSETTLED:.0e}. Use "
            "fewer levels or a positive smoothness"
        )
    if not fit.model.monotone:
        yield (
            "the model is not monotone: it predicts, and cannot be inverted, because several "
            "inputs may give one output. Only signed=False (--law signed=no) gives a model that "
            "can be inverted, of the part of the output that rises with the input"
        )


WARNINGS = (_findings, _input_codes, _errors)
"""Rules about models that are not to be trusted; each gives sentences about a fit."""
REMARKS = (_codes, _outliers, _residual, _lag, _excitation, _accuracy, _numerics)
"""Other rules, most important first."""


def fault_warnings(fit: Fit) -> Iterator[str]:
    """Give the advice about faults of actuator, sensor or sign."""
    for rule in (_findings, _codes, _outliers):
        yield from rule(fit)
    if _falls(fit):
        yield _FALLS

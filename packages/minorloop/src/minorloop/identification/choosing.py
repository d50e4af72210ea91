"""Errors on left-out parts of a record, which choose options and validate a fit.

A part is a group of rows if the record has groups. Otherwise it is contiguous, because neighbouring
samples of a record are alike. Each candidate is fitted without one part, and scored on that part.
Structures are compared on a coarse plane, where a fit takes milliseconds. For validation the final
structure is fitted, and smoothness or hyperparameters are chosen again. Unlike the residuals of one
fit, errors on groups contain the differences between curves, days or specimens.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from minorloop.arrays import FloatArray, IntArray, Levels
from minorloop.errors import ParameterError, counted
from minorloop.identification import fitting
from minorloop.identification.baseline import percent
from minorloop.identification.curves import Curves
from minorloop.identification.design_matrix import PlaneSpec
from minorloop.identification.fitting import FitRecord, FittedPlane, are_few, coarser_spec
from minorloop.identification.least_squares import Problem
from minorloop.identification.residuals import find_startup

PARTS = 5
"""Contiguous parts of a record without groups; if there are more groups, some are combined."""
FOLDS = 10
"""Most validation fits, each without a part of the groups."""
FEWEST_GROUPS = 3
"""Groups below which their scatter is not estimated."""
_SEGMENTS = 5
"""Contiguous segments of each part, for the lag and the levels, which need no extrapolation."""
LEVELS = 25
"""Bands with which ``levels="auto"`` begins; it compares twice as many."""
_MOST_ROWS = 40_000
"""Number of first samples on which options are compared."""
_COARSE_BANDS = 15
_SAMPLES_EACH = 2
"""Samples for each cell of the coarse plane."""
_FEWEST = 100
"""Least samples to compare options on: the parts of a shorter record are unlike one another."""
_STRENGTHS = (0.0, 1e-6, 1e-4)
_PROMISING = 0.9
"""Ratio of the error to that of a coarse plane below which more levels are tried."""
_FEWER_PARTS = 3
"""Number of parts to score fine planes on."""
_BETTER, _BETTER_LAG = 0.95, 0.8
"""Ratios of errors below which another option replaces the simplest option: any option, a lag."""
_TRAVELS, _UNSURE = (0.5, 1.0, 1.5), 1 / 3
"""Travels of the input over its mean travel during the lag; and the ratio of errors for a lag that
is no better than a delay by such a travel. With inputs at one rate, the two delays are alike."""
TRAVEL = ", or as much travel of the input"
"""End of the name of a lag that is no better than a delay by a travel of the input."""


@dataclass(frozen=True)
class Choice:
    """An option that was chosen by the error on left-out parts."""

    name: str
    """The option."""
    chosen: str
    error: float
    """What was chosen, and its error on left-out parts, over the range of the output."""
    other: str
    other_error: float
    """The best of the others, and its error."""

    def __str__(self) -> str:
        kept = ", not clearly better" if self.other_error < self.error else ""
        return (
            f"{self.name}: {self.chosen}, {percent(self.error)} of range on left-out parts; "
            f"{self.other}: {percent(self.other_error)}{kept}"
        )


@dataclass(frozen=True, eq=False)
class Chosen:
    """Structure and lag, and the choices that led to them."""

    spec: PlaneSpec
    lag: int
    choices: tuple[Choice, ...]


def parts_of(record: FitRecord, groups: IntArray | None, segments: int = 1) -> IntArray:
    """(T,) number of the part of each fitted row; -1 elsewhere, and in a start-up.

    A start-up would hide the differences between the candidates. If a record has no groups, or all
    compared rows are of one group, each part consists of contiguous segments.
    """
    fold = np.full(record.u.size, -1)
    rows = np.flatnonzero(record.fitted)
    names = np.zeros(0) if groups is None else np.unique(groups[rows])
    if groups is None or names.size < 2:
        fold[rows] = np.arange(rows.size) * PARTS * segments // max(rows.size, 1) % PARTS
        return fold
    fold[rows] = np.searchsorted(names, groups[rows]) % min(names.size, PARTS)
    return fold


def check_several_groups(groups: IntArray) -> IntArray:
    """Return the numbers of the groups of the fitted rows, two or more.

    Raises a `ParameterError` if all rows are of one group.
    """
    names = np.unique(groups)
    if names.size < 2:
        raise ParameterError(
            "all fitted rows are of one group, and no group can be left out; give two or more "
            "groups, or omit groups (--record groups=COLUMN)"
        )
    return names


def folds(groups: IntArray, rows: IntArray) -> IntArray:
    """(T,) number of the fold of each row; folds contain whole groups.

    Raises a `ParameterError` if ``rows``, which are fitted, are of one group.
    """
    names = check_several_groups(groups[rows])
    return np.searchsorted(names, groups) % min(names.size, FOLDS)


def validate(
    record: FitRecord,
    found: FittedPlane,
    lag: int,
    groups: IntArray,
    say: Callable[[str], None] = lambda stage: None,
) -> FloatArray:
    """(T,) outputs predicted by fits without the group of each row; NaN for rows not fitted.

    Raises a `ParameterError` if all fitted rows are of one group.

    ``record``: the record; ``found``: the fit to all groups; ``lag``: its lag; ``groups`` (T,) of
    int: number of the group of each row; ``say``: called with the next step.
    """
    rows = replace(record, fitted=found.fitted).rows(lag)
    fold, regression = folds(groups, rows), found.regression
    predicted = np.full(record.u.size, np.nan)
    names = np.unique(fold[rows])
    for count, k in enumerate(names, 1):
        say(f"leaving out groups, fit {count} of {names.size}")
        x = found.without(fold[regression.rows] == k, record)
        y = record.curves.simulate(regression.matrix.spec.model(x), record.u, lag)
        left = rows[fold[rows] == k]
        predicted[left] = y[left]
    return predicted


def _without_startup(spec: PlaneSpec, record: FitRecord) -> FitRecord:
    """Return the record without a start-up that a coarse fit does not follow."""
    found = fitting.fit_smooth(_coarse(spec, record), record, 0, 0.0)
    regression = found.regression
    span = float(np.ptp(regression.y)) or 1.0
    error = (regression.matrix.forward(found.x) - regression.y) / span
    startup = find_startup(error, regression.rows)
    if startup is None:
        return record
    fitted = record.fitted & (np.arange(record.u.size) >= startup.rows)
    return replace(record, fitted=fitted)


def choose(
    specs: Sequence[PlaneSpec],
    record: FitRecord,
    lag: int | None,
    groups: IntArray | None,
    finer: Levels | None,
    say: Callable[[str], None] = lambda stage: None,
) -> Chosen:
    """Choose the structure, the lag and the levels.

    ``specs``: structures to compare, the simplest first, on the same levels; ``record``: the
    record; ``lag``: the lag; None compares 0 and the best up to 20; ``groups`` (T,) of int: number
    of the group of each row; ``finer``: other levels to compare; ``say``: called with the next
    step.
    """
    spec, choices = specs[0], []
    if np.count_nonzero(record.fitted) < _FEWEST:
        return Chosen(spec, lag or 0, ())
    settled = _without_startup(spec, _first(record))
    groups = None if groups is None else groups[: settled.u.size]
    if lag is None:
        say("comparing lags")
        lag, found = _choose_lag(specs, settled, groups)
        choices += found
    settled = settled.left_by(lag)
    fold, spread = parts_of(settled, groups), parts_of(settled, groups, _SEGMENTS)
    if len(specs) > 1:
        errors = {}
        for count, one in enumerate(specs, 1):
            say(f"comparing structures, {count} of {len(specs)}: {structure(one)}")
            errors[structure(one)] = error(_coarse(one, settled), settled, lag, fold)
        choices.append(compared("structure", errors, structure(spec)))
        spec = next(one for one in specs if structure(one) == choices[-1].chosen)
    if finer is not None:
        other = replace(spec, levels=finer)
        spec, found = _choose_levels(spec, other, settled, lag, spread, say)
        choices += found
    return Chosen(spec, lag, tuple(choices))


def _first(record: FitRecord) -> FitRecord:
    """Return the first samples of a long record, which are enough to compare options."""
    rows = np.flatnonzero(record.fitted)
    if rows.size <= _MOST_ROWS:
        return record
    size = int(rows[_MOST_ROWS])
    curves = Curves(record.curves.begins[record.curves.begins < size], record.curves.start)
    sd = None if record.sd is None else record.sd[:size]
    u, y, fitted = record.u[:size], record.y[:size], record.fitted[:size]
    return replace(record, u=u, y=y, fitted=fitted, curves=curves, sd=sd)


def structure(spec: PlaneSpec) -> str:
    """Return the structure of a plane in words."""
    slope = " with slope" if spec.slope else ""
    return f"{spec.diagonal} diagonal{slope}"


def _choose_lag(
    specs: Sequence[PlaneSpec], record: FitRecord, groups: IntArray | None
) -> tuple[int, list[Choice]]:
    """Compare no lag with the best lag on the samples that the lag leaves.

    A lag compensates for bands that are too wide, and for a wrong structure. So both are compared
    with narrower bands, each with its best structure. A lag also compensates for hysteresis that is
    not a plane but does not depend on the rate. A delay by a travel of the input, which does not
    depend on the rate either, is then as good.
    """
    lag = fitting.best_lag(_coarse(specs[-1], record), record)
    if not lag:
        return 0, []
    record = record.left_by(lag)
    if np.count_nonzero(record.fitted) < _FEWEST:
        return 0, []
    fold = parts_of(record, groups, _SEGMENTS)
    few = are_few(specs[-1], int(np.count_nonzero(record.fitted)))
    finer = [_coarse(one, record) if few else coarser_spec(one, LEVELS) for one in specs]

    def least(record: FitRecord, lag: int) -> float:
        return min(error(one, record, lag, fold, _STRENGTHS[1:2], _FEWER_PARTS) for one in finer)

    none, late, better = "0 samples", counted(lag, "sample"), _BETTER_LAG
    errors = {none: least(record, 0), late: least(record, lag)}
    if errors[late] < better * errors[none]:
        steps = np.abs(np.diff(record.u))
        travels = lag * float(steps[steps > 0].mean()) * np.array(_TRAVELS)
        delayed = (record.curves.travelled(record.u, travel) for travel in travels)
        if errors[late] >= better * min(least(replace(record, u=u), 0) for u in delayed):
            errors[late + TRAVEL], better = errors.pop(late), _UNSURE
    choice = compared("lag", errors, none, better)
    return (0 if choice.chosen == none else lag), [choice]


def _choose_levels(
    spec: PlaneSpec,
    finer: PlaneSpec,
    record: FitRecord,
    lag: int,
    fold: IntArray,
    say: Callable[[str], None],
) -> tuple[PlaneSpec, list[Choice]]:
    """Compare more levels, but only if the given levels are better than a coarse plane."""
    coarse = _coarse(spec, record)
    if are_few(finer, record.rows(lag).size) or coarse.bands == spec.bands:
        return spec, []
    specs, errors = {}, {}
    for one in (coarse, spec, finer):
        name = f"{one.bands} bands"
        say(f"comparing levels: {name}")
        specs[name] = one
        errors[name] = error(one, record, lag, fold, _STRENGTHS[1:2], _FEWER_PARTS)
        if one is spec and errors[name] > _PROMISING * errors[f"{coarse.bands} bands"]:
            break
    chosen, other = f"{spec.bands} bands", f"{coarse.bands} bands"
    if len(specs) == 2:
        return spec, [Choice("levels", chosen, errors[chosen], other, errors[other])]
    del errors[other]
    choice = compared("levels", errors, chosen)
    return specs[choice.chosen], [choice]


def compared(
    name: str, errors: Mapping[str, float], simplest: str, better: float = _BETTER
) -> Choice:
    """Choose the least error, or the simplest option unless its error falls below ``better``."""
    ranked = sorted(errors, key=lambda one: errors[one])
    nearly = errors[ranked[0]] >= better * errors[simplest]
    chosen = simplest if nearly else ranked[0]
    other = next(one for one in ranked if one != chosen)
    return Choice(name, chosen, errors[chosen], other, errors[other])


def _coarse(spec: PlaneSpec, record: FitRecord) -> PlaneSpec:
    """Return the structure on so few bands that the samples determine them."""
    samples = np.count_nonzero(record.fitted)
    bands = int(np.clip(np.sqrt(2 * samples / _SAMPLES_EACH), 3, _COARSE_BANDS))
    return coarser_spec(spec, bands)


def error(
    spec: PlaneSpec,
    record: FitRecord,
    lag: int,
    fold: IntArray,
    strengths: Sequence[float] = _STRENGTHS,
    parts: int = PARTS,
) -> float:
    """Error on left-out parts over the range; the fitted parts choose the strength."""
    regression = record.regression(spec, lag, fold)
    part = fold[regression.rows]
    counts = regression.matrix.counts
    weight = np.ones(part.size) if counts is None else counts
    problem = Problem(regression.matrix, regression.y, record.signed, rough=True)
    square, scored = 0.0, 0.0
    x = None
    for k in np.unique(part)[:parts]:
        left = part == k
        # Without smoothing, cells without samples would keep the weights of the previous part.
        x = problem.fit_part(~left, strengths, guess=x if len(strengths) == 1 else None)
        off = (regression.matrix.forward(x) - regression.y)[left]
        square += float(weight[left] @ off**2)
        scored += float(weight[left].sum())
    mean = square / scored + regression.within
    return float(np.sqrt(mean)) / (float(np.ptp(regression.y)) or 1.0)

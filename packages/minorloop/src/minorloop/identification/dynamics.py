"""Identify a hysteresis operator together with dead time, linear dynamics and creep.

Structures are compared on left-out pieces of the record (`dynamic_search`); each is fitted by
alternation between operator and dynamics (`alternation`). The dynamics are a dead time and up to
three poles without zeros, so that their inverse is stable. Options of the operator that are
"auto" are chosen by the error of the whole model, because the record without the dynamics has more
noise.
"""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from minorloop.arrays import check_option
from minorloop.dynamics.cascade import First
from minorloop.errors import ParameterError
from minorloop.identification import record_checks as checks
from minorloop.identification.alternation import Found, Static, alternate, without
from minorloop.identification.choosing import Choice
from minorloop.identification.dynamic_parts import DynamicRecord
from minorloop.identification.dynamic_result import DynamicIdentification, TriedDynamics
from minorloop.identification.dynamic_search import better, near, search, simplest, with_creep
from minorloop.identification.fit import identify
from minorloop.identification.preparation import NOTHING, moving_samples
from minorloop.identification.result import Identification
from minorloop.lab.logs import Log
from minorloop.lab.records import Record
from minorloop.threads import one_thread

MOST_POLES = 3
_MOST_ROWS = 40_000
"""Samples, the first ones, that dynamics are compared on."""
_BANDS, _FINER = 25, 50
"""Most bands with which dynamics are compared, and bands that are tried after that."""
_FINER_IS_BETTER = 0.98
"""Ratio of the errors below which more bands are worth their time."""
_LEAST_DELAY = 1e-3
"""Dead time in samples that counts as none with poles."""
_MOST_NOISE = 0.5
"""Largest noise of a model, over the range, by trial. The inverse is filtered from the frequency at
which the gain is as low as the noise; with the gain at rest, 1, nothing would pass."""
_WORSE = 1.02
"""Ratio of the errors on left-out pieces above which a start-up spoils the model."""
_UNLIKE = 4.0
"""Error of a start-up, over that on left-out pieces, above which the other rows do not predict it.
By trial: a start-up like the others has up to three times their error, because it reaches further.
"""
_STRUCTURES: tuple[dict[str, Any], ...] = (
    {"diagonal": "reversible", "slope": False},
    {"diagonal": "uniform", "slope": True},
    {"diagonal": "uniform", "slope": False},
)
"""Planes that are compared; the reversible diagonal contains a slope."""
_OF_THE_RECORD = ("holdout", "skip")
_REFUSED = ("lag", "curves", "start_of_curve", "groups")


def identify_dynamics(
    t: npt.ArrayLike | Log | Record,
    u: npt.ArrayLike | None = None,
    y: npt.ArrayLike | None = None,
    *,
    first: Literal["auto", "operator", "linear"] = "auto",
    poles: int | Literal["auto"] = "auto",
    creep: bool | Literal["auto"] = "auto",
    **options: Any,
) -> DynamicIdentification:
    """Identify a hysteresis operator, dead time, linear dynamics and creep from one record.

    What is ``"auto"`` is chosen by the error of the whole model on pieces of the record that are
    left out, a fifth of it: another parameter must reduce it by 2 %, and by more than chance does.
    Poles may be before the operator, behind it, or on both sides. Rows before the input has been
    near both ends of its range are not compared, because the memory may be another one than
    ``start="negative"`` says; they are fitted only if that makes the other rows no worse.

    Parameters
    ----------
    t : (T,) array_like, Log or Record
        Evenly spaced times in seconds; or a record with times, inputs and outputs, as
        `minorloop.read` returns it, which is resampled where its times are not even. At the first
        time, the output is at rest, and the memory is that of ``start``: move the actuator over its
        whole range and back before. Another start than ``"negative"`` is not checked.
    u : (T,) array_like
        Inputs; u[k] is applied from the sample before.
    y : (T,) array_like
        Outputs; NaN where nothing was measured.
    first : {"auto", "operator", "linear"}
        Which of operator and linear dynamics receives the input; ``"auto"`` compares both, and
        poles on both sides.
    poles : int or "auto"
        Number of poles, 0 to 3. A dead time is fitted with any number.
    creep : bool or "auto"
        Whether to fit creep of the output.
    **options
        Options of `identify` for the operator; not ``lag``, ``curves`` and ``groups``. Diagonal
        and slope are ``"auto"`` if not given.

    Raises
    ------
    SignalError
        As `identify`; if the times are not even, or fewer than 100 outputs are fitted.
    ParameterError
        If an option is out of its range.

    References
    ----------
    Fixed operator, free dynamics: Ljung, System Identification, 2nd edition, 1999, section 7.4,
    output error. Alternation for a static map and dynamics in series: section 10.1 there.
    """
    told = NOTHING
    if isinstance(t, Log | Record):
        t, u, y, told = moving_samples(t if isinstance(t, Log) else Log.of(t), options)
    if u is None or y is None:
        raise ParameterError("u or y is missing; give times, inputs and outputs, or a record")
    check_option("first", first, ("auto", "operator", "linear"))
    if creep != "auto":
        checks.check_flags(creep=creep)
    if poles != "auto" and (isinstance(poles, bool) or poles not in range(MOST_POLES + 1)):
        raise ParameterError(f'poles is {poles!r}; give "auto" or 0 to {MOST_POLES}')
    refused = next((name for name in _REFUSED if name in options), None)
    if refused is not None:
        raise ParameterError(
            f"{refused} cannot be combined with dynamics; leave it out, or reduce the record to "
            "settled points and identify the operator from them"
        )
    record = DynamicRecord.of(t, u, y, options)
    fields = {"diagonal": "auto", "slope": "auto", "lag": 0}
    fields |= {name: value for name, value in options.items() if name not in _OF_THE_RECORD}
    static = _fitter(_coarse(fields))
    short = record.part(_MOST_ROWS).with_pieces()
    startup = short.startup if isinstance(record.start, str) and record.start == "negative" else 0
    order: First | None = None if first == "auto" else first
    count = None if poles == "auto" else int(poles)
    with one_thread():
        later = short.without(startup)
        tried = search(later, order, count, MOST_POLES, static)
        best = simplest(tried)
        if creep:
            crept = with_creep(later, tried, best, static, creep is True)
            best = simplest(crept) if crept else best
            tried = [*tried, *crept]
        spoilt, unlike = _startup(short, best, static) if startup else (False, False)
        skipped = startup if spoilt else 0
        found, operator = _refined(record.without(skipped), short.without(skipped), best, fields)
    return DynamicIdentification(
        model=replace(found.dynamics.cascade(found.operator), noise=min(found.error, _MOST_NOISE)),
        static=operator,
        t=record.t,
        u=record.u,
        y=record.y,
        fitted=found.record.fitted,
        held_out=record.held_out,
        tried=tuple(_summary(one, best) for one in tried),
        startup=startup if spoilt or unlike else 0,
        startup_fitted=not spoilt,
        told=told,
    )


def _summary(one: Found, best: Found) -> TriedDynamics:
    """Return what is kept of a fit that was tried."""
    ahead, behind, creep = one.dynamics.structure
    return TriedDynamics(
        ahead,
        behind,
        round(one.dynamics.delay, 3) * one.dynamics.interval,
        creep,
        one.left_out_error,
        one is best,
        one is not best and near(one, best),
    )


def _startup(record: DynamicRecord, best: Found, static: Static) -> tuple[bool, bool]:
    """Whether the start-up spoils the model of the other rows, and whether it is unlike them.

    The start-up of a virgin actuator has a memory that no later row has. Where no later row is
    like it, it spoils nothing, and nothing shows whether it is right.
    """
    creeping = best.dynamics.creep is not None
    with_it = alternate(record, best.dynamics, static, best.operator, creeping=creeping)
    with_it = replace(with_it, record=best.record)  # scored on the same pieces
    worse = with_it.left_out_error > _WORSE * best.left_out_error
    first = record.fitted & ~best.record.fitted
    predicted = best.dynamics.outputs(record, best.operator)
    unlike = record.error(predicted, first) > _UNLIKE * best.left_out_error
    return worse and better(best, with_it), unlike


def _coarse(options: dict[str, Any]) -> dict[str, Any]:
    """Return options of a quick fit of the operator, with which dynamics are compared.

    Where they are not given, the diagonal is reversible, which has the smallest errors.
    """
    levels = options.get("levels", "auto")
    bands = np.size(levels) - 1 if np.ndim(levels) else levels
    given = {
        name: value
        for name in ("signed", "offset", "start", "relay", "diagonal", "slope")
        if (value := options.get(name, "auto")) != "auto"
    }
    return (
        {"diagonal": "reversible", "slope": False, "lag": 0}
        | given
        | {
            "levels": _BANDS if bands == "auto" or bands > _BANDS else levels,
            "smoothness": 0.0,
            "prior": "none",
        }
    )


def _fitter(options: dict[str, Any]) -> Static:
    """Return the identification of an operator with these options."""
    return lambda u, y: identify(u, y, **options)


def _planes(
    record: DynamicRecord, best: Found, options: dict[str, Any]
) -> tuple[dict[str, Any], tuple[Choice, ...]]:
    """Return options of the operator with diagonal, slope and levels chosen, and the choices.

    Each candidate is fitted without the left-out pieces of the record, and the whole model is
    scored on them.
    """
    given = {name: value for name in ("diagonal", "slope") if (value := options[name]) != "auto"}
    structures: list[dict[str, Any]] = []
    for one in _STRUCTURES:
        if (one | given) not in structures:
            structures.append(one | given)
    known = without(best.dynamics, record, best.operator)

    def error(more: dict[str, Any]) -> float:
        result = identify(*known, **_coarse(options | more) | more)
        prediction = best.dynamics.outputs(record, result.model)
        return float(np.sqrt(np.mean(record.squares(prediction))))

    errors = {_structure(one): error(one) for one in structures}
    chosen = next(
        one for one in structures if _structure(one) == min(errors, key=errors.__getitem__)
    )
    choices = [] if len(errors) == 1 else [_choice("structure", errors, _structure(chosen))]
    levels = options.get("levels", "auto")
    if isinstance(levels, str):
        own, finer = errors[_structure(chosen)], error(chosen | {"levels": _FINER})
        levels = _FINER if finer < _FINER_IS_BETTER * own else _BANDS
        bands = {f"{_BANDS} bands": own, f"{_FINER} bands": finer}
        choices.append(_choice("levels", bands, f"{levels} bands"))
    return options | chosen | {"levels": levels}, tuple(choices)


def _structure(plane: dict[str, Any]) -> str:
    return f"{plane['diagonal']} diagonal{' with slope' if plane['slope'] else ''}"


def _choice(name: str, errors: dict[str, float], chosen: str) -> Choice:
    other = min((one for one in errors if one != chosen), key=errors.__getitem__)
    return Choice(name, chosen, errors[chosen], other, errors[other])


def _refined(
    record: DynamicRecord, pieces: DynamicRecord, best: Found, options: dict[str, Any]
) -> tuple[Found, Identification]:
    """Fit the whole record with the operator that the options ask for.

    Options that are "auto" are chosen once, on the record with left-out pieces. Returns the fit,
    and the operator with what it alone would have given plus the residual.
    """
    options, choices = _planes(pieces, best, options)
    chosen = identify(*without(best.dynamics, record, best.operator), **options)
    spec, banded = chosen.matrix.spec, chosen.posterior is not None
    plane = options | {
        "levels": spec.levels,
        "spacing": "uniform",
        "relay": spec.relay,
        "diagonal": spec.diagonal,
        "slope": spec.slope,
    }
    smoothness = 0.0 if banded else chosen.smoothness
    static = _fitter(plane | {"prior": "none", "smoothness": smoothness})
    creeping = best.dynamics.creep is not None
    found = alternate(record, best.dynamics, static, best.operator, creeping=creeping)
    if banded:
        known = without(found.dynamics, record, found.operator)
        result = identify(*known, **plane | {"prior": "gaussian"})
        y = found.dynamics.outputs(record, result.model)
        found = replace(found, result=result, error=record.error(y, record.fitted))
    if found.dynamics.delay < _LEAST_DELAY:
        found = replace(found, dynamics=replace(found.dynamics, delay=0.0))
    dynamics, finite = found.dynamics, np.isfinite(record.y)
    u = dynamics.before(record.u)
    residual = record.y - dynamics.outputs(record, found.operator)
    operator = replace(
        found.result,
        u=u,
        y=found.operator.simulate(u, record.start) + residual,
        fitted=record.fitted,
        held_out=record.held_out,
        skipped=int(np.count_nonzero(finite & ~record.fitted & ~record.held_out)),
        choices=(*choices, *chosen.choices),
        codes=record.codes,
        searched=True,
        measured=record.y,
        told=NOTHING,
    )
    return found, operator

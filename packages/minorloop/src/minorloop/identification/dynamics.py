"""Identify a hysteresis operator together with dead time, linear dynamics and creep.

Structures are compared on left-out pieces of the record (`dynamic_search`); each is fitted by
alternation between operator and dynamics (`alternation`). The dynamics are a dead time and up to
three poles without zeros, so that their inverse is stable. Options of the operator that are
"auto" are chosen by the error of the whole model, because the record without the dynamics has more
noise.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from minorloop.arrays import check_option
from minorloop.dynamics.cascade import First
from minorloop.errors import ParameterError
from minorloop.identification import record_checks as checks
from minorloop.identification.alternation import Found, Static, alternate, without
from minorloop.identification.choosing import Choice, compared, structure
from minorloop.identification.dynamic_parts import DynamicRecord
from minorloop.identification.dynamic_result import DynamicIdentification, TriedDynamics
from minorloop.identification.dynamic_search import better, near, search, simplest, with_creep
from minorloop.identification.fit import Plane, Say, silent
from minorloop.identification.plane_result import Identification
from minorloop.identification.preparation import NOTHING, moving_samples
from minorloop.identification.prior import Gaussian, Prior, Smooth
from minorloop.lab.records import Record
from minorloop.threads import one_thread

_MOST_POLES = 3
_MOST_ROWS = 40_000
"""Number of first samples on which dynamics are compared."""
_BANDS, _FINER = 25, 50
"""Most bands with which dynamics are compared, and bands that are tried after that."""
_MOST_NOISE = 0.5
"""Largest noise of a model, over the range, by trial. The inverse is filtered from the frequency at
which the gain is as low as the noise; a noise of 1, the gain at rest, would block all frequencies.
"""


@dataclass(frozen=True, eq=False)
class Dynamics:
    """The law of a plane with dead time, linear dynamics and creep.

    Options that are ``"auto"`` are chosen by the error of the whole model on left-out pieces, a
    fifth of the record. Another parameter must reduce it by 2 %, and by more than chance. Poles may
    be before the operator, behind it, or on both sides. Rows before the input has been near both
    ends of its range are not compared, because their memory may differ from ``start="negative"``;
    they are fitted only if that makes the other rows no worse.

    The record needs times, and is resampled if they are not even. u[k] is applied from the previous
    sample. At the first time, the output is at rest, and the memory is that of ``start``: move the
    actuator over its whole range and back before the record. A start other than ``"negative"`` is
    not checked.

    References
    ----------
    Fixed operator, free dynamics: Ljung, System Identification, 2nd edition, 1999, section 7.4,
    output error. Alternation for a static map and dynamics in series: section 10.1 there.

    Examples
    --------
    >>> t = 0.1 * np.arange(400)
    >>> u = np.sin(t) * np.linspace(1.0, 0.2, 400)
    >>> y = ml.Linear.lags(0.5).simulate(t, u)
    >>> law = ml.Dynamics(ml.Plane(4), first="operator", poles=1, creep=False)
    >>> ml.identify(ml.Record(u, y, t), law).times.round(1).tolist()
    [0.5]
    """

    plane: Plane = field(default_factory=Plane)
    """The operator; its lag is 0."""
    first: Literal["auto", "operator", "linear"] = "auto"
    """The part that receives the input; ``"auto"`` compares both, and poles on both sides."""
    poles: int | Literal["auto"] = "auto"
    """Number of poles, 0 to 3. A dead time is always fitted."""
    creep: bool | Literal["auto"] = "auto"
    """Whether to fit creep of the output."""

    def identify(
        self, record: Record, prior: Prior = "auto", holdout: float = 0.0, say: Say = silent
    ) -> DynamicIdentification:
        """Identify operator and dynamics, as `minorloop.identify`.

        Raises a `SignalError` as `minorloop.identify`; if fewer than 100 outputs are fitted; a
        `ParameterError` if an option is out of its range, or the record has labels or no times.
        """
        even, told = moving_samples(record)
        first, poles, creep = self.first, self.poles, self.creep
        check_option("first", first, ("auto", "operator", "linear"))
        if creep != "auto":
            checks.check_flags(creep=creep)
        if poles != "auto" and (isinstance(poles, bool) or poles not in range(_MOST_POLES + 1)):
            raise ParameterError(f'poles is {poles!r}; give "auto" or 0 to {_MOST_POLES}')
        if not isinstance(self.plane, Plane):
            raise ParameterError(f"plane is {self.plane!r}; give a Plane")
        if self.plane.lag not in ("auto", 0):
            raise ParameterError(
                "lag cannot be combined with dynamics, which find the dead time; omit lag"
            )
        moving = DynamicRecord.of(even, holdout)
        plane = replace(self.plane, lag=0)
        static = _fitter(_coarse(plane), Smooth(0.0), moving)
        short = moving.part(_MOST_ROWS).with_pieces()
        virgin = isinstance(moving.start, str) and moving.start == "negative"
        startup = short.startup if virgin else 0
        order: First | None = None if first == "auto" else first
        count = None if poles == "auto" else int(poles)
        with one_thread():
            say("comparing dynamics")
            later = short.without(startup)
            tried = search(later, order, count, _MOST_POLES, static)
            best = simplest(tried)
            if creep:
                say("comparing creep")
                crept = with_creep(later, tried, best, static, creep is True)
                best = simplest(crept) if crept else best
                tried = [*tried, *crept]
            skipped = startup if startup and _spoils(short, best, static) else 0
            say("fitting operator and dynamics in turn")
            parts = moving.without(skipped), short.without(skipped)
            found, operator = _refined(*parts, best, plane, prior)
        cascade = found.dynamics.cascade(found.operator)
        return DynamicIdentification(
            model=replace(cascade, noise=min(found.error, _MOST_NOISE)),
            static=operator,
            t=moving.t,
            u=moving.u,
            y=moving.y,
            fitted=found.record.fitted,
            held_out=moving.held_out,
            curves=operator.curves,
            tried=tuple(_summary(one, best) for one in tried),
            startup=skipped,
            told=told,
            record=record,
        )


def _summary(one: Found, best: Found) -> TriedDynamics:
    """Return the summary of a fit."""
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


def _spoils(record: DynamicRecord, best: Found, static: Static) -> bool:
    """Whether the start-up makes the model of the other rows worse.

    The start-up of a virgin actuator has a memory that no later row has. If no later row is like
    it, it makes nothing worse, and the record does not show whether it is right.
    """
    creeping = best.dynamics.creep is not None
    with_it = alternate(record, best.dynamics, static, best.operator, creeping=creeping)
    with_it = replace(with_it, record=best.record)  # scored on the same pieces
    # Ratio of the errors on left-out pieces above which a start-up makes the model worse
    worse = with_it.left_out_error > 1.02 * best.left_out_error
    return worse and better(best, with_it)


def _coarse(plane: Plane) -> Plane:
    """Return the law of a quick fit of the operator, with which dynamics are compared.

    A diagonal that is "auto" is reversible, which has the smallest errors.
    """
    levels = plane.levels
    bands = np.size(levels) - 1 if np.ndim(levels) else levels
    return replace(
        plane,
        levels=_BANDS if bands == "auto" or bands > _BANDS else levels,  # type: ignore[operator]
        diagonal="reversible" if plane.diagonal == "auto" else plane.diagonal,
        slope=False if plane.slope == "auto" else plane.slope,
        spacing="uniform",
    )


def _fitter(plane: Plane, prior: Prior, record: DynamicRecord) -> Static:
    """Return the function that identifies an operator, from the initial memory of a record."""
    return lambda u, y: plane.fit(Record(u, y, start=record.start), prior)


def _planes(record: DynamicRecord, best: Found, plane: Plane) -> tuple[Plane, tuple[Choice, ...]]:
    """Return the law of the operator with chosen diagonal, slope and levels, and the choices.

    Each candidate is fitted without the left-out pieces of the record, and the whole model is
    scored on them.
    """
    known = without(best.dynamics, record, best.operator)

    def error(more: dict[str, Any]) -> float:
        tried = replace(_coarse(replace(plane, **more)), **more)
        result = _fitter(tried, Smooth(0.0), record)(*known)
        prediction = best.dynamics.outputs(record, result.model)
        return float(np.sqrt(np.mean(record.squares(prediction))))

    named: dict[str, dict[str, Any]] = {
        structure(one): {"diagonal": one.diagonal, "slope": one.slope}
        for one in replace(plane, relay="bipolar").structures(best.operator.levels)
    }
    errors = {name: error(one) for name, one in named.items()}
    best_name = min(errors, key=errors.__getitem__)
    chosen = named[best_name]
    choices = [compared("structure", errors, best_name)] if len(errors) > 1 else []
    levels = plane.levels
    if isinstance(levels, str):
        few, many = f"{_BANDS} bands", f"{_FINER} bands"
        bands = {few: errors[best_name], many: error(chosen | {"levels": _FINER})}
        # Ratio of the errors below which more bands are kept, although they take more time
        choices.append(compared("levels", bands, few, 0.98))
        levels = _BANDS if choices[-1].chosen == few else _FINER
    return replace(plane, **chosen | {"levels": levels}), tuple(choices)


def _refined(
    record: DynamicRecord, pieces: DynamicRecord, best: Found, plane: Plane, prior: Prior
) -> tuple[Found, Identification]:
    """Fit the whole record with the operator of the law.

    Options that are "auto" are chosen once, on the record with left-out pieces. Returns the fit,
    and the identification of the operator from its own outputs plus the residual.
    """
    plane, choices = _planes(pieces, best, plane)
    chosen = _fitter(plane, prior, record)(*without(best.dynamics, record, best.operator))
    spec, banded = chosen.matrix.spec, chosen.posterior is not None
    plane = replace(
        plane,
        levels=spec.levels,
        spacing="uniform",
        relay=spec.relay,
        diagonal=spec.diagonal,
        slope=spec.slope,
    )
    static = _fitter(plane, Smooth(0.0 if banded else chosen.smoothness), record)
    creeping = best.dynamics.creep is not None
    found = alternate(record, best.dynamics, static, best.operator, creeping=creeping)
    if banded:
        known = without(found.dynamics, record, found.operator)
        mean = prior.mean if isinstance(prior, Gaussian) else "zero"
        result = _fitter(plane, Gaussian(mean), record)(*known)
        y = found.dynamics.outputs(record, result.model)
        found = replace(found, result=result, error=record.error(y, record.fitted))
    if found.dynamics.delay < 1e-3:  # dead time in samples that counts as none with poles
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

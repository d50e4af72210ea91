"""Identify an oscillator with hysteresis from a record of force and displacement.

If the law of the hysteresis is known, its parameters are found from a rough start. If it is
unknown, the slopes of the hysteretic force are found from the record alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from minorloop.arrays import BoolArray, as_pair, as_times, as_whole, check_option
from minorloop.dynamics.oscillator import Oscillator
from minorloop.dynamics.sampling import Interpolation, Stage, checked_stages, even_interval
from minorloop.errors import ParameterError, RecordError, SignalError
from minorloop.identification.curves import Curves
from minorloop.identification.fit import Say, silent
from minorloop.identification.mean_period import mean_period
from minorloop.identification.oscillator_result import OscillatorIdentification, TriedLevels
from minorloop.identification.prior import Prior
from minorloop.identification.simulation_error import (
    Minimum,
    OscillatorRecord,
    fit,
    fit_tied,
    parameter_names,
    parameters_of,
    softened,
)
from minorloop.lab.records import Record
from minorloop.operators.differential import BoucWen, Duhem
from minorloop.threads import one_thread

_LEVELS = (2, 4, 6, 8, 12, 16, 24, 32)
"""Numbers of levels of an unknown law to try, the smallest first. All are even, so that no level is
at the middle, where many laws have a corner."""
_FEWEST_EACH = 5
"""Least samples for each parameter: with fewer, its error is as large as the parameter."""
_WHERE_IT_IS = 0.5
"""Share of the levels placed by how often the force is there; the others are evenly spaced."""


@dataclass(frozen=True, eq=False)
class Vibration:
    """The law of a vibrating structure with a hysteretic force: forces in N, displacements in m.

    The record has even times in seconds, and displacements from rest; NaN if not measured. The
    first ``skip`` samples are simulated, but their error does not count.

    References
    ----------
    Schoukens and Ljung, Nonlinear system identification: a user-oriented road map, IEEE Control
    Systems Magazine 39 (2019) 28: simulation error, multisines, averages over periods.

    Examples
    --------
    >>> truth = ml.Oscillator(2.0, 0.5, 10.0, ml.BoucWen(1.0, 0.5, 0.5))
    >>> t = 0.1 * np.arange(400)
    >>> u = 5 * np.random.default_rng(0).normal(size=400)
    >>> law = ml.Vibration(ml.Oscillator(2.2, 0.4, 11.0, ml.BoucWen(1.1, 0.4, 0.4)))
    >>> found = ml.identify(ml.Record(u, truth.simulate(t, u), t), law)
    >>> round(found.model.mass, 3)
    2.0
    """

    rough: Oscillator | Literal["unknown"] = "unknown"
    """Structure of the model, with its parameters to within 50 %. Its operator is of differential
    type or `PrandtlIshlinskii`. Or ``"unknown"``: a mass on a linear spring with a hysteretic force
    whose slopes are any functions of this force, one for each direction (`Duhem`), with as many
    levels as the record supports."""
    period: int | None = None
    """Samples after which force and displacement repeat, if the record has whole periods of the
    settled response. Periods are averaged without the first periods of unsettled motion. None: the
    record begins at rest."""
    between: Interpolation = "band"
    """Force between samples, as in `Oscillator.simulate`."""
    substeps: int = 5
    """Steps of the integration in a sampling interval."""
    stages: Sequence[Stage] = ()
    """Filters of the converter, as in `Oscillator.simulate`."""
    fixed: Sequence[str] = ()
    """Names of parameters that keep their value, such as ``"mass"`` or ``"exponent"``."""

    def identify(
        self, record: Record, prior: Prior = "auto", holdout: float = 0.0, say: Say = silent
    ) -> OscillatorIdentification:
        """Identify mass, damping, stiffness and hysteretic force by the error of the simulation.

        Raises a `SignalError` if the record is too short, not even, or without motion, or the start
        is unstable; a `RecordError` if a unit is not SI, because mass and damping would then not be
        SI either; a `ParameterError` if an option is out of its range, or a name of ``fixed`` is
        unknown.
        """
        if prior != "auto" or holdout:
            raise ParameterError("a vibrating structure has neither prior nor holdout; omit both")
        for quantity, unit in ((record.input, "N"), (record.output, "m")):
            if quantity.unit not in ("", unit):
                raise RecordError(
                    f"{quantity.name} is in {quantity.unit}; an oscillator is identified from "
                    f"forces in N and displacements in m, so convert the column to {unit}"
                )
        known = _record(self, record.cut())
        with one_thread():
            if isinstance(self.rough, Oscillator):
                return replace(_from_start(known, self.rough, self.fixed), record=record)
            check_option("rough", self.rough, ("unknown",))
            if len(self.fixed):
                raise ParameterError(
                    "fixed is given without rough parameters; give an Oscillator as rough"
                )
            return replace(_unknown(known, say), record=record)


def _record(law: Vibration, record: Record) -> OscillatorRecord:
    """Return the record, averaged over its settled periods."""
    times, (forces, outputs) = as_times(record.t), as_pair(record.u, record.y)
    if forces.shape != times.shape:
        raise SignalError(f"t has shape {times.shape} and u {forces.shape}; give one of each")
    check_option("between", law.between, ("held", "straight", "band"))
    count = as_whole("substeps", law.substeps, 1)
    filters = checked_stages(law.stages, count)
    interval = even_interval(times)
    noise, unsettled = None, 0
    if law.period is not None:
        mean = mean_period(forces, outputs, as_whole("period", law.period, 2))
        forces, outputs, noise, unsettled = mean.u, mean.y, mean.noise, mean.unsettled
    scored = np.isfinite(outputs)
    if not scored.any():
        raise SignalError(
            f"all {outputs.size} displacements are NaN; give numbers where they are measured"
        )
    last = int(np.flatnonzero(scored)[-1])
    scored[: as_whole("skip", record.skip, 0)] = False
    if not scored.any():
        raise SignalError(
            f"no sample counts: skip is {record.skip}, and the last measured displacement of "
            f"{'the record' if law.period is None else 'a period'} is sample {last}, counted from "
            "0; give a smaller skip"
        )
    if not np.ptp(outputs[scored]) or not np.ptp(forces):
        raise SignalError(
            "force or displacement is constant over the samples that count; give a record in "
            "which both move"
        )
    return OscillatorRecord(
        forces,
        outputs,
        interval,
        law.period is not None,
        noise,
        law.between,
        count,
        filters,
        scored,
        unsettled,
    )


def _from_start(
    record: OscillatorRecord, start: Oscillator, fixed: Sequence[str]
) -> OscillatorIdentification:
    """Fit the parameters of a known law."""
    names = parameter_names(start)
    unknown = next((name for name in fixed if name not in names), None)
    if unknown is not None:
        raise ParameterError(f"fixed has {unknown!r}; give names out of {', '.join(names)}")
    free = ~np.isin(names, list(fixed))
    _check_samples(record, int(free.sum()))
    tied = fit_tied(record, start, free)
    found = None if tied is None else fit(record, tied, free)
    if found is None:
        raise SignalError(
            "the simulation from this start grows without bound, even if a spring ties it to the "
            "record; give a start with a positive damping and stiffness, or check the units"
        )
    return _result(record, *found, free)


def _unknown(record: OscillatorRecord, say: Say) -> OscillatorIdentification:
    """Find the slopes of an unknown law, on finer and finer levels."""
    linear = _linear_start(record)
    reach = float(np.abs(record.filled).max())
    # The hysteretic force gets half of the stiffness; the fit divides it again.
    half = linear.stiffness / 2
    slopes = np.repeat(half[0], 2)
    law = Duhem(half[0] * reach * np.array([-1, 1]), slopes, slopes)
    neutral = replace(linear, stiffness=half, operator=law)
    model: Oscillator | None = softened(neutral, _all_free(neutral), reach)
    assert model is not None
    model = fit_tied(record, model, _all_free(model))
    best: tuple[Oscillator, Minimum] | None = None
    tried: list[TriedLevels] = []
    for count in _LEVELS:
        if model is None or _too_many(record, model, count):
            break
        say(f"fitting {count} levels of an unknown law")
        model = _with_levels(model, record, count)
        # Levels up to which longer steps of the integration are accurate enough
        near = record.coarse() if count <= 4 else record
        # Fewer steps: this number of levels may not be the last
        found = fit(near, model, _all_free(model), steps=20, gain=1e-4)
        if found is None:
            break
        model = found[0]
        tried.append(TriedLevels.of(count, found[1]))
        if best is None or tried[-1].criterion <= min(one.criterion for one in tried):
            best = found
        least = min(range(len(tried)), key=lambda k: tried[k].criterion)
        # The search ends after two numbers of levels in a row that are no better
        if len(tried) - 1 - least >= 2:
            break
    final = None if best is None else fit(record, best[0], _all_free(best[0]))
    if final is None:
        raise SignalError(
            "no stable oscillator with a hysteretic force was found; check the units and the sign "
            "of the force, or give a start"
        )
    return _result(record, *final, _all_free(final[0]), tuple(tried))


def _all_free(model: Oscillator) -> BoolArray:
    return np.ones(parameters_of(model).size, dtype=np.bool_)


def _too_many(record: OscillatorRecord, model: Oscillator, levels: int) -> bool:
    parameters = 2 + model.stiffness.size + 2 * levels
    return bool(record.scored.sum() < _FEWEST_EACH * parameters) and levels > _LEVELS[0]


def _check_samples(record: OscillatorRecord, parameters: int) -> None:
    count = int(record.scored.sum())
    if count < _FEWEST_EACH * parameters:
        raise SignalError(
            f"{count} samples count for {parameters} parameters; give at least "
            f"{_FEWEST_EACH * parameters}, or fix some"
        )


def _linear_start(record: OscillatorRecord) -> Oscillator:
    """Return the linear oscillator nearest to the spectra of force and displacement.

    It is found by least squares of ``(-w^2 m + i w c + k) Y = U`` at frequencies of large force.
    Its hysteresis is zero.
    """
    y = record.filled
    window = np.ones(y.size) if record.periodic else np.hanning(y.size)
    force, motion = np.fft.rfft(window * record.u), np.fft.rfft(window * y)
    w = 2 * np.pi * np.fft.rfftfreq(y.size, record.interval)
    # Least share of its largest spectral line at which a force counts, for the linear start
    large = np.abs(force) > 0.1 * np.abs(force[1:]).max()
    columns = np.column_stack([-(w**2) * motion, 1j * w * motion, motion])[large]
    scale = np.linalg.norm(columns, axis=0)
    rows = np.vstack([columns.real, columns.imag]) / scale
    right = np.concatenate([force[large].real, force[large].imag])
    mass, damping, stiffness = np.linalg.lstsq(rows, right, rcond=None)[0] / scale
    if mass <= 0 or stiffness <= 0:
        raise SignalError(
            f"the record looks like a mass of {mass:.3g} kg on a spring of {stiffness:.3g} N/m, "
            "which both must be positive; check the units and the sign of the force, and excite "
            "below and above the resonance, or give a start"
        )
    return Oscillator(mass, max(damping, 0.0), stiffness, BoucWen(1.0, 0.0, 0.0))


def _with_levels(model: Oscillator, record: OscillatorRecord, count: int) -> Oscillator:
    """Return the model with other levels; its force is equally often between two levels."""
    law = model.operator
    if law.levels.size == count:
        return model
    y = record.filled
    z = law.simulate(np.tile(y, 2) if record.periodic else y)[-y.size :]
    order = np.sort(z)
    share = np.linspace(0, 1, order.size)
    even = (order - order[0]) / (order[-1] - order[0])
    mixed = _WHERE_IT_IS * share + (1 - _WHERE_IT_IS) * even
    levels = np.interp(np.linspace(0, 1, count), mixed, order)
    slopes = (np.interp(levels, law.levels, values) for values in (law.rising, law.falling))
    return replace(model, operator=Duhem(levels, *slopes))


def _result(
    record: OscillatorRecord,
    model: Oscillator,
    found: Minimum,
    free: BoolArray,
    tried: tuple[TriedLevels, ...] = (),
) -> OscillatorIdentification:
    return OscillatorIdentification(
        model=model,
        t=np.arange(record.y.size, dtype=np.float64) * record.interval,
        u=record.u,
        y=record.y,
        fitted=record.scored,
        held_out=np.zeros_like(record.scored),
        curves=Curves.whole("negative"),
        motion=record,
        minimum=found,
        free=free,
        tried=tried,
    )

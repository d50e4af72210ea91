"""A Preisach operator with time: after-effect of its thresholds, and creep of its relays."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from dataclasses import field as parameter
from functools import cached_property
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    ByValue,
    FloatArray,
    Samples,
    as_finite,
    as_seconds,
    as_times,
    as_triangle,
    as_waveform,
    frozen,
)
from minorloop.errors import NotInvertibleError, ParameterError, SignalError
from minorloop.figures import Drawn
from minorloop.operators import _after_effect_kernels as _kernels
from minorloop.operators import plane as _plane
from minorloop.operators._parallel import filled
from minorloop.operators.inversion import (
    Inversion,
    Unreachable,
    as_signal,
    check_unreachable_option,
)
from minorloop.operators.memory import Memory, Start
from minorloop.operators.preisach import Preisach

_MISSED = 1e-10
"""Residual, over the range, above which a target counts as out of reach."""


@dataclass(frozen=True)
class _AfterEffectState:
    """State of an operator with after-effect."""

    memory: Memory
    """Remembered extrema of the effective input; the last entry is its present value."""
    u: float
    """The last input."""
    creep: tuple[float, ...]
    """Outputs of the creeping planes."""


State: TypeAlias = "Start | _AfterEffectState"
"""A state, or a memory at which the operator has settled."""


def _none() -> FloatArray:
    return np.empty(0)


@dataclass(frozen=True, eq=False)
class AfterEffect(ByValue, Drawn):
    """A Preisach operator whose output changes with time while its input is held.

    The relays see an *effective input* v, which follows the input u by the law of thermal
    activation (sinh), with the fluctuation field S and the settling time T::

        dv/dt = S / T sinh((u - v) / S)

    While u is held, v approaches it with the logarithm of time, S ln(t), up to t = T. For the plane
    of relays, this is a threshold that relaxes. With S much greater than the range, the law is
    linear: the relays are viscous. The weights of a reversible diagonal, and the slope, respond to
    u itself. Instead of a field, every cell may have weights whose output follows with one of
    several time constants::

        y = plane[v, u] + sum over i of lag(times[i])[creep[i][v, u]]

    Without field and creep the operator is the plane.

    Raises a `ParameterError` if a number is out of its range, or shapes disagree.

    References
    ----------
    Neel, Annales de Geophysique 5, 1949: fluctuation field, S ln t.
    Mayergoyz, Mathematical Models of Hysteresis, 1991, chapter 5: viscosity of a Preisach plane.

    Examples
    --------
    >>> plane = ml.Preisach([-1.0, 0.0, 1.0], [[1.0, 0.0], [0.5, 1.0]])
    >>> slow = ml.AfterEffect(plane, field=0.05, settling=100.0)
    >>> y = slow.simulate([0.0, 1.0, 100.0], [-1.0, 0.5, 0.5])
    >>> bool(y[2] > y[1])
    True
    """

    plane: Preisach
    """Thresholds, weights without creep, offset, relay, diagonal and slope."""
    field: FloatArray = parameter(default_factory=_none)
    """Fluctuation field S in the unit of the input, for all bands or (L,) for each; 0 for none."""
    settling: float = 0.0
    """Settling time T of the effective input in seconds; 0 without a field."""
    times: FloatArray = parameter(default_factory=_none)
    """Shape (n,). Time constants of the creep in seconds, increasing."""
    creep: FloatArray = parameter(default_factory=_none)
    """Shape (n, L, L). Weights that creep with each time constant, in the unit of the output, with
    any sign."""

    def __post_init__(self) -> None:
        store = object.__setattr__
        if not isinstance(self.plane, Preisach):
            raise ParameterError(f"plane is a {type(self.plane).__name__}; give a Preisach")
        bands = self.plane.bands
        store(self, "field", _as_field(self.field, bands))
        store(self, "settling", as_finite("settling", self.settling))
        if (self.settling > 0) != bool(self.field.size) or self.settling < 0:
            raise ParameterError(
                f"settling is {self.settling:g} s; give a positive time with a field, and 0 without"
            )
        times = frozen(np.atleast_1d(np.asarray(self.times, dtype=np.float64)))
        positive = np.isfinite(times).all() and (times > 0).all() and (np.diff(times) > 0).all()
        if times.ndim != 1 or not positive:
            raise ParameterError(f"times are {times}; give increasing positive seconds")
        if times.size and self.field.size:
            raise ParameterError(
                f"field is {self.field.max():g} and times are {times}; give a field or creep"
            )
        store(self, "times", times)
        given = np.asarray(self.creep, dtype=np.float64)
        if given.size == 0:
            given = given.reshape(0, bands, bands)
        if given.ndim != 3 or len(given) != times.size:
            raise ParameterError(
                f"creep has shape {given.shape} for {times.size} times; give one (L, L) array for "
                "each time"
            )
        triangles = [as_triangle(one, bands, name="weights of creep") for one in given]
        store(self, "creep", frozen(np.array(triangles).reshape(given.shape)))

    def __repr__(self) -> str:
        parts = []
        if self.field.size:
            least, most = self.field.min(), self.field.max()
            parts.append(f"field {least:g} to {most:g} settling in {self.settling:g} s")
        if self.times.size:
            parts.append("creep of " + ", ".join(f"{time:.3g}" for time in self.times) + " s")
        return f"AfterEffect({self.plane!r}, {'; '.join(parts) or 'no after-effect'})"

    @cached_property
    def settled(self) -> Preisach:
        """The operator for inputs that are held for a long time: plane and creep together."""
        base, weights = self.plane, self.plane.weights + self.creep.sum(axis=0)
        return Preisach(base.levels, weights, base.offset, base.relay, base.diagonal, base.slope)

    @property
    def range(self) -> tuple[float, float]:
        """Least and greatest settled output over the levels; outputs may exceed it for a time."""
        return self.settled.range

    @cached_property
    def monotone(self) -> bool:
        """Whether the output after any interval rises with the input during it.

        It does if plane and creep up to each time constant together are monotone.
        """
        base, weights = self.plane, np.concatenate([self.plane.weights[None], self.creep])
        return all(
            Preisach(base.levels, one, 0.0, base.relay, base.diagonal, base.slope).monotone
            for one in np.cumsum(weights, axis=0)
        )

    def simulate(self, t: npt.ArrayLike, u: npt.ArrayLike, start: State = "negative") -> Samples:
        """Return the outputs for inputs, (T,) or (S, T), that are held between samples.

        If the start is a memory, the operator has settled there. Else as `TimedModel.simulate`.
        """
        steps = intervals(as_times(t))

        def run(u: FloatArray, y: FloatArray) -> None:
            if u.size != steps.size:
                raise SignalError(
                    f"u has {u.size} samples and t {steps.size} times; give one input for each time"
                )
            stack, rows, creep, _ = self.stack(start, u.size)
            _kernels.simulate(self.tables, stack, rows, creep, steps, u, y, True)

        return filled(u, run)

    def invert(
        self,
        t: npt.ArrayLike,
        targets: npt.ArrayLike,
        start: State = "negative",
        unreachable: Unreachable = "raise",
    ) -> Inversion:
        """Return inputs, held between samples, with which the output meets a target at each time.

        The output at t[k] is monotone in the input that is held since t[k - 1]; its root is exact
        to rounding. Inputs lie inside the levels. The reach of the output depends on the past.
        Parameters and errors are those of `TimedModel.invert`.
        """
        check_unreachable_option(unreachable)
        self.require_monotone()
        times, wanted = as_waveform(t, as_signal(targets, name="targets"), name="targets")
        stack, rows, creep, before = self.stack(start, wanted.size)
        u, y = np.empty_like(wanted), np.empty_like(wanted)
        _kernels.invert(self.tables, stack, rows, creep, before, intervals(times), wanted, u, y)
        low, high = self.range
        missed = np.abs(y - wanted) > _MISSED * (high - low)
        if missed.any() and unreachable == "raise":
            row = int(np.argmax(missed))
            _refuse(row, *(float(values[row]) for values in (times, wanted, u, y)))
        return Inversion(u=u, y=y, residual=y - wanted, reachable=~missed)

    def step(self, memory: State, u: float, interval: float) -> tuple[float, _AfterEffectState]:
        """Return output and state after an input that is held for an interval in seconds."""
        tracker = self.track(memory)
        return tracker.push(u, interval), tracker.state

    def track(self, start: State = "negative") -> TimedTracker:
        """Return a tracker that follows a live input sample by sample."""
        return TimedTracker(self, start)

    def require_monotone(self) -> None:
        """Refuse a model that cannot be inverted.

        Raises a `NotInvertibleError` if it is not monotone.
        """
        if not self.monotone:
            raise NotInvertibleError(
                "the model is not monotone: its plane, or plane and creep up to some time constant "
                "together, have negative weights"
            )

    @cached_property
    def marks(self) -> FloatArray:
        """(L + 1,) thresholds over the fluctuation field; the levels without a field."""
        levels = self.plane.levels
        if not self.field.size:
            return levels
        return frozen(np.concatenate([[0.0], np.cumsum(np.diff(levels) / self.field)]))

    @cached_property
    def tables(self) -> _kernels.TimedPlane:
        """Tables for compiled loops and exports."""
        base, marks = self.plane, self.marks
        buckets, per_unit = _plane.buckets(base.levels)
        mark_buckets, per_mark_unit = _plane.buckets(marks)
        weights = np.concatenate([base.weights[None], self.creep])
        own = weights.diagonal(axis1=1, axis2=2)
        reversible = np.zeros((len(weights), base.bands + 1))
        bow = np.zeros_like(own)
        strict = weights
        if base.diagonal == "reversible":
            strict = np.tril(weights, -1)
            reversible[:, 1:] = base.swing * np.cumsum(own, axis=1)
        else:
            bow = base.swing * own
        nodes = np.stack([base.swing * _plane.nodes_from_weights(one) for one in strict], axis=-1)
        saturation = _plane.off_output(base.relay) * weights.sum(axis=(1, 2))
        saturation[0] += base.offset
        return _kernels.TimedPlane(
            levels=base.levels,
            per_band=frozen(1 / np.diff(base.levels)),
            buckets=buckets,
            per_unit=per_unit,
            marks=marks,
            per_mark=frozen(1 / np.diff(marks)),
            mark_buckets=mark_buckets,
            per_mark_unit=per_mark_unit,
            nodes=frozen(nodes),
            bow=frozen(np.ascontiguousarray(bow.T)),
            reversible=frozen(np.ascontiguousarray(reversible.T)),
            saturation=frozen(saturation),
            slope=base.slope,
            settling=self.settling,
            times=self.times,
        )

    def stack(self, start: State, room: int) -> tuple[FloatArray, int, FloatArray, float]:
        """Return the state of the compiled loops: stack, rows in use, creep, and last input.

        Parameters
        ----------
        start : start state, Memory or _AfterEffectState
            The state.
        room : int
            Number of further reversals that the stack has room for.
        """
        timed = start if isinstance(start, _AfterEffectState) else None
        memory = self.plane.memory(start if isinstance(start, Memory | str) else start.memory)
        extrema = np.array(memory.extrema)
        tables = self.tables
        stack = np.empty((extrema.size + room + 2, _kernels.OUTPUTS + tables.saturation.size))
        creep = tables.saturation[1:].copy()
        rows = _kernels.begin(tables, stack)
        held = np.full(extrema.size, np.inf)
        rows = _kernels.simulate(
            tables, stack, rows, creep, held, extrema, np.empty_like(extrema), True
        )
        if timed is None:
            return stack, rows, creep, memory.u
        if len(timed.creep) != creep.size:
            raise ParameterError(
                f"the state has {len(timed.creep)} creep outputs, the model {creep.size}; give a "
                "state of this model"
            )
        creep[:] = timed.creep
        return stack, rows, creep, as_finite("u", timed.u)


class TimedTracker:
    """An operator with after-effect that follows a live input and keeps its state.

    ``model``: the operator; ``start``: state before the first sample.
    """

    __slots__ = ("_before", "_creep", "_rows", "_stack", "_tables", "model")

    def __init__(self, model: AfterEffect, start: State = "negative") -> None:
        self.model = model
        self._tables = model.tables
        self._stack, self._rows, self._creep, self._before = model.stack(start, room=64)

    @property
    def state(self) -> _AfterEffectState:
        """Present state."""
        values = self._stack[: self._rows, _kernels.VALUE]
        extrema = np.interp(values, self.model.marks, self.model.plane.levels)
        # Two extrema that differ only by rounding may become equal in the unit of the input.
        levels = self.model.plane.levels
        memory = Memory.after(extrema, low=float(levels[0]), high=float(levels[-1]))
        return _AfterEffectState(memory, self._before, tuple(self._creep.tolist()))

    @property
    def effective(self) -> float:
        """Present effective input, in the unit of the input."""
        x = self._stack[self._rows - 1, _kernels.VALUE]
        return float(np.interp(x, self.model.marks, self.model.plane.levels))

    def push(self, u: float, interval: float) -> float:
        """Return the output after an input that is held for an interval, and update the state."""
        if self._rows > len(self._stack) - 2:
            self._stack = np.concatenate([self._stack, np.empty_like(self._stack)])
        y, self._rows = self._look(u, interval, True)
        self._before = float(u)
        return y

    def peek(self, u: float, interval: float) -> float:
        """Return the output after an input for an interval; the state does not change."""
        return self._look(u, interval, False)[0]

    def aim(self, y: float, interval: float, unreachable: Unreachable = "raise") -> float:
        """Return the input that, held for an interval, brings the output to y at its end.

        The state does not change. ``"clip"`` gives the nearer end of the levels. Parameters and
        errors are those of `LiveTracker.aim`; an interval that is not positive raises a
        `ParameterError`.
        """
        self.model.require_monotone()
        check_unreachable_option(unreachable)
        held, target = as_seconds("interval", interval), as_finite("target", y)
        state = self._stack, self._rows, self._creep, self._before
        u = float(_kernels.aim(self._tables, *state, held, target))
        low, high = self.model.range
        reached = self.peek(u, held)
        if unreachable == "raise" and abs(reached - target) > _MISSED * (high - low):
            _refuse(0, held, target, u, reached)
        return u

    def copy(self) -> TimedTracker:
        """Return an independent tracker with the same state."""
        other = copy.copy(self)
        other._stack, other._creep = self._stack.copy(), self._creep.copy()
        return other

    def _look(self, u: float, interval: float, keep: bool) -> tuple[float, int]:
        """Return output and rows in use after an input; ``keep`` updates the present state."""
        held, inputs = np.array([as_seconds("interval", interval)]), np.array([as_finite("u", u)])
        y, tables = np.empty(1), self._tables
        rows = _kernels.simulate(
            tables, self._stack, self._rows, self._creep, held, inputs, y, keep
        )
        return float(y[0]), int(rows)


def intervals(t: FloatArray) -> FloatArray:
    """Return the seconds for which each input is held, (T,); the first as long as the second."""
    return np.diff(t, prepend=2 * t[0] - t[1])


def _as_field(values: npt.ArrayLike, bands: int) -> FloatArray:
    """Return the fluctuation field of each band; empty for none."""
    given = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if given.ndim != 1 or given.size not in (0, 1, bands):
        raise ParameterError(f"field has shape {given.shape}; give one number, or {bands}")
    if not np.isfinite(given).all() or (given < 0).any():
        raise ParameterError(f"field is {given}; give fields >= 0 in the unit of the input")
    if not given.any():
        return frozen(np.empty(0))
    if not given.all():
        raise ParameterError(
            f"field is {given}; give a positive field in every band, or 0 in all of them"
        )
    return frozen(np.full(bands, given[0]) if given.size == 1 else given)


def _refuse(index: int, t: float, wanted: float, u: float, y: float) -> None:
    from minorloop.errors import UnreachableError

    raise UnreachableError(
        f"target {wanted:g} at index {index} ({t:g} s) is out of reach at its time: "
        f"the input {u:g}, an end of the levels, gives {y:g}; allow more time, or "
        'pass unreachable="clip" to go as near as it can'
    )

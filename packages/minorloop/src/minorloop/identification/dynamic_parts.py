"""The parts of an identification with dynamics: a checked record, and the dynamics themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.dynamics.cascade import Cascade, First
from minorloop.dynamics.creep import Creep
from minorloop.dynamics.linear import Linear
from minorloop.errors import SignalError
from minorloop.identification import record_checks as checks
from minorloop.identification.steps import as_sampled
from minorloop.lab.faults import Fault
from minorloop.lab.records import Record
from minorloop.operators.preisach import Preisach

_FEWEST = 100
"""Least measured outputs from which dynamics are identified."""
_FASTEST, _PLAUSIBLE = 0.3, 0.5
"""Shortest time constant of a search, and shortest plausible one, in sampling intervals."""
_PIECE, _EVERY, _BLOCKS = 10, 5, 40
"""Rows of a contiguous piece; one of this number of pieces is left out; and number of blocks of the
record, over whose pieces errors are averaged. Pieces are short, because the operator has to be
measured on both sides of each; blocks are long, because neighbouring errors are alike."""
_VISITED = 0.9
"""Share of the range of the record that the input must have covered so that the memory is known.
A threshold beyond the range of the record is passed once for all, so both ends count."""

Logarithms: TypeAlias = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class DynamicRecord:
    """A checked record; y is NaN where no output was measured."""

    t: FloatArray
    u: FloatArray
    y: FloatArray
    """``t``, ``u`` and ``y``: shape (T,). Even times from 0 in seconds, inputs, outputs."""
    interval: float
    """Seconds between samples."""
    fitted: BoolArray
    held_out: BoolArray
    """``fitted`` and ``held_out``: shape (T,). Samples that are fitted and scored."""
    start: Any
    """Start state: memory before the first sample."""
    codes: tuple[Fault, ...]
    """Readings that are not measurements."""
    pieces: IntArray
    """Shape (T,). Number of the block of each sample in a left-out piece, by which structures are
    compared; -1 elsewhere."""

    @classmethod
    def of(cls, record: Record, holdout: float) -> DynamicRecord:
        """Return a checked record without left-out pieces."""
        inputs, outputs, coded = record.checked
        interval = as_sampled((record.t, inputs, np.zeros(inputs.size))).interval
        skipped = checks.as_skip(record.skip, np.arange(inputs.size))
        fitted, held_out = checks.split(outputs, holdout, coded, skipped)
        if np.count_nonzero(fitted) < _FEWEST:
            raise SignalError(
                f"{np.count_nonzero(fitted)} outputs are fitted, and dynamics need {_FEWEST}; also "
                "record the transients, or identify without dynamics"
            )
        even = interval * np.arange(inputs.size, dtype=np.float64)
        none = np.full(inputs.size, -1, dtype=np.int64)
        return cls(even, inputs, outputs, interval, fitted, held_out, record.start, coded, none)

    def part(self, rows: int) -> DynamicRecord:
        """Return the first rows, of which at most ``rows`` are fitted."""
        used = np.flatnonzero(self.fitted)[:rows]
        size = int(used[-1]) + 1
        names = ("t", "u", "y", "fitted", "held_out", "pieces")
        return replace(self, **{name: getattr(self, name)[:size] for name in names})

    def with_pieces(self) -> DynamicRecord:
        """Return the record without every fifth piece of ten fitted rows."""
        rows = np.flatnonzero(self.fitted)
        place = np.arange(rows.size)
        left = place // _PIECE % _EVERY == _EVERY // 2
        blocks = min(_BLOCKS, max(rows.size // (_PIECE * _EVERY), 1))
        pieces = np.full(self.u.size, -1, dtype=np.int64)
        pieces[rows[left]] = place[left] * blocks // rows.size
        return replace(self, fitted=self.fitted & (pieces < 0), pieces=pieces)

    @property
    def startup(self) -> int:
        """Number of first rows before the input has been near both ends of its range.

        0 if these are more than a quarter of the fitted rows.
        """
        low, high = float(self.u.min()), float(self.u.max())
        above, below = np.maximum.accumulate(self.u), np.minimum.accumulate(self.u)
        known = above - below >= _VISITED * (high - low)
        rows = int(np.argmax(known))
        # Largest share of the fitted rows that counts as a start-up; a record that takes longer to
        # reach its extremes is fitted as it is
        few = np.count_nonzero(self.fitted[:rows]) <= 0.25 * np.count_nonzero(self.fitted)
        return rows if few else 0

    def without(self, rows: int) -> DynamicRecord:
        """Return the record without fitting or comparing its first rows."""
        later = np.arange(self.u.size) >= rows
        return replace(self, fitted=self.fitted & later, pieces=np.where(later, self.pieces, -1))

    def error(self, prediction: FloatArray, rows: BoolArray) -> float:
        """Root-mean-square error on these rows, over the range of the output."""
        off = (prediction - self.y)[rows]
        return float(np.sqrt(np.mean(off**2)) / (np.nanmax(self.y) - np.nanmin(self.y)))

    def squares(self, prediction: FloatArray) -> FloatArray:
        """(B,) mean squared error on the left-out pieces of each block, over the range squared."""
        rows = self.pieces >= 0
        off = (prediction - self.y)[rows] / (np.nanmax(self.y) - np.nanmin(self.y))
        _, piece = np.unique(self.pieces[rows], return_inverse=True)
        return np.asarray(np.bincount(piece, off**2) / np.bincount(piece))


@dataclass(frozen=True)
class DynamicParts:
    """Dead time, poles before and behind an operator, and creep of the output.

    The poles on a side are 1 / ((1 + a s + b s^2) (1 + c s)).
    """

    interval: float
    """Seconds between samples."""
    delay: float
    """Dead time in sampling intervals."""
    ahead: Logarithms = ()
    behind: Logarithms = ()
    """``ahead`` and ``behind``: log a, log b and log c of the poles before and behind the operator;
    one number for each pole."""
    creep: Creep | None = None
    """Creep of the output."""

    @property
    def poles(self) -> int:
        """Number of poles."""
        return len(self.ahead) + len(self.behind)

    @property
    def first(self) -> First:
        """The part that comes first: operator or linear dynamics."""
        return "linear" if self.ahead and not self.behind else "operator"

    @property
    def structure(self) -> tuple[int, int, bool]:
        """Numbers of poles before and behind the operator, and whether there is creep."""
        return len(self.ahead), len(self.behind), self.creep is not None

    @property
    def plausible(self) -> bool:
        """Whether the samples are close enough to know the fastest pole."""
        return not self.poles or bool(self.time_constants[-1] >= _PLAUSIBLE * self.interval)

    @property
    def parameters(self) -> int:
        """Number of poles, and one more for dead time and for creep."""
        return self.poles + (self.delay > 0) + (self.creep is not None)

    @property
    def time_constants(self) -> FloatArray:
        """Time constants in seconds, slowest first."""
        times = [_linear(side).time_constants for side in (self.ahead, self.behind)]
        return np.sort(np.concatenate(times))[::-1]

    @property
    def linear(self) -> Linear:
        """Continuous system with the dead time: behind the operator, or before if ``first`` is."""
        side = self.ahead if self.first == "linear" else self.behind
        return _linear(side, self.delay * self.interval)

    def cascade(self, operator: Preisach) -> Cascade:
        """Return an operator with these dynamics."""
        ahead = _linear(self.ahead) if self.ahead and self.behind else None
        return Cascade(operator, self.linear, self.first, self.creep, ahead=ahead)

    @property
    def filter_time(self) -> float:
        """Time constant of the filter of the inverse."""
        product = 1 / float(self.linear.denominator[-1])  # of the time constants
        # At least a sampling interval, and such that F / G amplifies noise by at most 10
        usual = float((product / 10.0) ** (1 / max(self.linear.order, 1)))
        return max(usual, self.interval)

    def before(self, u: FloatArray) -> FloatArray:
        """Return the input (T,) of the operator, for a held input."""
        return self._filtered(u, self.ahead, self.delay if self.first == "linear" else 0.0)

    def after(self, w: FloatArray) -> FloatArray:
        """Return the outputs (T,) before creep, for outputs of the operator."""
        return self._filtered(w, self.behind, 0.0 if self.first == "linear" else self.delay)

    def _filtered(self, x: FloatArray, side: Logarithms, delay: float) -> FloatArray:
        samples = np.arange(x.size)
        late: FloatArray = np.interp(samples - delay, samples, x) if delay else x
        if not side:
            return late
        sampled = _linear(side).discretise(self.interval)
        return sampled.simulate(self.interval * samples, late, before=float(x[0]))

    def prompt(self, record: DynamicRecord, operator: Preisach) -> FloatArray:
        """Return the outputs before creep."""
        return self.after(operator.simulate(self.before(record.u), record.start))

    def outputs(self, record: DynamicRecord, operator: Preisach) -> FloatArray:
        """Return the outputs."""
        return self.crept(record, self.prompt(record, operator))

    def crept(self, record: DynamicRecord, y: FloatArray) -> FloatArray:
        """Return the outputs with creep, from the outputs before creep."""
        return y if self.creep is None else self.creep.simulate(record.t, y, before=float(y[0]))

    @property
    def vector(self) -> FloatArray:
        """Logarithms, dead time and strengths of the creep."""
        strengths = () if self.creep is None else self.creep.strengths
        return np.array([*self.ahead, *self.behind, self.delay, *strengths])

    def at(self, vector: FloatArray) -> DynamicParts:
        """Return the dynamics with other parameters; a short vector keeps the last parameters."""
        known = np.append(vector, self.vector[vector.size :]).tolist()
        n = len(self.ahead)
        creep, strengths = self.creep, np.maximum(known[self.poles + 1 :], 0.0)
        if creep is not None and strengths.sum() < 1:
            creep = Creep(creep.times, strengths, 1 - float(strengths.sum()))
        return replace(
            self,
            ahead=tuple(known[:n]),
            behind=tuple(known[n : self.poles]),
            delay=max(known[self.poles], 0.0),
            creep=creep,
        )

    def with_another_pole(self, ahead: bool) -> tuple[DynamicParts, DynamicParts]:
        """Return two begins of a search with one pole more on a side.

        In the first, the pole is faster than all others. In the second, all poles are equal, and
        there is no dead time.
        """
        if self.poles:
            # Time constant with which another pole is tried, over that of the fastest so far
            fast = 0.3 * float(self.time_constants[-1])
            delay = max(self.delay - fast / self.interval, 0.0)
        else:
            fast, delay = self.interval * max(self.delay, 1.0), 0.5
        late = self.delay * self.interval + float(self.time_constants.sum())
        time = max(late, self.interval) / (self.poles + 1)
        before, behind = len(self.ahead) + ahead, len(self.behind) + (not ahead)
        more = _with_pole(self.ahead if ahead else self.behind, fast)
        faster = replace(self, ahead=more) if ahead else replace(self, behind=more)
        equal = replace(self, ahead=_equal(time, before), behind=_equal(time, behind))
        return replace(faster, delay=delay), replace(equal, delay=0.0)

    def bounds(self, seconds: float) -> tuple[FloatArray, FloatArray]:
        """Return the least and greatest logarithms and dead time, for a record of ``seconds``."""
        each = [1.0, 2.0, 1.0]
        powers = np.array([*each[: len(self.ahead)], *each[: len(self.behind)]])
        low = np.append(powers * np.log(_FASTEST * self.interval), 0.0)
        return low, np.append(powers * np.log(seconds), seconds / self.interval / 4)


def _with_pole(side: Logarithms, time: float) -> Logarithms:
    """Return the logarithms of the poles and of one more, the fastest."""
    a = np.exp(side).tolist()
    more = [[time], [sum(a[:1]) + time, sum(a[:1]) * time], [*a, time]][len(side)]
    return tuple(np.log(more).tolist())


def _equal(time: float, poles: int) -> Logarithms:
    """Return the logarithms of equal poles."""
    values = [time] if poles == 1 else [2 * time, time**2, time][:poles]
    return tuple(np.log(values).tolist())


def _linear(side: Logarithms, delay: float = 0.0) -> Linear:
    """Return the continuous system of the poles on one side, with DC gain 1."""
    a = np.exp(side).tolist()
    denominator = np.convolve([*a[1::-1], 1.0], [*a[2:], 1.0])
    return Linear(np.ones(1), denominator, delay=delay)

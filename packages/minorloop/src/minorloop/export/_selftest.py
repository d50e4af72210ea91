"""The generated self-test: inputs, their outputs in Python, and the tolerance for the C."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.dynamics.cascade import Cascade, CascadeState, First
from minorloop.dynamics.linear import Linear
from minorloop.export._tables import DIGITS, DIGITS_LINEAR, Numbers, render, wrapped
from minorloop.operators.preisach import Preisach

_NEAR, _STEEPEST = 1e-4, 10.0
"""The inverse is compared at outputs where, within this share of the range on either side, the
slope of the inverse is at most 10 in shares of both ranges, so that rounding grows at most tenfold.
"""


@dataclass(frozen=True)
class _Asked:
    """Inputs that an inverse has to return, each after some of the inputs of the self-test."""

    after: Sequence[int]
    """The input after which the inverse is called, counted from 0."""
    targets: Sequence[float]
    inputs: Sequence[float]
    """``targets`` and ``inputs``: target outputs, and the inputs for them."""
    span: float
    """Range of the inputs, to which errors are relative."""

    @property
    def count(self) -> int:
        """Number of calls of the inverse."""
        return len(self.after)


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Template context, bytes and self-test of a model."""

    template: str
    """Name of the templates."""
    title: str
    """Description of the model."""
    context: dict[str, Any]
    table_bytes: int
    state_bytes: int
    memory: int
    """Number of extrema, plays or relays that a state remembers."""
    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: inputs of the self-test, rounded to the type of the C, and outputs, (T,)."""
    width: float
    """Range of the output, to which errors are relative."""
    inverse: bool
    """Whether the self-test follows targets."""
    targets: FloatArray | None = None
    """Shape (T,). Targets of the self-test; by default the outputs in reverse order."""
    asked: _Asked | None = None
    """Inputs of the inverse to compare, for a model with a linear part."""
    digit: float = 0.0
    """Effect of a last digit of the inputs, as a share of the range."""
    drop_error: float = 0.0
    input_error: float = 0.0
    """``drop_error`` and ``input_error``: as of `CSource`."""


def examples(
    model: Preisach, count: int, numbers: Numbers, memory: int, linear: Linear | None, first: First
) -> tuple[FloatArray, FloatArray, float]:
    """Return inputs rounded to the type of the C, their outputs, and the effect of a last digit.

    Raises a `ParameterError` if the last digit of an input changes the output by too large a share
    of its range.
    """
    typed = numbers.array(_inputs(model, count, memory))
    ways = np.where(np.random.default_rng(1).random(typed.size) < 0.5, -np.inf, np.inf)
    neighbours = np.nextafter(typed, ways.astype(typed.dtype)).astype(np.float64)
    u = typed.astype(np.float64)
    y, beside = (
        model.simulate(x) if linear is None else _stepped(Cascade(model, linear, first), x)
        for x in (u, neighbours)
    )
    digit = float(np.abs(beside - y).max()) / width_of(model, linear)
    of = "changes the output by {:.2g} % of its range"
    numbers.digit(np.abs(u).max(), digit, of, "identify against the input minus its offset")
    return u, y, digit


def worst_digit(model: Preisach, numbers: Numbers) -> float:
    """Return the largest effect of a last digit of an input, as a share of the range of the output.

    It occurs where the output is steepest, where all relays of a band switch, at the last input and
    at the previous extremum.
    """
    weights, bands = np.abs(model.weights), np.diff(model.levels)
    if model.diagonal == "uniform":  # a triangle is twice as steep at its end
        weights = weights + np.diag(weights.diagonal())
    steepest = sum(float(np.max(weights.sum(axis=axis) / bands)) for axis in (0, 1))
    digit = float(np.spacing(numbers.array(np.abs(model.levels).max())))
    return digit * (model.swing * steepest + abs(model.slope)) / width_of(model, None)


def width_of(model: Preisach, linear: Linear | None) -> float:
    """Return the range of the output, to which errors are related."""
    low, high = model.range
    return (high - low) * (1.0 if linear is None else abs(linear.dc_gain)) or 1.0


def selftest(context: dict[str, Any], numbers: Numbers, parts: Parts) -> str:
    """Return the self-test, which compares the C with outputs of Python within a tolerance.

    With a linear part, the output reaches a target only later; so the inputs that the C computes
    are compared instead.

    Raises a `ParameterError` if the rounding of outputs is too large: with an offset far larger
    than its range, an output changes only in its last digits.
    """
    y, width, asked = parts.y, parts.width or 1.0, parts.asked
    rounding = float(np.finfo(np.float32 if numbers.single else np.float64).eps)
    largest = float(np.abs(y).max())
    digit = float(np.spacing(numbers.array(largest))) / width
    of, digits = "is {:.2g} % of the range of the output", DIGITS
    if context.get("linear"):
        digits = DIGITS_LINEAR
    tolerance = max(1e-12, 300 * rounding) + DIGITS * parts.digit
    tolerance += numbers.digit(largest, digit, of, "identify the output minus its offset", digits)
    tables = {
        "inputs": numbers.table(parts.u),
        # As doubles: rounded to the type, they would hide the effect of rounding on the output.
        "outputs": Numbers(False).table(y),
        "targets": numbers.table(y[::-1] if parts.targets is None else parts.targets),
    }
    if asked is not None:
        tables |= {
            "asked_targets": numbers.table(asked.targets),
            "asked_inputs": numbers.table(asked.inputs),
            "asked_after": wrapped(f"{k}" for k in asked.after),
        }
    test = {
        "tables": tables,
        "count": parts.u.size,
        "both_ways": parts.inverse,
        "width": repr(width),
        "tolerance": f"{tolerance:.3g}",
        "asked": asked,
        "asked_tolerance": f"{_STEEPEST * tolerance:.3g}",
    }
    return render("selftest.c", {**context, **test})


def asked_of(model: Preisach, linear: Linear, first: First, u: FloatArray) -> _Asked | None:
    """Return inputs of the inverse of the operator for targets where its output is steep enough.

    Where it is flat, the last digit of a target changes the input strongly. None if it is flat
    everywhere.
    """
    (low, high), cascade = map(float, model.levels[[0, -1]]), Cascade(model, linear, first)
    (least, most), gain = model.range, linear.dc_gain
    near, rng = _NEAR * (most - least), np.random.default_rng(2)
    state, found = _begun(cascade), []
    for k, sample in enumerate(u):
        state = cascade.step(state, float(sample))[1]
        tracker = model.track(state.memory)
        target = tracker.peek(float(rng.uniform(low, high)))
        below, wanted, above = (tracker.aim(target + x, "clip") for x in (-near, 0.0, near))
        inside = least + near <= target <= most - near
        if inside and above - below <= 2 * _NEAR * _STEEPEST * (high - low):
            found.append((k, target, wanted))
    if not found:
        return None
    after, targets, inputs = zip(*found, strict=True)
    if first == "operator":
        return _Asked(after, [gain * y for y in targets], inputs, high - low)
    return _Asked(after, targets, [v / gain for v in inputs], (high - low) / abs(gain))


def _inputs(model: Preisach, count: int, memory: int) -> FloatArray:
    """Return inputs over the whole plane whose histories fit into a bounded memory."""
    low, high = map(float, model.levels[[0, -1]])
    rng, tracker, chosen = np.random.default_rng(0), model.track(), []
    for share in rng.beta(0.7, 0.7, count):
        u = low + float(share) * (high - low)
        for wanted in (u, high):
            trial = tracker.copy()
            trial.push(wanted)
            if len(trial.memory) <= memory:  # with the present input
                break
        tracker.push(wanted)
        chosen.append(wanted)
    return np.array(chosen)


def _stepped(cascade: Cascade, u: FloatArray) -> FloatArray:
    """Return the outputs of a cascade from negative saturation."""
    state, y = _begun(cascade), np.empty(u.size)
    for k, sample in enumerate(u):
        y[k], state = cascade.step(state, float(sample))
    return y


def _begun(cascade: Cascade) -> CascadeState:
    """Return the state of a cascade that is settled in negative saturation."""
    low = float(cascade.operator.levels[0])  # type: ignore[attr-defined]
    return cascade.begin(low if cascade.first == "operator" else low / cascade.linear.dc_gain)

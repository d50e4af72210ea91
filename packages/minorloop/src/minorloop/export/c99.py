"""Export of a model as portable C: one header, one source file, fixed memory, no allocation."""

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import as_whole, check_option
from minorloop.dynamics.cascade import First
from minorloop.dynamics.linear import Linear
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.export._after_effect import after_effect_parts
from minorloop.export._plays import plays_parts
from minorloop.export._relays import relay_parts
from minorloop.export._selftest import asked_of, examples, selftest, width_of, worst_digit
from minorloop.export._tables import Numbers, Parts, operator_tables, text_only
from minorloop.export._templates import render
from minorloop.files import PathLike, write_folder
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.memory import LEAST_ROOM, MOST_ROOM, ROOM
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel
from minorloop.version import __version__

__all__ = ["CSource", "export_c", "source"]

_LONGEST_NAME = 40
"""Characters of the name, so that public names have fewer than 63, as many as C99 distinguishes."""
_COMMENT = 96
"""Characters of a line in a comment."""
_MOST_LAG = 100_000
"""Intervals of dead time, each of which takes a number in a state."""
_OTHERS = (PrandtlIshlinskii, GeneralisedPrandtlIshlinskii, RelayModel, AfterEffect)


@dataclass(frozen=True)
class CSource:
    """The C of a model."""

    files: dict[str, str]
    """Text of each file, by its name."""
    table_bytes: int
    """Bytes of constant tables, which a linker puts into flash."""
    state_bytes: int
    """Bytes of one state, in RAM."""
    memory: int
    """Extrema that a state remembers."""
    drop_error: float
    """Largest change of the output by dropping one pair of extrema, in its unit."""
    input_error: float
    """Largest change of the output by a last digit of the input in the type of the C, where the
    output is steepest, as a share of its range; 0 for relays and plays, where it is not computed.
    """

    def write(self, folder: PathLike, *, force: bool = False) -> Path:
        """Write the files into a new or empty folder.

        Raises an `OutputError` if the folder is not empty or cannot be written to.

        Parameters
        ----------
        folder : str or path
            The folder.
        force : bool
            Whether the folder may contain files; those of the same names are replaced.
        """
        return write_folder(folder, self.files, force=force)


def export_c(model: Any, folder: PathLike, *, force: bool = False, **options: Any) -> CSource:
    """Write the C of a model into a folder, with parameters and errors as of `CSource.write`.

    Parameters
    ----------
    model, **options
        As of `source`, whose errors this has too.
    """
    code = source(model, **options)
    code.write(folder, force=force)
    return code


def source(
    model: Any,
    *,
    name: str = "minorloop",
    memory: int = ROOM,
    float32: bool = False,
    inverse: bool = True,
    linear: Linear | None = None,
    first: First = "operator",
    input: str = "input",
    output: str = "output",
    largest: int | None = None,
    firmware: bool = False,
    interval: float | None = None,
    warnings: Sequence[str] = (),
) -> CSource:
    """Return the C99 of a model.

    Raises a `NotInvertibleError` if ``inverse`` is true and the model has none; a `ParameterError`
    if C of this kind cannot hold the model, rounding inputs or outputs to its type costs more than
    1 % of the output's range, it needs more bytes than allowed, or an option is out of its range.

    Parameters
    ----------
    model : Preisach, RelayModel, PrandtlIshlinskii, GeneralisedPrandtlIshlinskii or AfterEffect
        The operator. Only a Preisach operator can have a linear part; relays have no inverse.
    name : str
        Name of the files, and prefix of all public names in them.
    memory : int
        Remembered extrema of the input, at least 6. When a history has more, the pair with the
        least effect is dropped; the C computes a bound of the output error.
    float32 : bool
        Whether to compute in single precision.
    inverse : bool
        Whether to write the inverse too.
    linear : Linear, optional
        A sampled linear part with a DC gain, stepped together with the operator.
    first : {"operator", "linear"}
        Which of the two receives the input.
    input, output : str
        Names of input and output, for the comments.
    largest : int, optional
        Most bytes of tables and one state together.
    firmware : bool
        Whether to write a sketch of firmware too, with the serial protocol of
        `minorloop.lab.drivers.serial_line`.
    interval : float, optional
        Seconds of one step, for an operator with after-effect only.
    warnings : sequence of str
        Why the model is not to be trusted, for a comment at the top of header and source.
    """
    _check_options(name, memory)
    check_option("first", first, ("operator", "linear"))
    words = {"name": name, "input": input, "output": output, "notice": "; ".join(warnings)}
    numbers = Numbers(float32)
    if isinstance(model, _OTHERS):
        if linear is not None or firmware:
            raise ParameterError(
                f"C of a {type(model).__name__} has no linear part and no firmware; identify a "
                "Preisach model for these"
            )
        if isinstance(model, AfterEffect):
            return _timed_source(model, numbers, inverse, largest, words, interval, memory)
        return _other_source(model, numbers, inverse, largest, words)
    operator = _as_preisach(model, inverse)
    context, table_bytes, state_bytes = _preisach_tables(operator, linear, first, numbers, memory)
    _check_bytes(table_bytes, state_bytes, largest)
    drop_error = context["swing"] / (memory - 3)
    u, y, digit = examples(operator, numbers, memory, linear, first)
    input_error = max(digit, worst_digit(operator, numbers))
    context |= {
        "single": f"{drop_error:.3g}",
        "input_error": f"{input_error:.2g}",
        **_common("a Preisach operator with piecewise uniform density", numbers, inverse, words),
    }
    invertible = inverse and operator.range[0] < operator.range[1]
    asked = asked_of(operator, linear, first, u) if invertible and linear is not None else None
    both_ways = invertible and linear is None
    width = width_of(operator, linear)
    test = selftest(context, numbers, u, y, width, both_ways, digit, asked)
    files = _files("model", context, test)
    if firmware:
        low, high = map(float, operator.levels[[0, -1]])
        safe = numbers.one(min(max(0.0, low), high))
        files[f"{name}_firmware.c"] = render("firmware.c", {**context, "safe": safe})
    return CSource(files, table_bytes, state_bytes, memory, drop_error, input_error)


def _other_source(
    model: Any,
    numbers: Numbers,
    inverse: bool,
    largest: int | None,
    words: Mapping[str, str],
) -> CSource:
    """Return the C of plays and of relays, whose memory has a fixed size."""
    if isinstance(model, RelayModel):
        numbers.check_range("input", model.levels)
    make: Any = relay_parts if isinstance(model, RelayModel) else plays_parts
    parts: Parts = make(model, numbers, inverse)
    _check_bytes(parts.table_bytes, parts.state_bytes, largest)
    context = parts.context | _common(parts.title, numbers, inverse, words)
    u = numbers.array(parts.inputs).astype(np.float64)
    if isinstance(model, RelayModel):  # outputs jump at the thresholds as the C rounds them
        model = replace(model, levels=numbers.array(model.levels).astype(np.float64))
    y = model.simulate(u, parts.start)
    numbers.check_range("input", u)
    numbers.check_range("output", y)
    test = selftest(context, numbers, u, y, float(np.ptp(y)), inverse)
    files = _files(parts.template, context, test)
    return CSource(files, parts.table_bytes, parts.state_bytes, parts.memory, 0.0, 0.0)


def _timed_source(
    model: AfterEffect,
    numbers: Numbers,
    inverse: bool,
    largest: int | None,
    words: Mapping[str, str],
    interval: float | None,
    memory: int,
) -> CSource:
    """Return the C of an operator with after-effect, stepped at a fixed interval."""
    parts = after_effect_parts(model, numbers, inverse, interval, memory)
    _check_bytes(parts.table_bytes, parts.state_bytes, largest)
    context = parts.context | _common(parts.title, numbers, inverse, words)
    u = numbers.array(parts.inputs).astype(np.float64)
    y = model.simulate(float(interval or 1.0) * np.arange(u.size), u)
    width = model.range[1] - model.range[0]
    test = selftest(context, numbers, u, y, width, inverse, targets=y)
    swing = model.plane.swing * float(np.abs(model.plane.weights).sum() + np.abs(model.creep).sum())
    drop_error = swing / (memory - 3)
    files = _files(parts.template, context, test)
    return CSource(files, parts.table_bytes, parts.state_bytes, memory, drop_error, 0.0)


def _files(template: str, context: dict[str, Any], test: str) -> dict[str, str]:
    """Return header, source and self-test by their names."""
    name = context["name"]
    return {
        f"{name}.h": render(f"{template}.h", context),
        f"{name}.c": render(f"{template}.c", context),
        f"{name}_selftest.c": test,
    }


def _preisach_tables(
    operator: Preisach, linear: Linear | None, first: First, numbers: Numbers, memory: int
) -> tuple[dict[str, Any], int, int]:
    """Return the context of operator and linear part, and the bytes of tables and of a state."""
    numbers.check_range("input", operator.levels)
    numbers.check_range("output", operator.range)
    context, table_bytes = operator_tables(operator, numbers)
    state_bytes = _state_bytes(numbers.size, memory)
    context |= {
        "sqrt": "sqrtf" if numbers.single else "sqrt",
        "memory": memory,
        "linear": None,
        "about": about(operator, linear, first),
    }
    if linear is not None:
        part, tables = _linear_context(linear, first, numbers)
        context["linear"] = part
        context["tables"] |= tables
        table_bytes += 2 * numbers.size * part["order"]
        state_bytes += numbers.size * (part["order"] + part["lag"] + (part["lag"] > 0))
    return context, table_bytes, state_bytes


def _common(what: str, numbers: Numbers, inverse: bool, words: Mapping[str, str]) -> dict[str, Any]:
    """Return the context that all templates have in common."""
    return {
        "guard": words["name"].upper(),
        "real": numbers.type,
        "inverse": inverse,
        "version": __version__,
        **(text := text_only(words)),
        "title": f"Hysteresis of an actuator: {what}.{_notice(text['notice'])}",
    }


def _notice(warnings: str) -> str:
    """Return a comment that says why the model is not to be trusted; empty if nothing does."""
    if not warnings:
        return ""
    lines = textwrap.wrap(f"WARNING: this model is not to be trusted: {warnings}", _COMMENT)
    return "".join(f"\n * {line}" for line in ["", *lines]).replace("* \n", "*\n")


def _as_preisach(model: Any, inverse: bool) -> Preisach:
    if not isinstance(model, Preisach):
        raise ParameterError(
            f"C is written for Preisach models, relays and plays, and this is a "
            f"{type(model).__name__}; "
            "identify a Preisach model from the same record"
        )
    if inverse and not model.monotone:
        raise NotInvertibleError(
            f"the model is not monotone (least weight {model.weights.min():g}), so its C cannot "
            "have an inverse; export it without (inverse=False, --no-inverse), or identify with "
            "signed=False"
        )
    return model


def _check_options(name: str, memory: int) -> None:
    if not re.fullmatch(r"[a-zA-Z][a-zA-Z0-9_]*", name) or len(name) > _LONGEST_NAME:
        raise ParameterError(
            f"name {name!r} cannot begin the names in C; give a letter, then letters, digits and "
            f"underscores, {_LONGEST_NAME} at most"
        )
    as_whole("memory", memory, LEAST_ROOM, MOST_ROOM)


def _check_bytes(table_bytes: int, state_bytes: int, largest: int | None) -> None:
    if largest is not None and largest < 1:
        raise ParameterError(f"largest is {largest} bytes; give a positive number of them")
    needed = table_bytes + state_bytes
    if largest is not None and needed > largest:
        raise ParameterError(
            f"the model needs {needed} bytes, {table_bytes} of tables and {state_bytes} of state, "
            f"and {largest} are allowed; allow more, use fewer levels, a smaller memory, or float32"
        )


def _state_bytes(size: int, memory: int) -> int:
    """Return the bytes of a state without linear part, padded as by compilers."""
    extremum = 20 if size == 4 else 40
    return (memory + 1) * extremum + 8 + 4 * size


def _linear_context(
    linear: Linear, first: First, numbers: Numbers
) -> tuple[dict[str, Any], dict[str, str]]:
    if linear.interval is None:
        raise ParameterError(
            "the linear part is continuous; give linear.discretise(interval) with the interval at "
            "which the C will step"
        )
    if linear.lag > _MOST_LAG:
        raise ParameterError(
            f"the linear part has a delay of {linear.delay:g} s, for which the C would have to "
            f"store {linear.lag} intervals; give at most {_MOST_LAG}"
        )
    if not np.isfinite(linear.dc_gain) or linear.dc_gain == 0:
        raise ParameterError(
            f"the linear part has a DC gain of {linear.dc_gain:g} and no settled state to begin "
            "from; give one whose DC gain is finite and not zero"
        )
    if not linear.stable:
        raise ParameterError("the linear part is unstable; give one that settles")
    context = {
        "order": linear.order,
        "lag": linear.lag,
        "interval": numbers.one(linear.interval),
        "feedthrough": numbers.one(linear.state_space[3]),
        "gain": numbers.one(linear.dc_gain),
        "rest": numbers.one(1 / linear.at_rest(linear.denominator)),
        "first": first,
    }
    tables = {
        "transition": numbers.table(-linear.denominator[1:]),
        "readout": numbers.table(linear.state_space[2]),
    }
    return context, tables


def about(model: Preisach, linear: Linear | None, first: First) -> str:
    """Return a comment that describes the model."""
    parts = f"{model.bands} bands, {model.relay} relays, {model.diagonal} diagonal"
    if linear is None:
        return f"{parts}."
    order = "after" if first == "operator" else "before"
    return f"{parts}; a linear part of order {linear.order} {order} it."

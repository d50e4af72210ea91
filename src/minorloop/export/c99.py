"""Export of a model as portable C: one header, one source file, fixed memory, no allocation."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import check_option
from minorloop.dynamics.cascade import First
from minorloop.dynamics.linear import Linear
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.export._plays import plays_parts
from minorloop.export._relays import relay_parts
from minorloop.export._selftest import asked_of, examples, selftest, width_of
from minorloop.export._tables import Numbers, Parts, operator_tables, text_only
from minorloop.export._templates import render
from minorloop.files import PathLike, make_folder, write_atomically
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.memory import ROOM
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel
from minorloop.version import __version__

__all__ = ["CSource", "export_c", "source"]

LEAST_MEMORY = 6
MOST_MEMORY = 10_000
_RESERVED = 40
_COMMENT = 96
_MOST_LAG = 100_000
_OTHERS = (PrandtlIshlinskii, GeneralisedPrandtlIshlinskii, RelayModel)


@dataclass(frozen=True)
class CSource:
    """C for a model.

    Parameters
    ----------
    files : dict of str to str
        Text of each file, by its name.
    table_bytes : int
        Of constant tables, which a linker puts into flash.
    state_bytes : int
        Of one state, in RAM.
    memory : int
        Extrema that a state remembers.
    drop_error : float
        Most that dropping one pair of extrema can change the output by, in its unit.
    input_error : float
        Most that rounding the input to the type of the C changes the output by, on the inputs of
        the self-test, as a share of its range; 0 for relays and plays, for which it is not weighed.
    """

    files: dict[str, str]
    table_bytes: int
    state_bytes: int
    memory: int
    drop_error: float
    input_error: float

    def write(self, folder: PathLike, *, force: bool = False) -> Path:
        """Write the files into a folder, which is made or has to be empty.

        Parameters
        ----------
        folder : str or path
            Where they go.
        force : bool
            Whether the folder may hold files, of which those of the same names are replaced.

        Raises
        ------
        OutputError
            If the folder is not empty or cannot be written to.
        """
        place = make_folder(folder, force=force)
        for name, text in self.files.items():
            write_atomically(place / name, text)
        return place


def export_c(model: Any, folder: PathLike, *, force: bool = False, **options: Any) -> CSource:
    """Write a model as C into a folder.

    Parameters
    ----------
    model : Preisach, RelayModel, PrandtlIshlinskii or GeneralisedPrandtlIshlinskii
        The model.
    folder : str or path
        Where the files go; it is made, or has to be empty.
    force : bool
        Whether it may hold files, of which those of the same names are replaced.
    **options
        Of `source`.

    Returns
    -------
    CSource

    Raises
    ------
    OutputError
        If the folder is not empty or cannot be written to.
    NotInvertibleError, ParameterError
        As for `source`.
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
    warnings: Sequence[str] = (),
) -> CSource:
    """A model as C99.

    Parameters
    ----------
    model : Preisach, RelayModel, PrandtlIshlinskii or GeneralisedPrandtlIshlinskii
        The operator; all but the first without linear part, and relays without inverse.
    name : str
        Of the files, and what every public name in them begins with.
    memory : int
        Remembered extrema of the input, at least 6. When a history has more, the pair that
        matters least is dropped; the C says by how much the output can be off.
    float32 : bool
        Whether to compute in single precision.
    inverse : bool
        Whether to write the inverse too.
    linear : Linear, optional
        A sampled linear part with a DC gain, stepped together with the operator.
    first : {"operator", "linear"}
        Which of the two the input meets first.
    input, output : str
        What the model maps, for the comments.
    largest : int, optional
        Most bytes that tables and one state may take together.
    firmware : bool
        Whether to write a sketch of firmware too, which speaks the serial protocol of
        `minorloop.lab.drivers.serial_line`.
    warnings : sequence of str
        Why the model is not to be trusted; a comment at the top of header and source says so.

    Raises
    ------
    NotInvertibleError
        If an inverse is asked for and the model has none.
    ParameterError
        If C of this kind cannot hold the model, rounding inputs or outputs to its type costs
        more than 1 % of the output's range, it needs more bytes than allowed, or an option is
        out of its range.
    """
    _check_options(name, memory)
    check_option("first", first, ("operator", "linear"))
    words = {"name": name, "input": input, "output": output, "notice": "; ".join(warnings)}
    if isinstance(model, _OTHERS):
        if linear is not None or firmware:
            raise ParameterError(
                f"C of a {type(model).__name__} has no linear part and no firmware; identify a "
                "Preisach model for these"
            )
        return _other_source(model, Numbers(float32), inverse, largest, words)
    operator = _as_preisach(model, inverse)
    numbers = Numbers(float32)
    numbers.check_range("input", operator.levels)
    numbers.check_range("output", operator.range)
    context, table_bytes = operator_tables(operator, numbers)
    state_bytes = _state_bytes(numbers.size, memory)
    if linear is not None:
        context["linear"], tables = _linear_context(linear, first, numbers)
        context["tables"] |= tables
        states = context["linear"]["order"] + context["linear"]["lag"]
        table_bytes += 2 * numbers.size * context["linear"]["order"]
        state_bytes += numbers.size * (states + (context["linear"]["lag"] > 0))
    _check_bytes(table_bytes, state_bytes, largest)
    drop_error = context["swing"] / (memory - 3)
    u, y, digit = examples(operator, numbers, memory, linear, first)
    context |= {
        "single": f"{drop_error:.3g}",
        "sqrt": "sqrtf" if float32 else "sqrt",
        "memory": memory,
        "input_error": f"{digit:.2g}",
        "linear": context.get("linear"),
        "about": about(operator, linear, first),
        **_common("a Preisach operator with piecewise uniform density", numbers, inverse, words),
    }
    both_ways = inverse and operator.range[0] < operator.range[1]
    asked = None
    if both_ways and linear is not None:
        asked, both_ways = asked_of(operator, linear, first, u), False
    files = {
        f"{name}.h": render("model.h", context),
        f"{name}.c": render("model.c", context),
        f"{name}_selftest.c": selftest(
            context, numbers, u, y, width_of(operator, linear), both_ways, digit, asked
        ),
    }
    if firmware:
        low, high = map(float, operator.levels[[0, -1]])
        safe = numbers.one(min(max(0.0, low), high))
        files[f"{name}_firmware.c"] = render("firmware.c", {**context, "safe": safe})
    return CSource(files, table_bytes, state_bytes, memory, drop_error, digit)


def _other_source(
    model: Any,
    numbers: Numbers,
    inverse: bool,
    largest: int | None,
    words: Mapping[str, str],
) -> CSource:
    """C of plays, with or without dead zones, and of relays; their memory has a fixed size."""
    if isinstance(model, RelayModel):
        numbers.check_range("input", model.levels)
    make: Any = relay_parts if isinstance(model, RelayModel) else plays_parts
    parts: Parts = make(model, numbers, inverse)
    _check_bytes(parts.table_bytes, parts.state_bytes, largest)
    context = parts.context | _common(parts.title, numbers, inverse, words)
    u = numbers.array(parts.inputs).astype(np.float64)
    if isinstance(model, RelayModel):  # whose outputs jump where the C has its thresholds
        model = replace(model, levels=numbers.array(model.levels).astype(np.float64))
    y = model.simulate(u, parts.start)
    numbers.check_range("input", u)
    numbers.check_range("output", y)
    name = words["name"]
    files = {
        f"{name}.h": render(f"{parts.template}.h", context),
        f"{name}.c": render(f"{parts.template}.c", context),
        f"{name}_selftest.c": selftest(context, numbers, u, y, float(np.ptp(y)), inverse),
    }
    return CSource(files, parts.table_bytes, parts.state_bytes, parts.memory, 0.0, 0.0)


def _common(what: str, numbers: Numbers, inverse: bool, words: Mapping[str, str]) -> dict[str, Any]:
    """Context for all templates."""
    return {
        "guard": words["name"].upper(),
        "real": numbers.type,
        "inverse": inverse,
        "version": __version__,
        **(text := text_only(words)),
        "title": f"Hysteresis of an actuator: {what}.{_notice(text['notice'])}",
    }


def _notice(warnings: str) -> str:
    """Say in a comment why the model is not to be trusted; nothing where nothing is wrong."""
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
    if not re.fullmatch(r"[a-zA-Z][a-zA-Z0-9_]*", name) or len(name) > _RESERVED:
        raise ParameterError(
            f"name {name!r} cannot begin the names in C; give a letter, then letters, digits and "
            f"underscores, {_RESERVED} at most"
        )
    if isinstance(memory, bool) or not isinstance(memory, int | np.integer):
        raise ParameterError(f"memory is {memory!r}; give a whole number of extrema")
    if not LEAST_MEMORY <= memory <= MOST_MEMORY:
        raise ParameterError(
            f"memory is {memory} extrema; give {LEAST_MEMORY} to {MOST_MEMORY}, 32 serve most"
        )


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
    """Of a state without linear part, padded as compilers do."""
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
            f"the linear part has a delay of {linear.delay:g} s, and the C would have to "
            f"remember {linear.lag} intervals; give at most {_MOST_LAG}"
        )
    if not np.isfinite(linear.dc_gain) or linear.dc_gain == 0:
        raise ParameterError(
            f"the linear part has a DC gain of {linear.dc_gain:g}; there is nothing settled to "
            "begin from, so give one whose DC gain is finite and not zero"
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
    """Comment that describes the model."""
    parts = f"{model.bands} bands, {model.relay} relays, {model.diagonal} diagonal"
    if linear is None:
        return f"{parts}."
    order = "after" if first == "operator" else "before"
    return f"{parts}; a linear part of order {linear.order} {order} it."

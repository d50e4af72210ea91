"""Export of a model as portable C: one header, one source file, fixed memory, no allocation."""

import re
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from minorloop.arrays import as_whole
from minorloop.dynamics.cascade import Cascade, First
from minorloop.dynamics.linear import Linear
from minorloop.errors import ParameterError
from minorloop.export._kinds import parts_of, preisach_parts
from minorloop.export._selftest import selftest
from minorloop.export._tables import Numbers, render, text_only
from minorloop.files import PathLike, write_folder
from minorloop.modelfile import ModelFile
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.memory import LEAST_ROOM, MOST_ROOM, ROOM
from minorloop.operators.preisach import Preisach
from minorloop.version import __version__

_LONGEST_NAME = 40
"""Most characters of the name: public names then have fewer than the 63 that C99 distinguishes."""


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
    """Number of extrema that a state remembers."""
    drop_error: float
    """Largest change of the output if a pair of extrema is dropped, in its unit."""
    input_error: float
    """Largest change of the output by a last digit of the input in the type of the C, where the
    output is steepest, as a share of its range; 0 for relays and plays, where it is not computed.
    """

    def write(self, folder: PathLike, *, force: bool = False) -> Path:
        """Write the files into a new or empty folder.

        Raises an `OutputError` if the folder is not empty or cannot be written to.

        ``folder``: the folder; ``force``: whether the folder may contain files; files of the same
        names are replaced.
        """
        return write_folder(folder, self.files, force=force)


def export_c(model: Any, folder: PathLike, *, force: bool = False, **options: Any) -> CSource:
    """Write the C of a model into a folder, with parameters and errors as of `CSource.write`.

    ``model``, ``**options`` and errors are as of `source`.
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
    interval: float | None = None,
    largest: int | None = None,
    firmware: bool = False,
) -> CSource:
    """Return the C99 of a model.

    Raises a `NotInvertibleError` if ``inverse`` is true and the model has none; a `ParameterError`
    if C of this kind cannot hold the model, rounding of inputs or outputs changes the output by
    more than 1 % of its range, it needs more bytes than allowed, or an option is out of its range.

    Parameters
    ----------
    model : ModelFile, Preisach, RelayModel, PrandtlIshlinskii, GeneralisedPrandtlIshlinskii,
            AfterEffect or Cascade
        The model. A `ModelFile` also gives names, units and warnings for the comments. Relays have
        no inverse. A cascade has a Preisach operator, and a linear part with a DC gain, which is
        stepped together with it; creep of its output is left out.
    name : str
        Name of the files, and prefix of all public names in them.
    memory : int
        Remembered extrema of the input, at least 6. When a history has more, the pair with the
        least effect is dropped; the C computes a bound of the output error.
    float32 : bool
        Whether to compute in single precision.
    inverse : bool
        Whether to write the inverse too.
    interval : float, optional
        Seconds of one step, for a model with after-effect or dynamics; by default the interval of
        the linear part.
    largest : int, optional
        Most bytes of tables and one state together.
    firmware : bool
        Whether to also write a draft of firmware, with the serial protocol of
        `minorloop.lab.drivers.serial_line`.
    """
    words = {"name": name, "input": "input", "output": "output", "notice": ""}
    if isinstance(model, ModelFile):
        words |= {"input": str(model.input), "output": str(model.output)}
        words["notice"] = "; ".join(model.warnings)
        model = model.model
    if not re.fullmatch(r"[a-zA-Z][a-zA-Z0-9_]*", name) or len(name) > _LONGEST_NAME:
        raise ParameterError(
            f"name {name!r} cannot begin the names in C; give a letter, then letters, digits and "
            f"underscores, at most {_LONGEST_NAME}"
        )
    as_whole("memory", memory, LEAST_ROOM, MOST_ROOM)
    numbers = Numbers(float32)
    operator, linear, first = split(model, interval)
    if not isinstance(operator, Preisach) and (linear is not None or firmware):
        raise ParameterError(
            f"C of a {type(operator).__name__} has no linear part and no firmware; identify a "
            "Preisach model for these"
        )
    if isinstance(operator, Preisach):
        parts = preisach_parts(operator, numbers, inverse, memory, linear, first)
    else:
        parts = parts_of(operator, numbers, inverse, memory, interval)
    _check_bytes(parts.table_bytes, parts.state_bytes, largest)
    context = {
        **parts.context,
        "guard": name.upper(),
        "real": numbers.type,
        "inverse": inverse,
        "version": __version__,
        **(text := text_only(words)),
        "title": f"Hysteresis of an actuator: {parts.title}.{_notice(text['notice'])}",
    }
    files = {
        f"{name}.h": render(f"{parts.template}.h", context),
        f"{name}.c": render(f"{parts.template}.c", context),
        f"{name}_selftest.c": selftest(context, numbers, parts),
    }
    if firmware:
        low, high = map(float, operator.levels[[0, -1]])
        safe = numbers.one(min(max(0.0, low), high))
        files[f"{name}_firmware.c"] = render("firmware.c", {**context, "safe": safe})
    bytes_of = parts.table_bytes, parts.state_bytes
    return CSource(files, *bytes_of, parts.memory, parts.drop_error, parts.input_error)


def split(model: Any, interval: float | None) -> tuple[Any, Linear | None, First]:
    """Return the operator of a model, its linear part sampled at the interval, and the first part.

    Raises a `ParameterError` if an interval is given for a model without time, or a cascade has
    dynamics on both sides or a linear part of another interval.
    """
    if not isinstance(model, Cascade):
        if interval is not None and not isinstance(model, AfterEffect):
            raise ParameterError(
                "the model has no dynamics, so an interval has no effect (interval, "
                "--interval); leave it out"
            )
        return model, None, "operator"
    if model.ahead is not None:
        raise ParameterError(
            "the model has dynamics on both sides of the operator, which exports do not support; "
            "identify with dynamics on one side (--law dynamics:first=operator or linear)"
        )
    if interval is None and model.linear.interval is None:
        raise ParameterError(
            "the model has dynamics and its linear part is continuous; give the seconds between "
            "samples (interval, --interval)"
        )
    sampled = model if interval is None else model.sampled(interval)
    return sampled.operator, sampled.linear, sampled.first


def _notice(warnings: str) -> str:
    """Return a comment with reasons not to trust the model; empty without warnings."""
    if not warnings:
        return ""
    # Characters of a line in a comment
    lines = textwrap.wrap(f"WARNING: this model is not to be trusted: {warnings}", 96)
    return "".join(f"\n * {line}" for line in ["", *lines]).replace("* \n", "*\n")


def _check_bytes(table_bytes: int, state_bytes: int, largest: int | None) -> None:
    if largest is not None and largest < 1:
        raise ParameterError(f"largest is {largest} bytes; give a positive number of them")
    needed = table_bytes + state_bytes
    if largest is not None and needed > largest:
        raise ParameterError(
            f"the model needs {needed} bytes, {table_bytes} of tables and {state_bytes} of state, "
            f"and {largest} are allowed; allow more, use fewer levels, a smaller memory, or float32"
        )

"""Format numbers and tables of the exported operator in C."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.operators import plane
from minorloop.operators.preisach import Preisach

VECTORS = 200
"""Inputs of a self-test, in about 10 kB of C."""
_COLUMNS = 100
"""Longest line of a table."""
_MOST_SINGLE, _MOST_DOUBLE = 1e15, 1e150
"""Largest range of a signal, and inverse of the least, by the type of the C: their squares are
within 1e38 and 1e308, the largest numbers of these types."""


@dataclass(frozen=True)
class Numbers:
    """Format of numbers of one type in C."""

    single: bool
    """Whether they are ``float``; ``double`` otherwise."""

    @property
    def type(self) -> str:
        """Name of the type in C."""
        return "float" if self.single else "double"

    @property
    def size(self) -> int:
        """Bytes of one number."""
        return 4 if self.single else 8

    def array(self, values: npt.ArrayLike) -> npt.NDArray[Any]:
        """Return numbers rounded to the type.

        Raises a `ParameterError` if one is too large for it.
        """
        wide = np.asarray(values, dtype=np.float64)
        if self.single and (np.abs(wide) > np.finfo(np.float32).max).any():
            raise ParameterError(
                f"the model holds {np.abs(wide).max():g}, more than a float can; export doubles"
            )
        return wide.astype(np.float32 if self.single else np.float64)

    def check_range(self, what: str, values: npt.ArrayLike) -> None:
        """Refuse ranges whose squares, or slopes against one another, the type cannot hold.

        Raises a `ParameterError` if the range is too large or too small.
        """
        low, high = float(np.min(values)), float(np.max(values))
        most = _MOST_SINGLE if self.single else _MOST_DOUBLE
        if high / 2 - low / 2 > most / 2 or 0 < high - low < 1 / most:
            raise ParameterError(
                f"the {what} goes from {low:g} to {high:g}, and C with a {self.type} can have "
                f"ranges from {1 / most:g} to {most:g}; "
                + ("export doubles, or " if self.single else "")
                + "identify in another unit"
            )

    def one(self, value: float) -> str:
        """Return a literal of exactly this number, in brackets if it is negative."""
        number = self.array(value)
        text = f"{float(number):.9g}" if self.single else repr(float(number))
        if not set(text) & {".", "e"}:
            text += ".0"
        text += "f" if self.single else ""
        return f"({text})" if text.startswith("-") else text

    def table(self, values: Iterable[float]) -> str:
        """Return the content of an initialiser."""
        return wrapped(self.one(value).strip("()") for value in values)


@dataclass(frozen=True)
class Parts:
    """Template context and self-test of a model whose memory has a fixed size."""

    context: dict[str, Any]
    table_bytes: int
    state_bytes: int
    memory: int
    inputs: FloatArray
    start: str
    template: str
    title: str


def wrapped(words: Iterable[str]) -> str:
    """Return words with commas, in lines of bounded length."""
    lines, line = [], ""
    for word in words:
        if line and len(line) + len(word) + 2 > _COLUMNS - 4:
            lines.append(line)
            line = ""
        line += f"{word}, " if line else f"    {word}, "
    return "\n".join(text.rstrip() for text in [*lines, line])


def operator_tables(model: Preisach, numbers: Numbers) -> tuple[dict[str, Any], int]:
    """Return the template context of an operator, and the bytes of its tables.

    Raises a `ParameterError` if levels coincide or numbers overflow in the type of the C.
    """
    levels = numbers.array(model.levels)
    if not (np.diff(levels) > 0).all():
        raise ParameterError(
            f"levels are only {np.diff(model.levels).min():g} apart around "
            f"{np.abs(model.levels).max():g}, which a float cannot distinguish; export doubles"
        )
    begun, per_unit = plane.buckets(levels)
    nodes = model.tables.nodes
    signed = bool((model.weights < 0).any())
    bowed = model.diagonal == "uniform"
    tables = {
        "levels": numbers.table(levels),
        "per_band": numbers.table(1 / np.diff(levels.astype(np.float64))),
        "begun": wrapped(str(int(band)) for band in begun),
        "nodes": numbers.table(_packed(nodes)),
        "bow": numbers.table(nodes.diagonal(-1)),
    }
    unsigned = model.swing * plane.nodes_from_weights(np.abs(model.weights))
    if signed:
        tables["nodes_unsigned"] = numbers.table(_packed(unsigned))
        tables["bow_unsigned"] = numbers.table(unsigned.diagonal(-1))
    wide = model.bands > 256
    count = levels.size + model.bands + (1 + signed) * (_packed(nodes).size + bowed * model.bands)
    context = {
        "tables": tables,
        "bands": model.bands,
        "slices": begun.size,
        "narrow": bool((np.diff(begun) <= 1).all()),
        "slice_type": "uint16_t" if wide else "uint8_t",
        "per_unit": numbers.one(per_unit),
        "saturation": numbers.one(model.all_off),
        "slope": numbers.one(model.slope),
        "sloped": model.slope != 0,
        "signed": signed,
        "bowed": bowed,
        "begin": numbers.one(model.all_off + model.slope * float(model.levels[0])),
        "low": numbers.one(model.levels[0]),
        "high": numbers.one(model.levels[-1]),
        "reach_low": numbers.one(model.range[0]),
        "reach_high": numbers.one(model.range[1]),
        "swing": float(model.swing * np.abs(model.weights).sum()),
    }
    return context, numbers.size * count + (2 if wide else 1) * begun.size


def text_only(words: Mapping[str, str]) -> dict[str, str]:
    """Return texts that are safe in a comment in C."""
    return {
        name: " ".join("".join(c if c.isprintable() else " " for c in text).split())
        .replace("*/", "* /")
        .replace("/*", "/ *")
        for name, text in words.items()
    }


def _packed(nodes: FloatArray) -> FloatArray:
    """Return the rows of a lower triangle one after the other."""
    return np.asarray(nodes[np.tril_indices(len(nodes))])

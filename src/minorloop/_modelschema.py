"""What a model file holds, key by key, and how its parts become models and text.

`minorloop.modelfile` describes the format in words; here it is as types. A key that is no
field of its type is refused.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import msgspec
import numpy as np

from minorloop.arrays import FloatArray, as_levels, frozen
from minorloop.errors import ParameterError, RecordError
from minorloop.files import PathLike, shown
from minorloop.operators.dead_zones import DeadZones
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.plane import Relay
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Diagonal, Preisach
from minorloop.operators.relays import RelayModel

Model: TypeAlias = (
    Preisach | RelayModel | PrandtlIshlinskii | GeneralisedPrandtlIshlinskii | Polynomial
)
"""What a model file can hold."""

KINDS: Mapping[type[Model], str] = {
    Preisach: "preisach",
    RelayModel: "relay",
    PrandtlIshlinskii: "prandtl-ishlinskii",
    GeneralisedPrandtlIshlinskii: "generalised-prandtl-ishlinskii",
    Polynomial: "polynomial",
}
"""The word for each class in a file."""


class Provenance(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a model came from.

    Parameters
    ----------
    created : datetime, optional
        When the file was written, in UTC; filled in on writing.
    minorloop : str, optional
        The version that wrote it; filled in on writing.
    data : str, optional
        Name of the file that the model was identified from.
    sha256 : str, optional
        Hexadecimal digest of the bytes of that file.
    scores : dict of str to float
        How good the model is, by name of the score; None for one that does not apply.
    """

    created: Annotated[datetime, msgspec.Meta(tz=True)] | None = None
    minorloop: str | None = None
    data: str | None = None
    sha256: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")] | None = None
    scores: dict[str, float | None] = {}

    @classmethod
    def of(cls, data: PathLike, scores: Mapping[str, float | None] | None = None) -> Provenance:
        """Provenance of a model that was identified from a file.

        Parameters
        ----------
        data : str or path
            The file; its name without the folder is kept, and the digest of its bytes.
        scores : mapping of str to float, optional
            As in the class.

        Raises
        ------
        RecordError
            If the file cannot be read.
        """
        try:
            with open(data, "rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
        except (OSError, ValueError) as error:
            raise RecordError(f"{data} cannot be read: {reason(error)}") from None
        name = shown(os.fsencode(Path(data).name).decode(errors="replace"))
        return cls(data=name, sha256=digest, scores=dict(scores or {}))


class _Strict(msgspec.Struct, forbid_unknown_fields=True):
    """Part of a file."""


class _Kind(_Strict, tag_field="kind"):
    """A model; its fields are the parameters of the class."""


class _Preisach(_Kind, tag=KINDS[Preisach]):
    levels: list[float]
    weights: list[list[float]]
    offset: float
    relay: Relay
    diagonal: Diagonal
    slope: float

    def build(self) -> Preisach:
        levels = as_levels(self.levels)
        weights = _square(self.weights, levels.size - 1)
        return Preisach(levels, weights, self.offset, self.relay, self.diagonal, self.slope)


class _RelayModel(_Kind, tag=KINDS[RelayModel]):
    levels: list[float]
    weights: list[list[float]]
    offset: float
    relay: Relay

    def build(self) -> RelayModel:
        levels = as_levels(self.levels)
        weights = _square(self.weights, levels.size)
        return RelayModel(levels, weights, self.offset, self.relay)


class _Plays(_Strict):
    radii: list[float]
    weights: list[float]
    offset: float

    def build(self) -> PrandtlIshlinskii:
        return PrandtlIshlinskii(frozen(self.radii), frozen(self.weights), self.offset)


class _PrandtlIshlinskii(_Plays, tag_field="kind", tag=KINDS[PrandtlIshlinskii]):
    pass


class _Zones(_Strict):
    thresholds: list[float]
    weights: list[float]

    def build(self) -> DeadZones:
        return DeadZones(frozen(self.thresholds), frozen(self.weights))


class _Generalised(_Kind, tag=KINDS[GeneralisedPrandtlIshlinskii]):
    plays: _Plays
    zones: _Zones
    offset: float

    def build(self) -> GeneralisedPrandtlIshlinskii:
        return GeneralisedPrandtlIshlinskii(self.plays.build(), self.zones.build(), self.offset)


class _Polynomial(_Kind, tag=KINDS[Polynomial]):
    coefficients: list[float]
    low: float
    high: float

    def build(self) -> Polynomial:
        return Polynomial(frozen(self.coefficients), self.low, self.high)


LONGEST_WARNING, MOST_WARNINGS = 1000, 20
Sentence: TypeAlias = Annotated[str, msgspec.Meta(max_length=LONGEST_WARNING, pattern="^[ -~]+$")]
"""A sentence that every terminal shows as it is: printable ASCII."""


class Named(_Strict):
    """A name with its unit."""

    name: str
    unit: str


class Header(msgspec.Struct):
    """What says whether a file is a model file, and how to read the rest of it."""

    format: str = ""
    version: int = 0


class Content(_Strict):
    """A whole file."""

    format: str
    version: int
    input: Named
    output: Named
    lag: Annotated[int, msgspec.Meta(ge=0)]
    model: _Preisach | _RelayModel | _PrandtlIshlinskii | _Generalised | _Polynomial
    provenance: Provenance
    warnings: Annotated[list[Sentence], msgspec.Meta(min_length=1, max_length=MOST_WARNINGS)] = []


def kind_of(model: Model) -> str:
    """The word for the class of a model.

    Raises
    ------
    ParameterError
        If a file cannot hold it.
    """
    for known, word in KINDS.items():
        if isinstance(model, known):
            return word
    names = ", ".join(known.__name__ for known in KINDS)
    raise ParameterError(f"a model file cannot hold a {type(model).__name__}; give one of {names}")


def plain(model: Any) -> dict[str, Any]:
    """The parameters of a model as lists and numbers, squares up to their diagonal."""
    return {field.name: _plain(getattr(model, field.name)) for field in dataclasses.fields(model)}


def layout(value: object, depth: int = 0) -> str:
    """JSON with one key of an object, or one row of a table, a line.

    Raises
    ------
    ValueError
        If a text cannot be written as UTF-8.
    """
    inner, outer = "\n" + "  " * (depth + 1), "\n" + "  " * depth
    if isinstance(value, dict) and value:
        rows = [f"{_compact(key)}: {layout(item, depth + 1)}" for key, item in value.items()]
        return "{" + inner + f",{inner}".join(rows) + outer + "}"
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[" + inner + f",{inner}".join(map(_compact, value)) + outer + "]"
    return _compact(value)


def reason(error: Exception) -> str:
    """One line for why something could not be read or written."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    text = " ".join(str(error).split()).replace("`$.", "`")
    if "`model.kind`" in text:
        text += f"; kinds are {', '.join(KINDS.values())}"
    return text[:400]


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return plain(value)
    if not isinstance(value, np.ndarray):
        return value
    if value.ndim == 2:
        return [row[: i + 1].tolist() for i, row in enumerate(value)]
    return value.tolist()


def _compact(value: object) -> str:
    return msgspec.json.format(msgspec.json.encode(value), indent=0).decode()


def _square(rows: Sequence[Sequence[float]], size: int) -> FloatArray:
    """Rows up to the diagonal as a square with zeros above it."""
    if len(rows) != size:
        raise ParameterError(f"weights have {len(rows)} rows; the levels need {size}")
    for i, row in enumerate(rows):
        if len(row) != i + 1:
            raise ParameterError(f"row {i} of weights has {len(row)} numbers; it needs {i + 1}")
    square: FloatArray = np.zeros((size, size))
    square[np.tril_indices(size)] = [number for row in rows for number in row]
    return square

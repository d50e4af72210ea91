"""Types of the JSON objects in a model file, and conversion to and from models.

`minorloop.modelfile` describes the format in words. The type of a model is derived from its class:
each parameter is a key. Unknown keys are refused.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TypeAlias,
    Union,
    get_args,
    get_type_hints,
)

import msgspec
import numpy as np

from minorloop.arrays import FloatArray, as_levels, frozen
from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.oscillator import Oscillator
from minorloop.errors import ParameterError, RecordError
from minorloop.files import PathLike, printable
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.differential import BoucWen, Duhem
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.memory import Saturation
from minorloop.operators.operator import Operator
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel
from minorloop.registry import loaded, registered

StaticModel: TypeAlias = (
    Preisach | RelayModel | PrandtlIshlinskii | GeneralisedPrandtlIshlinskii | Polynomial
)
"""Classes of operators in model files."""
Model: TypeAlias = StaticModel | Cascade | Linear | AfterEffect | Oscillator
"""Classes of models in model files."""

KINDS: Mapping[type[Any], str] = {
    Preisach: "preisach",
    RelayModel: "relay",
    PrandtlIshlinskii: "prandtl-ishlinskii",
    GeneralisedPrandtlIshlinskii: "generalised-prandtl-ishlinskii",
    Polynomial: "polynomial",
    Cascade: "cascade",
    Linear: "linear",
    AfterEffect: "after-effect",
    Oscillator: "oscillator",
    **{loaded(point, name): name for name, point in registered("minorloop.models").items()},
}
"""The name of each class in a file, with those of other packages."""
_FORCES: Mapping[type[Any], str] = {
    PrandtlIshlinskii: KINDS[PrandtlIshlinskii],
    BoucWen: "bouc-wen",
    Duhem: "duhem",
}
"""The name of each class of the hysteretic force of an oscillator."""


class Provenance(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The origin of a model."""

    created: Annotated[datetime, msgspec.Meta(tz=True)] | None = None
    """When the file was written, in UTC; filled in on writing."""
    minorloop: str | None = None
    """The version that wrote it; filled in on writing."""
    data: str | None = None
    """Name of the file that the model was identified from."""
    sha256: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")] | None = None
    """Hexadecimal digest of the bytes of that file."""
    scores: dict[str, float | None] = {}
    """Scores of the model by name; None for one that does not apply."""

    @classmethod
    def of(cls, data: PathLike, scores: Mapping[str, float | None] | None = None) -> Provenance:
        """Return the provenance of a model that was identified from a file.

        Raises a `RecordError` if the file cannot be read.

        ``data``: the file; its name without the folder and the digest of its bytes are kept;
        ``scores`` is as in the class.
        """
        try:
            with open(data, "rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
        except (OSError, ValueError) as error:
            raise RecordError(f"{data} cannot be read: {reason(error)}") from None
        name = printable(os.fsencode(Path(data).name).decode(errors="replace"))
        return cls(data=name, sha256=digest, scores=dict(scores or {}))

    def is_of(self, data: PathLike) -> bool:
        """Whether the model was identified from a file, or from a copy of it.

        Raises a `RecordError` if the file cannot be read.

        ``data``: the file.
        """
        return self.sha256 is not None and self.sha256 == Provenance.of(data).sha256


class _Strict(msgspec.Struct, forbid_unknown_fields=True):
    """Part of a file; unknown keys are refused."""


_LATER = {(Cascade, "ahead")}
"""Parameters that files have only if they are given, because earlier files lack them."""
_TRIANGLES = {Preisach: -1, RelayModel: 0}
"""Classes whose weights are a triangle, and the number of its rows minus that of the levels."""


def _struct(of: type[Any], **options: Any) -> type[msgspec.Struct]:
    """Return the type of the JSON object for a class, whose fields are its parameters."""
    hints = get_type_hints(of)
    fields: list[Any] = []
    for name in (field.name for field in dataclasses.fields(of)):
        if of in _TRIANGLES and name == "weights":
            fields.append((name, list[list[float]]))
        elif (of, name) == (AfterEffect, "creep"):
            fields.append((name, list[list[list[float]]]))
        elif (of, name) == (Oscillator, "operator"):
            fields.append((name, _AnyForce))
        elif (of, name) in _LATER:
            fields.append((name, _json_type(hints[name]), None))
        else:
            fields.append((name, _json_type(hints[name])))
    struct = msgspec.defstruct(of.__name__, fields, forbid_unknown_fields=True, **options)
    _CLASS_OF[struct] = of
    return struct


def _json_type(hint: Any) -> Any:
    """Return the type of a parameter in JSON."""
    if hint == FloatArray:
        return list[float]
    if hint is Operator:
        return _AnyOperator
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return _struct(hint)
    optional: list[Any] = [part for part in get_args(hint) if dataclasses.is_dataclass(part)]
    return _struct(optional[0]) | None if optional else hint


_CLASS_OF: dict[type[msgspec.Struct], type[Any]] = {}
if TYPE_CHECKING:
    _AnyOperator: TypeAlias = msgspec.Struct
    _AnyForce: TypeAlias = msgspec.Struct
    AnyModel: TypeAlias = msgspec.Struct
else:
    _AnyForce = Union[  # noqa: UP007
        tuple(_struct(_of, tag_field="kind", tag=_word) for _of, _word in _FORCES.items())
    ]
    _TAGGED = []
    for _of, _word in KINDS.items():  # a cascade contains one of the operators before it
        if _of is Cascade:
            _AnyOperator = Union[tuple(_TAGGED)]  # noqa: UP007
        _TAGGED.append(_struct(_of, tag_field="kind", tag=_word))
    AnyModel = Union[tuple(_TAGGED)]  # noqa: UP007
"""JSON objects of any operator, and of any model; their key ``kind`` names the class."""


class LinearPart(_Strict):
    """A linear part alone, as in a file for exports."""

    numerator: list[float]
    denominator: list[float]
    interval: float | None = None
    delay: float = 0.0


_CLASS_OF[LinearPart] = Linear


def build(part: msgspec.Struct) -> Any:
    """Return the model, or a part of one, from its JSON object.

    Raises a `ParameterError` if the class refuses its parameters.
    """
    of = _CLASS_OF[type(part)]
    values: dict[str, Any] = {}
    for name, value in msgspec.structs.asdict(part).items():
        if isinstance(value, msgspec.Struct):
            values[name] = build(value)
        elif name == "levels":
            values[name] = as_levels(value)
        elif name == "weights" and of in _TRIANGLES:
            values[name] = square(value, values["levels"].size + _TRIANGLES[of])
        elif name == "creep" and of is AfterEffect:
            values[name] = [square(rows, values["plane"].bands) for rows in value]
        else:
            values[name] = frozen(value) if isinstance(value, list) else value
    return of(**values)


LONGEST_WARNING, MOST_WARNINGS = 1000, 20
"""Characters of a warning, and number of warnings in a file: more than identification gives."""
_Sentence: TypeAlias = Annotated[str, msgspec.Meta(max_length=LONGEST_WARNING, pattern="^[ -~]+$")]
"""A sentence of printable ASCII, which every terminal can show."""


class Named(_Strict):
    """A name with its unit."""

    name: str
    unit: str


class ErrorPart(_Strict):
    """Error of a model beyond its posterior: the parameters of `ModelError`.

    ``scores`` are quantiles at even probabilities from 0 to 1, ``reached`` has a text of 0 and 1
    for each row of the plane up to the diagonal.
    """

    parts: Annotated[int, msgspec.Meta(ge=1)]
    levels: list[float]
    reached: list[str]
    factors: Annotated[list[float], msgspec.Meta(min_length=3, max_length=3)]
    scores: Annotated[list[float], msgspec.Meta(min_length=2, max_length=1000)]
    inputs: Annotated[list[float], msgspec.Meta(min_length=1, max_length=1000)]
    variance: Annotated[list[float], msgspec.Meta(min_length=1, max_length=1000)]


class BandsPart(_Strict):
    """The source of the bands of a Preisach model: a posterior on a coarse plane, and errors.

    ``factor`` times its transpose is the covariance of the weights, and of offset and slope if
    these were fitted; rows up to the diagonal.
    """

    levels: list[float]
    offset: bool
    slope: bool
    factor: list[list[float]]
    unit: float
    samples: Annotated[int, msgspec.Meta(ge=1)]
    discrepancy: Annotated[float, msgspec.Meta(ge=0)]
    noise: Annotated[float, msgspec.Meta(ge=0)]
    shown: Annotated[float, msgspec.Meta(ge=0)]
    grouped: bool
    error: ErrorPart | None


class Header(msgspec.Struct):
    """The keys that identify a model file and its version."""

    format: str = ""
    version: int = 0


class Content(_Strict):
    """A whole file."""

    format: str
    version: int
    input: Named
    output: Named
    lag: Annotated[int, msgspec.Meta(ge=0)]
    model: AnyModel
    provenance: Provenance
    lag_s: Annotated[float, msgspec.Meta(ge=0)] = 0.0
    warnings: Annotated[list[_Sentence], msgspec.Meta(min_length=1, max_length=MOST_WARNINGS)] = []
    bands: BandsPart | None = None
    start_of_curve: Saturation | Literal["as-left"] | None = None


def kind_of(model: Any) -> str:
    """Return the name of the class of a model in a file.

    Raises a `ParameterError` if a file cannot contain it.
    """
    for known, word in KINDS.items():
        if isinstance(model, known):
            return word
    names = ", ".join(known.__name__ for known in KINDS)
    raise ParameterError(f"a model file cannot hold a {type(model).__name__}; give one of {names}")


def plain(model: Any) -> dict[str, Any]:
    """Return the parameters of a model as lists and numbers, squares up to their diagonal."""
    fields = {
        one.name: _plain(getattr(model, one.name))
        for one in dataclasses.fields(model)
        if (type(model), one.name) not in _LATER or getattr(model, one.name) is not None
    }
    if isinstance(model, Cascade):
        fields["operator"] = {"kind": kind_of(model.operator), **fields["operator"]}
    elif isinstance(model, Oscillator):
        fields["operator"] = {"kind": _FORCES[type(model.operator)], **fields["operator"]}
    return fields


def layout(value: object, depth: int = 0) -> str:
    """Return JSON with one line for each key of an object and each row of a table.

    Raises a `ValueError` if a text cannot be written as UTF-8.
    """
    inner, outer = "\n" + "  " * (depth + 1), "\n" + "  " * depth
    if isinstance(value, dict) and value:
        rows = [f"{_compact(key)}: {layout(item, depth + 1)}" for key, item in value.items()]
        return "{" + inner + f",{inner}".join(rows) + outer + "}"
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[" + inner + f",{inner}".join(map(_compact, value)) + outer + "]"
    return _compact(value)


def reason(error: Exception) -> str:
    """Return the reason of a failure to read or write as one line."""
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
    if value.ndim == 3:
        return [_plain(one) for one in value]
    if value.ndim == 2:
        return [row[: i + 1].tolist() for i, row in enumerate(value)]
    return value.tolist()


def _compact(value: object) -> str:
    return msgspec.json.format(msgspec.json.encode(value), indent=0).decode()


def square(rows: Sequence[Sequence[float]], size: int, name: str = "weights") -> FloatArray:
    """Return rows up to the diagonal as a square with zeros above it."""
    if len(rows) != size:
        raise ParameterError(f"{name} have {len(rows)} rows; the levels need {size}")
    for i, row in enumerate(rows):
        if len(row) != i + 1:
            raise ParameterError(f"row {i} of {name} has {len(row)} numbers; it needs {i + 1}")
    square: FloatArray = np.zeros((size, size))
    square[np.tril_indices(size)] = [number for row in rows for number in row]
    return square

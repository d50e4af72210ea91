"""Model files: a model with names, units, provenance and warnings, as one JSON object.

::

    {"format": "minorloop model", "version": 2,
     "input": {"name": "voltage", "unit": "V"},
     "output": {"name": "curvature", "unit": "1/m"},
     "lag": 0,
     "model": {"kind": "preisach", "levels": [...], "weights": [...], ...},
     "provenance": {"created": "2026-01-31T12:00:00Z", "minorloop": "0.1.0",
                    "data": "run.csv", "sha256": "9f86...", "scores": {"nrmse": 0.004}},
     "warnings": ["the output is clipped or saturated: ..."]}

``lag`` is the number of whole samples by which the output follows the model; a model of a record
with times may have ``lag_s`` as well, the same in seconds. In the provenance,
``data`` is the name of the file that the model was identified from and ``sha256`` the digest of
its bytes; both are null if there was none. Scores are numbers by name.

The other keys of ``model`` depend on its kind. They are the parameters of its class:

==================================  ==========================================================
``preisach``                        levels, weights, offset, relay, diagonal, slope of
                                    `Preisach`
``relay``                           levels, weights, offset, relay of `RelayModel`
``prandtl-ishlinskii``              radii, weights, offset of `PrandtlIshlinskii`
``generalised-prandtl-ishlinskii``  plays, zones, offset of `GeneralisedPrandtlIshlinskii`:
                                    plays has radii, weights, offset, and zones has
                                    thresholds, weights
``polynomial``                      coefficients, low, high of `Polynomial`
``cascade``                         operator (one of the above), linear, first, creep, noise of
                                    `Cascade`: linear has numerator, denominator, interval,
                                    delay; creep is null or has times, strengths, gain, offset;
                                    ahead, if present, has the keys of linear
``linear``                          numerator, denominator, interval, delay of `Linear`
``after-effect``                    plane (the keys of ``preisach`` without a kind), field,
                                    settling, times, creep of `AfterEffect`
``oscillator``                      mass, damping, stiffness, operator of `Oscillator`:
                                    ``prandtl-ishlinskii``, ``bouc-wen`` with alpha, gamma,
                                    delta, exponent, or ``duhem`` with levels, rising, falling
==================================  ==========================================================

Other packages add kinds by the entry points ``minorloop.models``: the name is the kind, and the
parameters of the class are the keys.

The weights of the first two, and those of the creep for each time, are rows up to the diagonal: row
i has i + 1 numbers. Decimal numbers
are read as exactly the same float64. ``warnings`` are sentences with reasons not to trust the
model. ``bands`` is the uncertainty of a Preisach model (`BandModel`): the posterior on a plane of
at most 12 bands, and the error beyond it. ``start_of_curve`` is the memory before each curve of its
record: ``negative``, ``positive``, ``demagnetised`` or ``as-left``. A reader refuses unknown keys,
so a file has the highest version that its keys need: 2 for ``warnings``, 3 for ``bands``, 4 for
``start_of_curve``, and else 1.
"""

from __future__ import annotations

import os
import stat
import warnings as _warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar, overload, runtime_checkable

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec.structs import asdict

from minorloop._modelschema import (
    LONGEST_WARNING,
    MOST_WARNINGS,
    Content,
    Header,
    LinearPart,
    Model,
    Provenance,
    StaticModel,
    build,
    kind_of,
    layout,
    plain,
    reason,
)
from minorloop.arrays import FloatArray, as_finite
from minorloop.dynamics.cascade import Cascade, First
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.oscillator import Oscillator
from minorloop.errors import ModelFileError, NotInvertibleError, ParameterError, counted
from minorloop.files import PathLike, check_name, check_writable, kind_of_file, write_atomically
from minorloop.lab.conversion import read_column
from minorloop.lab.logs import check_order, read_times
from minorloop.lab.records import Quantity
from minorloop.lab.timebase import TimeCheck
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.memory import Memory, Saturation
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel
from minorloop.version import __version__

if TYPE_CHECKING:
    from minorloop.dynamics.cascade import CascadeInversion
    from minorloop.operators.inversion import Inversion, Unreachable
    from minorloop.operators.memory import Start

__all__ = ["FORMAT", "LARGEST", "VERSION", "Model", "ModelFile", "ModelWarning", "Provenance"]
__all__ += ["load", "plain", "read", "save"]

FORMAT = "minorloop model"
_SINCE = {"warnings": 2, "bands": 3, "start_of_curve": 4}
"""Keys that not all files have, and the version that added them."""
VERSION = max(_SINCE.values())
"""Newest version that this package writes and reads."""
LARGEST = 64 * 2**20
"""Bytes of the largest model file: a plane of about 2,000 bands."""
_GIVE = "give one that identify --save has written"
_MOST = {b",": 2_200_000, b"[": 5_000, b"{": 1_000, b":": 100_000}
"""Largest number of each mark: more than such a plane needs. Without these bounds, refusing a file
full of marks takes minutes."""


class ModelWarning(UserWarning):
    """The model of a file is not to be trusted."""


@dataclass(frozen=True, eq=False)
class TargetInversion:
    """Inputs for the targets in a file."""

    targets: FloatArray
    """Shape (n,). Target outputs, in the unit of the model."""
    result: Any
    """`Inversion` or `CascadeInversion`."""
    columns: Mapping[str, Any]
    """Columns of a table by header: times, inputs, targets, predicted outputs; or a plan."""
    notes: list[str]
    """Findings about the times, one sentence each."""
    settles: bool = False
    """Whether a model with time was inverted at rest."""

    def to_dict(self) -> dict[str, Any]:
        """Return the number of targets, the worst residual and the number out of reach."""
        worst = float(abs(self.result.residual).max())
        missed = int((~self.result.reachable).sum())
        return {"targets": self.targets.size, "worst_residual": worst, "unreachable": missed}


@dataclass(frozen=True, eq=False)
class ModelFile:
    """The content of a model file."""

    model: Model
    """The model."""
    input: Quantity
    output: Quantity
    """``input`` and ``output``: names and units of its input and output."""
    lag: int
    """Samples by which the output follows the model."""
    provenance: Provenance
    """Origin of the model."""
    warnings: tuple[str, ...] = ()
    """Reasons not to trust the model; empty if there are none."""
    lag_seconds: float = 0.0
    """The lag in seconds; 0 if it is known only in samples."""
    bands: Any = None
    """Uncertainty for bands: a `BandsPart`, as in a file, or a `BandModel`; None without bands."""
    start_of_curve: Saturation | Literal["as-left"] | None = None
    """Memory before each curve of its record; None without curves."""

    def left_out(self, what: str) -> list[str]:
        """Return the parts of the model that an export does not contain, one sentence each.

        ``what``, the name of the export, is ``C`` or ``unit``.
        """
        said = []
        if self.lag:
            said.append(
                f"the output follows the model by {self.lag} samples; this lag is not in the {what}"
            )
        if isinstance(self.model, AfterEffect) and what != "C":
            said.append(f"the output changes with time; this change is not in the {what}")
        if isinstance(self.model, Cascade) and self.model.creep is not None:
            said.append(f"the output creeps after the model; this creep is not in the {what}")
        return said

    def with_linear(self, path: PathLike, first: First = "operator") -> ModelFile:
        """Return the model in a cascade with the linear part of a file, as of `_read_linear`.

        ``first`` is the part that comes first. Raises a `ParameterError` if the model already has
        dynamics.
        """
        if isinstance(self.model, Cascade):
            raise ParameterError("the model has dynamics of its own; omit the linear part")
        operator: Any = self.operator
        return replace(self, model=Cascade(operator, _read_linear(path), first))

    def check_units(self, names: Sequence[str], of: str, hints: Sequence[str] = ("", "")) -> None:
        """Raise a `ParameterError` if an input or output has another unit than that of the model.

        ``names``: input and output with units; ``of``: name of their owner, and ``hints``: further
        remedies, for the messages.
        """
        mine = ("input", self.input), ("output", self.output)
        for (what, one), name, hint in zip(mine, names, hints, strict=True):
            unit = Quantity.parse(name).unit
            if one.unit and unit and one.unit != unit:
                raise ParameterError(
                    f"the {what} of the model is '{one}' and that of {of} '{name}'; identify a "
                    f"model in {unit}{hint}"
                )

    @property
    def has_time(self) -> bool:
        """Whether the output depends on the times of the inputs by more than a lag."""
        return isinstance(self.model, Cascade | AfterEffect | Oscillator)

    @property
    def nrmse(self) -> float:
        """Error of the model on held-out data, else on fitted data; 0 if not known."""
        names = ("nrmse_holdout", "nrmse_train", "left_out_nrmse")
        found = [self.provenance.scores.get(name) for name in names]
        return next((score for score in found if score is not None), 0.0)

    @property
    def operator(self) -> StaticModel:
        """The model, or the operator of a model in time: its output for slow inputs.

        Raises a `ModelFileError` if the model has no operator on the input of the file.
        """
        if isinstance(self.model, Cascade):
            return self.model.operator  # type: ignore[return-value]
        if isinstance(self.model, AfterEffect):
            return self.model.settled
        if isinstance(self.model, Oscillator):
            raise ModelFileError(
                "the file has an oscillator, whose output depends on all forces before; it can be "
                "simulated in time, but not inverted: give a file with another model"
            )
        if not isinstance(self.model, StaticModel):
            raise ModelFileError(
                f"the file has a model of kind {self.kind!r}, which minorloop.load reads; give a "
                "file that identify --save has written"
            )
        return self.model

    @property
    def kind(self) -> str:
        """The name of the class of the model in the file."""
        return kind_of(self.model)

    def invert(
        self,
        targets: npt.ArrayLike,
        start: Start = "negative",
        unreachable: Unreachable = "raise",
        *,
        t: npt.ArrayLike | None = None,
    ) -> Inversion | CascadeInversion:
        """Return the inputs that bring the output to each target in turn.

        Raises a `NotInvertibleError` if the model has no inverse; an `UnreachableError` if a target
        is out of reach and ``unreachable`` is not ``"clip"``.

        Parameters
        ----------
        targets : (T,) array_like
            Target outputs, in order.
        start : {"negative", "positive", "demagnetised"} or Memory
            Memory before the first target; a model with dynamics rests at the lowest or the highest
            level, or at 0.
        unreachable : {"raise", "clip"}
            Treatment of targets out of reach: an error, or the nearest output.
        t : (T,) array_like, optional
            Times in seconds, at which a model in time, or with a lag in seconds, follows the
            targets. Without them, the output settles at each target.
        """
        if isinstance(self.operator, RelayModel):
            raise NotInvertibleError(
                "the file has a relay-by-relay model, which has no exact inverse; identify a "
                "Preisach model on the same levels"
            )
        in_time: Any = self.model
        if t is not None and not isinstance(in_time, Cascade) and self.lag_seconds:
            in_time = Cascade(self.operator, Linear.lags(delay=self.lag_seconds))  # a dead time
        if t is not None and isinstance(in_time, Cascade):
            low, high = self._ends or (0.0, 0.0)
            rest = {"negative": low, "positive": high}.get(str(start), 0.0)
            how: Any = {"before": rest, "between": "held", "unreachable": unreachable}
            return in_time.invert(t, targets, start, **how)
        if t is not None and isinstance(in_time, AfterEffect):
            return in_time.invert(t, targets, start, unreachable)
        return self.operator.invert(targets, start, unreachable)  # type: ignore[arg-type]

    def invert_file(
        self,
        path: PathLike,
        target: str,
        *,
        start: Start = "negative",
        unreachable: Unreachable = "raise",
        hold: float | None = None,
        time: str | None = None,
        progress: Callable[[str], None] = lambda stage: None,
    ) -> TargetInversion:
        """Return the inputs that bring the output to each target in a table.

        Raises a `ParameterError` if both a hold and times are given; a `RecordError` if a column
        cannot be used, or times run backwards; an `UnreachableError` if a target is out of reach.

        Parameters
        ----------
        path : str or path
            The table.
        target : str
            Column of the target outputs, in order.
        start, unreachable
            As of `invert`.
        hold : float, optional
            Seconds to hold each input: the columns are then a plan, saturation first, and a model
            with after-effect reaches each target at the end of its hold.
        time : str, optional
            Column of the times at which a model with dynamics follows the targets. Without it, the
            output settles at each target.
        progress : callable
            Called with the next step, as text.
        """
        if hold is not None and time is not None:
            raise ParameterError(
                "--hold and --time cannot be combined: a plan has holds, a trajectory has times; "
                "leave one of them out"
            )
        targets = read_column(path, target, self.output.unit)
        progress(f"inverting {targets.size} targets")
        times, notes = {}, []
        if hold is not None:
            return self._plan(targets, hold, start, unreachable)
        if time is not None:
            quantity, check = read_times(path, time)
            check_order(path, time, check, strictly=self.has_time)
            times, notes = {str(quantity): check.t}, _about_times(check)
        found: Any = self.invert(targets, start, unreachable, t=next(iter(times.values()), None))
        settles = self.operator is not self.model and not times
        columns = {**times, **self.inverse_columns(targets, found)}
        return TargetInversion(targets, found, columns, [*notes, *_ahead(found)], settles)

    @property
    def _ends(self) -> tuple[float, float] | None:
        """The inputs of negative and positive saturation; None for a model without levels."""
        levels = getattr(self.operator, "levels", None)
        return None if levels is None else (float(levels[0]), float(levels[-1]))

    def _plan(
        self, targets: FloatArray, hold: float, start: Start, unreachable: Unreachable
    ) -> TargetInversion:
        """Return the inverse for targets (T,) that are held, with the columns of a plan for `run`.

        The first row saturates the actuator, until the slowest after-effect has settled to 1 %.
        """
        if self._ends is None or start not in ("negative", "positive"):
            raise ParameterError(
                "a plan of holds (--hold) begins in saturation, which needs a model with levels "
                "and a start that is negative or positive; use minorloop drive, or give no hold"
            )
        creeps = self.model if isinstance(self.model, AfterEffect) else None
        ends = hold * np.arange(1.0, targets.size + 1)
        found: Any = self.invert(targets, start, unreachable, t=ends if creeps else None)
        slowest = max([creeps.settling, *creeps.times], default=0.0) if creeps else 0.0
        plan = {name: ["", *cells] for name, cells in self.inverse_columns(targets, found).items()}
        plan[str(self.input)][0] = self._ends[start == "positive"]
        # Number of time constants after which less than 1 % is left
        first = max(2 * hold, 5.0 * slowest)
        plan |= {"hold [s]": [first, *[hold] * targets.size]}
        return TargetInversion(targets, found, plan, _ahead(found))

    def inverse_columns(
        self, targets: npt.ArrayLike, found: Inversion | CascadeInversion
    ) -> dict[str, list[Any]]:
        """Return the columns of a CSV file of an inverse for targets (T,), by headers with units.

        A model that is not to be trusted adds the column ``warning``, its text in the first row.
        """
        columns = {
            str(self.input): found.u.tolist(),
            f"target {self.output}": np.asarray(targets, dtype=np.float64).tolist(),
            f"predicted {self.output}": found.y.tolist(),
            "reachable": found.reachable.astype(int).tolist(),
        }
        if self.warnings:
            columns["warning"] = ["; ".join(self.warnings), *[""] * (found.u.size - 1)]
        return columns


@runtime_checkable
class Identified(Protocol):
    """An identified model with its lag, scores and warnings."""

    @property
    def model(self) -> Model:
        """The model."""

    @property
    def lag(self) -> int:
        """Samples by which the output follows the model."""

    @property
    def lag_seconds(self) -> float:
        """Lag in seconds; 0 if not known."""

    @property
    def scores(self) -> Mapping[str, float | None]:
        """Scores by name."""

    @property
    def warnings(self) -> Sequence[str]:
        """Reasons not to trust the model."""


def save(
    model: Model | Identified | ModelFile,
    path: PathLike,
    *,
    input: str | Quantity = "input",
    output: str | Quantity = "output",
    lag: int | None = None,
    provenance: Provenance | Mapping[str, Any] | None = None,
    warnings: Sequence[str] | None = None,
    force: bool = False,
) -> None:
    """Write a model to a file, completely or not at all.

    Raises an `OutputError` if the file cannot be written, or exists and ``force`` is false; a
    `ParameterError` if a file cannot contain the model, the provenance or the warnings.

    Parameters
    ----------
    model : Preisach, RelayModel, PrandtlIshlinskii, GeneralisedPrandtlIshlinskii, Polynomial,
            Cascade, Linear, AfterEffect, Oscillator, the result of an identification, or ModelFile
        The model. A model of an identification is written with its lag, scores and warnings; the
        content of a file is written unchanged.
    path : str or path
        The file to write.
    input, output : str or Quantity
        Names and units of its input and output, such as ``voltage [V]``.
    lag : int, optional
        Samples by which the output follows the model; by default that of the identification, or 0.
    provenance : Provenance or mapping, optional
        Origin of the model; a mapping has the keys of `Provenance`.
    warnings : sequence of str, optional
        Reasons not to trust the model; by default those of the identification, if any. At most 20
        are kept.
    force : bool
        Whether an existing file may be replaced.

    Examples
    --------
    >>> model = ml.PrandtlIshlinskii([0.0, 0.2], [1.0, 0.5])
    >>> ml.save(model, "model.json", input="voltage [V]", output="length [um]")
    >>> ml.load("model.json") == model
    True
    """
    target, known = check_writable(path, force=force), as_file(model)
    if isinstance(model, ModelFile):
        input, output, provenance = known.input, known.output, known.provenance
        lag, warnings = known.lag, known.warnings
    said = known.warnings if warnings is None else warnings
    bands: Any = known.bands
    content = {
        "format": FORMAT,
        "version": 1,
        "input": _named(input),
        "output": _named(output),
        "lag": known.lag if lag is None else lag,
        "model": {"kind": known.kind, **plain(known.model)},
        "provenance": _complete(provenance, known.provenance.scores),
    }
    if known.lag_seconds:
        content["lag_s"] = float(known.lag_seconds)
    if said:
        content["warnings"] = [text[:LONGEST_WARNING] for text in said][:MOST_WARNINGS]
    if bands is not None:
        content["bands"] = (
            bands.in_file() if hasattr(bands, "in_file") else msgspec.to_builtins(bands)
        )
    if known.start_of_curve is not None:
        content["start_of_curve"] = known.start_of_curve
    content["version"] = _version(content)
    try:
        _check_words(msgspec.convert(content, Content).provenance)
        data = f"{layout(content)}\n".encode()
    except ValueError as error:
        raise ParameterError(f"this cannot go into a model file: {reason(error)}") from None
    if len(data) > LARGEST:
        raise ParameterError(
            f"the model takes {len(data)} bytes, a model file at most {LARGEST}; use fewer levels"
        )
    if flood := _flood(data):
        raise ParameterError(f"this cannot go into a model file: {flood}; use fewer levels")
    write_atomically(target, data)


def as_file(model: PathLike | Model | Identified | ModelFile) -> ModelFile:
    """Return a model, the result of an identification, or the file at a path, as a `ModelFile`.

    Raises a `ParameterError` for any other type.
    """
    if isinstance(model, str | os.PathLike):
        return read(model)
    if isinstance(model, ModelFile):
        return model
    names = Quantity("input"), Quantity("output")
    if isinstance(model, Model) or not isinstance(model, Identified):
        kind_of(model)
        return ModelFile(model, *names, 0, Provenance())
    lag = getattr(model, "lag_of_model", model.lag)
    scores, said = Provenance(scores=dict(model.scores)), tuple(model.warnings)
    bands, record = getattr(model, "band_model", None), getattr(model, "record", None)
    known = ModelFile(model.model, *names, lag, scores, said, model.lag_seconds, bands)
    if record is None or record.curves is None:
        return known
    start: Any = record.start_of_curve or record.start
    return replace(known, start_of_curve=None if isinstance(start, Memory) else start)


_M = TypeVar("_M", bound=Model)


@overload
def load(path: PathLike) -> Model: ...
@overload
def load(path: PathLike, kind: type[_M]) -> _M: ...
def load(path: PathLike, kind: type[Any] | None = None) -> Any:
    """Read a model from a file of `save`, without its lag and bands.

    Inputs act at once then; `minorloop.scoring.simulate` of the file includes the lag, and
    `minorloop.modelfile.read` returns the lag and the bands too.

    Raises a `ModelFileError` if there is no such file, or it is damaged, inconsistent, too large,
    not a model file, of a newer version, or has a model of another class.

    Parameters
    ----------
    path : str or path
        The file.
    kind : type, optional
        Class of the model, such as `Preisach`; any class if not given. Type checkers need it.

    Returns
    -------
    Preisach, RelayModel, PrandtlIshlinskii, GeneralisedPrandtlIshlinskii, Polynomial, Cascade,
    Linear, AfterEffect or Oscillator
        Equal to the saved model, to the last bit.

    Warns
    -----
    ModelWarning
        If the file has warnings, or a lag.

    Examples
    --------
    >>> ml.save(ml.PrandtlIshlinskii([0.0, 0.2], [1.0, 0.5]), "model.json")
    >>> ml.load("model.json", ml.PrandtlIshlinskii).radii.tolist()
    [0.0, 0.2]
    """
    known = read(path)
    if kind is not None and not isinstance(known.model, kind):
        name = type(known.model).__name__
        raise ModelFileError(f"{path} has a {name}, not a {kind.__name__}; load it as a {name}")
    said = list(known.warnings)
    if known.lag:
        said.append(
            f"the output has a lag of {counted(known.lag, 'sample')}, which the loaded model "
            "leaves out; minorloop.scoring.simulate(path, record) includes it"
        )
    if said:
        _warnings.warn(f"{path}: {'; '.join(said)}", ModelWarning, stacklevel=2)
    return known.model


def read(path: PathLike) -> ModelFile:
    """Read the whole content of a model file, with the path and the errors of `load`."""
    data = _bytes_of(path)
    _check_header(path, data)
    try:
        content = msgspec.json.decode(data, type=Content)
        needed = _version(asdict(content))
        if content.version != needed:
            raise ParameterError(f"its keys need version {needed}, and it has {content.version}")
        model = build(content.model)
        if content.bands is not None and not isinstance(model, Preisach):
            raise ParameterError("a model of another kind than preisach has no bands")
        _check_words(content.provenance)
        input, output = (Quantity(**asdict(one)) for one in (content.input, content.output))
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"{path} is not a valid model file: {reason(error)}") from None
    return ModelFile(
        model, input, output, content.lag, content.provenance, tuple(content.warnings),
        float(content.lag_s), content.bands, content.start_of_curve,
    )  # fmt: skip


def _read_linear(path: PathLike) -> Linear:
    """Read a linear part: an object with numerator, denominator, and interval and delay in seconds.

    Raises a `ModelFileError` if there is no such file or it has other content; a `ParameterError`
    as `Linear`.
    """
    data = _bytes_of(path)
    try:
        return build(msgspec.json.decode(data, type=LinearPart))  # type: ignore[no-any-return]
    except (msgspec.DecodeError, RecursionError) as error:
        raise ModelFileError(f"{path} is not a linear part: {reason(error)}") from None


def _version(content: Mapping[str, Any]) -> int:
    """Return the version of a file, by the keys that it has."""
    return max([1, *(since for key, since in _SINCE.items() if content.get(key))])


def _bytes_of(path: PathLike) -> bytes:
    try:
        status = Path(path).stat()
        if not stat.S_ISREG(status.st_mode):
            raise ModelFileError(f"{path} is not a file; give the name of a model file")
        if status.st_size > LARGEST:
            raise ModelFileError(
                f"{path} has {status.st_size} bytes, a model file at most {LARGEST}"
            )
        return Path(path).read_bytes()
    except FileNotFoundError:
        raise ModelFileError(f"there is no file {path}; check the name") from None
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read: {reason(error)}") from None
    except ModelFileError:
        raise
    except ValueError as error:
        raise ModelFileError(f"{path!r} cannot be the name of a file: {error}") from None


def _check_words(provenance: Provenance) -> None:
    """Refuse texts that cannot be printed."""
    words = {"data": provenance.data, "minorloop": provenance.minorloop}
    for what, text in words.items():
        check_name(f"the {what} of the provenance", text or "")
    for name in provenance.scores:
        check_name("the score", name)


def _flood(data: bytes) -> str:
    """Return a sentence about a mark that appears too often; empty if there is none."""
    for mark, most in _MOST.items():
        if (count := data.count(mark)) > most:
            return f"it has {count} of the mark {mark.decode()}, a model file at most {most}"
    return ""


def _check_header(path: PathLike, data: bytes) -> None:
    """Refuse files that are not model files, or that a newer version wrote."""
    kind = kind_of_file(path, data)
    what = f"{kind}, " if kind not in ("", "a JSON file", "a model file") else ""
    if what or (data.strip() and not data.lstrip().startswith(b"{")):
        raise ModelFileError(f"{path} is {what}not a model file; {_GIVE}")
    if flood := _flood(data):
        raise ModelFileError(f"{path} is not a model file, is damaged, or is not JSON: {flood}")
    try:
        header = msgspec.json.decode(data, type=Header)
    except msgspec.ValidationError:
        header = Header()
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"{path} is damaged, or is not JSON: {reason(error)}") from None
    if header.format != FORMAT or header.version < 1:
        raise ModelFileError(
            f"{path} is not a model file: it has no format {FORMAT!r} with a version; {_GIVE}"
        )
    if header.version > VERSION:
        raise ModelFileError(
            f"{path} has format version {header.version}, and this minorloop reads up to "
            f"{VERSION}; install a newer one"
        )


def _named(quantity: str | Quantity) -> dict[str, str]:
    if not isinstance(quantity, str | Quantity):
        raise ParameterError(f"the name is {quantity!r}; give a name such as 'voltage [V]'")
    known = quantity if isinstance(quantity, Quantity) else Quantity.parse(quantity)
    return {"name": known.name, "unit": known.unit}


def _complete(
    provenance: Provenance | Mapping[str, Any] | None, scores: Mapping[str, float | None]
) -> dict[str, Any]:
    """Return the provenance to write, with scores, date and version filled in."""
    try:
        if isinstance(provenance, Provenance):
            provenance = msgspec.structs.asdict(provenance)
        fields = {"scores": {}, **(provenance or {})}
        fields["scores"] = {**scores, **fields["scores"]}
        for name, score in fields["scores"].items():
            as_finite(f"score {name}", 0.0 if score is None else score)
        known = msgspec.convert(fields, Provenance)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"provenance cannot be used: {reason(error)}") from None
    created = (known.created or datetime.now(UTC).replace(microsecond=0)).astimezone(UTC)
    minorloop = known.minorloop or __version__
    complete: dict[str, Any] = msgspec.to_builtins(
        msgspec.structs.replace(known, created=created, minorloop=minorloop)
    )
    return complete


def _about_times(check: TimeCheck) -> list[str]:
    """Report the input in gaps between targets, and other findings about the times."""
    said = [*check.of_steps, *check.others]
    if not check.gaps.size:
        return said
    longest = max(check.t[check.gaps + 1] - check.t[check.gaps])
    return [
        f"{counted(check.gaps.size, 'gap')} in the times of the targets, the longest {longest:.4g} "
        "s: the input of the previous row is held there, and no target is followed",
        *said,
    ]


def _ahead(result: Any) -> list[str]:
    """Report the lead of the inputs of a trajectory, and their assumption about its end."""
    lead: float = getattr(result, "lead", 0.0)
    if lead <= 0:
        return []
    moves = result.targets[-1] != result.targets[-2]
    return [
        f"the inputs are {lead:.3g} s ahead of the targets, as the output is late; after "
        "the last target it is held"
        + (", although the targets still move there: add rows to follow them on" if moves else "")
    ]

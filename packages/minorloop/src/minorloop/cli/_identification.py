"""Records, laws and priors from options, and the output of a fit or a score."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError
from minorloop.values import TextValue, called, ends, merged, parsed, plain

if TYPE_CHECKING:
    from minorloop.identification.pipeline import Law
    from minorloop.identification.prior import Prior as PriorValue
    from minorloop.identification.result import Scored
    from minorloop.lab.records import Record

_LAWS, _PRIORS = ("plane", "dynamics", "viscosity", "vibration"), ("auto", "gaussian", "smooth")
_TIMED = ("viscosity", "vibration")
"""Laws that need a record with increasing times."""

RecordOptions = Annotated[
    list[str] | None,
    typer.Option(
        "--record",
        metavar="KEY=VALUE,...",
        help="Columns curves (label of the curve: the memory is reset before each), groups (label "
        "of what is left out together, such as the specimen; the curves if not given) and sd "
        "(standard deviation of each output, or a number; found if not given, none leaves it "
        "out); start (memory before the first row: negative, positive or demagnetised) and "
        "start_of_curve (before each curve; also as-left); skip (first rows of the record and of "
        "each curve that are not fitted), rows=A:B (rows that are used, counted from 0 after the "
        "header, B not included) and, of an oscillator, between (force between rows: band, "
        "straight or held).",
    ),
]
LawOption = Annotated[
    list[str] | None,
    typer.Option(
        "--law",
        metavar="[KIND:]KEY=VALUE,...",
        help="plane: levels (bands, 250 at most), spacing (uniform or adaptive), relay (such as "
        "unipolar), diagonal (uniform, reversible), slope (a linear part), lag (rows, or seconds "
        "as '3 ms'), signed (negative weights, for butterfly loops), offset; yes, no and auto "
        "where they fit. dynamics: dead time, poles and creep too: first (operator, linear), "
        "poles, creep, and what plane has. viscosity: creep (auto, none, thermal, spectrum), rate, "
        "levels, diagonal, spacing. vibration (force to displacement): rough (model file with a "
        "rough oscillator), period (rows), between (band, straight, held).",
    ),
]
PriorOption = Annotated[
    str,
    typer.Option(
        "--prior",
        help="gaussian[:mean=ridge], smooth[:strength=X] (0 for none), or auto (gaussian where it "
        "is quick, or where samples are few or leave much of the plane open).",
    ),
]


@dataclass(frozen=True)
class RecordReader:
    """Reads records; its fields describe what a record has besides input, output and time."""

    curves: str | None = None
    groups: str | None = None
    sd: str | None = None
    start: str = "negative"
    start_of_curve: str | None = None
    skip: int = 0
    rows: str | None = None
    between: str | None = None

    @classmethod
    def of(cls, texts: Sequence[str] | None, **others: Any) -> RecordReader:
        """Return the reader that an option describes; ``others`` are keys it may not have."""
        return called(cls, "--record", merged(texts or (), "").options, **others)

    @staticmethod
    def check(file: Path, input: str | None, output: str | None) -> None:
        """Refuse a table that cannot be read, before modules that load slowly are imported."""
        from minorloop.lab._store_file import is_store
        from minorloop.lab.columns import read_headers

        if input and output and not is_store(file):
            read_headers(file)

    def read(
        self,
        file: Path,
        input: str | None,
        output: str | None,
        time: str | None,
        now: Callable[[str], None],
    ) -> Record:
        """Return the record of a table or an experiment store; columns not given are found."""
        self.check(file, input, output)
        from minorloop.identification import read

        sd = None if self.sd is None else plain(self.sd)
        noise = sd if isinstance(sd, int | float) else None
        record = read(
            file,
            input=input,
            output=output,
            time=_common.named(time),
            curves=self.curves,
            groups=self.groups,
            sd=_common.named(self.sd) if noise is None else None,
            progress=_common.reading(file, now),
        )
        if self.rows is not None:
            form = "two whole numbers A:B, such as 200:7000"
            record = record.only(*ends(self.rows, "rows", _row, form))
        if noise is not None:
            record = record.replace(sd=noise)
        return record.replace(**self.settings)

    @property
    def settings(self) -> dict[str, Any]:
        """Arguments for `Record.replace`."""
        return {name: getattr(self, name) for name in ("start", "start_of_curve", "skip")}


def _row(text: str) -> int | None:
    """Return the number of a row; None for an empty end of a range."""
    return int(text) if text.strip() else None


def law_value(texts: Sequence[str] | None) -> TextValue:
    """Return the parts of the option of a law, which may be repeated; those of a plane if None."""
    return merged(texts or (), "plane")


def law_of(value: TextValue) -> Law[Any]:
    """Return the law that an option describes.

    Raises a `ParameterError` if there is no such law.
    """
    from minorloop.identification import Dynamics, Plane, Viscosity
    from minorloop.identification.oscillator import Vibration

    kind, options, where = value.kind, dict(value.options), f"the law {value.kind}"
    _common.check_word("law", kind, _LAWS)
    if value.what:
        raise ParameterError(f"--law has {value.what!r}; give KEY=VALUE after {kind}:")
    if kind == "plane":
        return called(Plane, where, options)
    if kind == "viscosity":
        return called(Viscosity, where, options)
    if kind == "vibration":
        rough = options.pop("rough", "unknown")
        return called(Vibration, where, options, rough=_rough_oscillator(rough))
    names: tuple[str, ...] = ("first", "poles", "creep")
    own = {name: options.pop(name) for name in names if name in options}
    return called(Dynamics, where, own, plane=called(Plane, where, options))


def prior_of(text: str) -> PriorValue:
    """Return the prior that an option describes.

    Raises a `ParameterError` if there is no such prior.
    """
    from minorloop.identification import Gaussian, Smooth

    value = parsed(text)
    _common.check_word("prior", value.kind, _PRIORS)
    kinds: dict[str, Any] = {"gaussian": Gaussian, "smooth": Smooth}
    if value.kind == "auto":
        return "auto"
    return called(kinds[value.kind], f"the prior {value.kind}", value.options)


def plane_options(value: TextValue, prior: str) -> dict[str, Any]:
    """Return the options of a fleet for a plane and its prior.

    Raises a `ParameterError` if the law is not a plane.
    """
    assumed = parsed(prior)
    _common.check_word("law of a fleet", value.kind, ("plane",))
    _common.check_word("prior", assumed.kind, _PRIORS)
    options = {name: plain(text) for name, text in value.options.items()}
    options["prior"] = "none" if assumed.kind == "smooth" else assumed.kind
    names = {"strength": "smoothness"}
    return options | {names.get(key, key): plain(text) for key, text in assumed.options.items()}


def check_times(kind: str, file: Path, record: Record) -> None:
    """Refuse a record without increasing times if laws of that kind need them.

    Raises a `ParameterError` or a `RecordError`.
    """
    from minorloop.lab.logs import check_order

    origin = record.origin
    if kind not in _TIMED:
        return
    if record.check is None:
        raise ParameterError(
            f"--time is missing; --law {kind} needs the columns of input, output and time"
        )
    column = str(origin.time_column)
    check_order(file, column, record.check, part=record.part, rows=origin.rows)


def _rough_oscillator(start: str) -> Any:
    """Return the oscillator in a model file, or ``"unknown"`` as given.

    Raises a `ParameterError` if the file holds another kind of model.
    """
    from minorloop import modelfile
    from minorloop.dynamics.oscillator import Oscillator

    if start == "unknown":
        return start
    if not Path(start).exists():
        raise ParameterError(
            f"rough is {start!r}; give unknown, or a model file with a rough oscillator, which "
            "minorloop.save writes"
        )
    known = modelfile.read(start)
    if not isinstance(known.model, Oscillator):
        raise ParameterError(
            f"{start} has a model of kind {known.kind!r}; give one with a rough oscillator, which "
            "minorloop.save writes, or unknown"
        )
    return known.model


def show_scored(
    found: Scored,
    title: str,
    as_json: bool,
    verbose: bool,
    *files: _common.Written,
    figures: Mapping[str, Any] | None = None,
) -> None:
    """Write files, print what was found, and exit with 1 if it is not to be trusted.

    ``found``: the fit or the score; ``title``: of the table; ``as_json`` and ``verbose``: whether
    to print JSON, or all scores and advice; ``*files``: files to write; ``figures``: added to the
    scores in JSON, of which the table shows ``seconds`` only.
    """
    beside = figures or {}

    def content() -> dict[str, Any]:
        with _common.working("scoring"):
            return {**found.figures, **beside}

    show = partial(_print, found, title, verbose, beside)
    _common.finish(as_json, content, show, *files)
    count = len(found.warnings)
    if count and not as_json:
        which = "the first of these says" if count == 1 else f"the first {count} of these say"
        typer.echo(f"warning: this model is not to be trusted: {which} why", err=True)
    if count:
        # Exit status after warnings: the result is written, but the model is not to be trusted
        raise typer.Exit(1)


def _print(found: Scored, title: str, verbose: bool, beside: Mapping[str, Any]) -> None:
    from minorloop.identification.accuracy import curve_table
    from minorloop.identification.result import FIRST

    with _common.working("scoring"):
        rows = found.summary(slow=verbose)
    if "seconds" in beside:
        rows.append(("time", f"{beside['seconds']:.2f} s"))
    _common.print_table(("", ""), rows if verbose else rows[:FIRST], title)
    if not verbose:
        if found.warnings:  # with the first remarks, which may name the cause
            _common.print_advice(found.advice[: max(FIRST, len(found.warnings))])
        else:
            _common.print_sentence(f"verdict: {found.verdict}")
        typer.echo("-v shows all scores and advice")
        return
    if found.curve_accuracy:
        _common.print_table(*curve_table(found.curve_accuracy))
    for line in found.details:
        typer.echo(line)
    _common.print_advice(found.advice)

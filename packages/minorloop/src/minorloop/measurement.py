"""Measure an actuator, or bring it to targets, and keep every point in a store.

`resume` continues a run of `measure` or `drive_to` that stopped for any reason. It needs only the
store.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy.typing as npt

from minorloop.connect import opened, split_address
from minorloop.delivery import Delivery
from minorloop.drive import DriveResult, TargetDrive, saturation_of
from minorloop.errors import ParameterError, StoreError
from minorloop.files import PathLike, check_writable
from minorloop.identification.adaptive import Adaptive, RunFindings, design_holds
from minorloop.identification.fit import Say, silent
from minorloop.identification.reading import chooser_of
from minorloop.identification.sine_response import at_every_amplitude
from minorloop.lab import conversion as conversions
from minorloop.lab.actuator import Actuator, check_input
from minorloop.lab.columns import read_headers
from minorloop.lab.conversion import Conversion
from minorloop.lab.plan import Plan
from minorloop.lab.records import Quantity
from minorloop.lab.run import Choose, ResumeMode, answer_time, check_plan, run
from minorloop.lab.store import Point, Setup, Store, summary
from minorloop.lab.wrapped_actuator import SingleChannel, single_channel
from minorloop.modelfile import ModelFile

_HOLD = 200.0
"""Default seconds to hold each input: a polymer strip settles in this time."""


class Carry(Protocol):
    """Carries out the rest of a run, as `minorloop.run`, and shows its progress."""

    def __call__(
        self, actuator: Actuator, store: Store, choose: Choose | None
    ) -> tuple[ResumeMode, Sequence[str]]:
        """Return how the run began, and warnings about points."""


def carry(
    actuator: Actuator, store: Store, choose: Choose | None
) -> tuple[ResumeMode, Sequence[str]]:
    """Carry out the rest of a run without output."""
    wrong: list[str] = []
    mode = run(
        actuator,
        store.plan,
        store,
        choose=choose,
        watch=lambda progress: wrong.append(progress.warning) if progress.warning else None,
    )
    return mode, wrong


@dataclass(frozen=True)
class Apparatus:
    """An actuator at an address, the channels to use, and the conversion of its readings.

    Examples
    --------
    >>> ml.Apparatus("twin:ipmc,specimen=3").address
    'twin:ipmc,specimen=3'
    """

    address: str
    """Address as of `minorloop.connect`, such as ``twin:ipmc,specimen=3``."""
    input: str | None = None
    """Input of an actuator with several inputs; by default that of the plan or the model."""
    output: str | None = None
    """Output of an actuator with several outputs; by default that of the input."""
    conversion: Conversion | str | None = None
    """Conversion of readings to the output, or a text of `minorloop.lab.conversion.from_text`."""

    @contextmanager
    def opened(
        self, choose: Callable[[Actuator], str | None], say: Say
    ) -> Iterator[tuple[Actuator, Setup]]:
        """Yield the channel and its setup for a store; close the instruments at the end.

        Parameters
        ----------
        choose : callable
            Returns the name of the input if none is given.
        say : callable
            Called with each warning of the actuator.
        """
        address, options = split_address(self.address)
        with opened(address, say=say, **options) as whole:
            channel = single_channel(whole, self.input or choose(whole), self.output)
            kept = {name: options.pop(name, known) for name, known in _SIMULATED.items()}
            options = {"noise": kept.pop("noise"), **options}
            plant, reading = channel, Quantity(channel.outputs[0].name, channel.outputs[0].unit)
            if self.conversion is not None:
                found = self.conversion
                if isinstance(found, str):
                    found = conversions.from_text(found, reading)
                plant = SingleChannel(channel, conversion=found)
                options |= {"conversion": conversions.as_json(found), "reading": str(reading)}
            names = str(plant.inputs[0]), str(plant.outputs[0])
            yield plant, Setup(address, *names, options=options, **kept)


_SIMULATED: dict[str, Any] = {"specimen": None, "seed": 0, "noise": 0.0}


@dataclass(frozen=True)
class HoldEnds:
    """Criteria for the end of a hold of a plan; None as of `Plan`."""

    tolerance: float | None = None
    """Slope of a settled output, in its unit per second; by default the slope that moves the output
    by 0.2 % of its span in another hold."""
    shortest: float | None = None
    """Shortest hold in seconds; by default a quarter of the longest."""
    interval: float | None = None
    """Seconds between samples; by default 1/200 of the shortest hold, or the time of the meter."""

    @property
    def settings(self) -> dict[str, Any]:
        """The parameters of `Plan`."""
        fixed = {"tolerance": self.tolerance, "shortest": self.shortest}
        return fixed | {"sample_interval": self.interval}


@dataclass(frozen=True)
class AdaptivePlan:
    """A plan that chooses each input from the previous measurements; see `Adaptive`.

    Four holds for validation and up to three repetitions are added.
    """

    holds: int | None = None
    """Holds of the design, 12 by default."""
    hours: float | None = None
    """Most hours, with validation and repetitions, instead of holds."""
    hold: float = _HOLD
    """Longest hold in seconds."""
    low: float | None = None
    high: float | None = None
    """``low`` and ``high``: range of the input; by default the limits of the actuator."""
    step: float = math.inf
    """Largest change of the input from hold to hold."""
    least_gain: float = 0.0
    """Stop when a hold would reduce the standard deviation by a smaller share."""
    levels: int = Adaptive.levels
    """Bands of the model."""

    def design(self, actuator: Actuator) -> dict[str, Any]:
        """Return the parameters of `Adaptive`, for the store.

        Raises a `ParameterError` if the budget is too small; a `LimitError` if the range is beyond
        the limits of the actuator.
        """
        channel = actuator.inputs[0]
        holds = self.holds
        if holds is None and self.hours is None:
            holds = Adaptive.holds
        design = {
            "low": channel.low if self.low is None else self.low,
            "high": channel.high if self.high is None else self.high,
            "levels": self.levels,
            "holds": design_holds(holds, self.hours, self.hold),
            "least_gain": self.least_gain,
            **({"step": self.step} if math.isfinite(self.step) else {}),
        }
        for end in ("low", "high"):
            check_input(actuator.inputs, design[end])
        return design


@dataclass(frozen=True)
class Approach:
    """Options to bring an actuator to targets.

    Raises a `ParameterError` if ``every`` is combined with corrections.
    """

    corrections: int = 0
    within: float = 0.0
    absolute: bool = False
    """``corrections``, ``within`` and ``absolute``: as of `TargetDrive`."""
    hold: float = _HOLD
    """Longest hold of a target, in seconds."""
    every: float | None = None
    """For a model with after-effect: seconds between inputs, as of `Delivery`. A target is met
    after the first interval, and kept while the output creeps."""
    tolerance: float | None = None
    """Slope of a settled output, as of `HoldEnds`."""
    saturation: float | None = None
    """Input that saturates the actuator before the first target; by default the lowest level of the
    model."""

    def __post_init__(self) -> None:
        for name in ("corrections", "within", "absolute", "tolerance"):
            if self.every is not None and getattr(self, name) not in (None, 0):
                raise ParameterError(
                    f"--{name} cannot be combined with --every, which uses no readings and does "
                    "not wait for settled outputs; leave it out"
                )

    def chooser(
        self, known: ModelFile, targets: npt.ArrayLike, actuator: Actuator
    ) -> tuple[Delivery | TargetDrive, Plan]:
        """Return the drive, which chooses the inputs, and its plan."""
        channel, input = actuator.inputs[0], str(actuator.inputs[0])
        first = self.saturation
        if first is None:
            first = saturation_of(known.operator, channel)
        shared: dict[str, Any] = {
            "nrmse": known.nrmse,
            "written": getattr(actuator, "written", float),
        }
        if self.every is not None:
            ends = first, channel.low, channel.high
            timed = Delivery(known.model, targets, self.every, self.hold, *ends, **shared)  # type: ignore[arg-type]
            return timed, timed.plan(input=input)
        how = self.corrections, self.within, self.absolute
        settled = TargetDrive(known.operator, targets, first, *how, **shared)  # type: ignore[arg-type]
        return settled, settled.plan(self.hold, input=input, tolerance=self.tolerance)


@dataclass(frozen=True)
class RunResult:
    """Result of a run."""

    figures: Mapping[str, Any]
    """Actuator, specimen and progress by name, for JSON."""
    mode: ResumeMode
    """How the actuator was brought to the first level of this session, as of `minorloop.run`."""
    warnings: tuple[str, ...] = ()
    """Warnings about the bench, the holds and the meter."""
    findings: RunFindings | None = None
    """Findings of an adaptive run."""
    drive: DriveResult | None = None
    """Result of a drive."""

    def to_dict(self) -> dict[str, Any]:
        """Return the result by name, for JSON."""
        found = dict(self.figures)
        if self.drive is not None:
            found |= self.drive.to_dict()
        if self.findings is not None:
            found |= _of_findings(self.findings)
        if "sines" not in found:
            found["warnings"] = list(self.warnings)
        return {**found, "mode": self.mode}


def measure(
    apparatus: Apparatus,
    plan: PathLike | AdaptivePlan,
    store: PathLike,
    settling: HoldEnds = HoldEnds(),
    *,
    carry: Carry = carry,
    say: Say = silent,
) -> RunResult:
    """Carry out a plan on an actuator, and keep every settled point in a new store.

    Raises a `StoreError` if the store exists; a `MinorloopError` as of `minorloop.connect`, `Plan`
    and `minorloop.run`.

    Parameters
    ----------
    apparatus : Apparatus
        The actuator.
    plan : str, path or AdaptivePlan
        A file, as of `Plan.from_csv`, or a plan that chooses inputs from previous measurements.
    store : str or path
        The new file.
    settling : HoldEnds
        Criteria for the end of a hold.
    carry, say : callable
        Carries out the run and shows its progress; receives sentences for the user.

    Examples
    --------
    >>> ml.Plan([0.0, 0.5], longest=20.0, input="voltage [V]").to_csv("plan.csv")
    >>> found = ml.measure(ml.Apparatus("twin:ipmc"), "plan.csv", "run.sqlite")
    >>> found.mode
    'fresh'
    """
    check_new(store)

    def in_plan(whole: Actuator) -> str | None:
        if isinstance(plan, AdaptivePlan) or len(whole.inputs) == 1:
            return None
        headers = read_headers(Path(plan))
        found = [str(channel) for channel in whole.inputs if str(channel) in headers]
        return found[0] if len(found) == 1 else None

    with apparatus.opened(in_plan, say) as (plant, setup):
        if isinstance(plan, AdaptivePlan):
            setup = replace(setup, design=plan.design(plant))
            levels_left_open = [math.nan] * chooser_of(setup, []).most
            settings = {"input": setup.input, **settling.settings}
            wanted = Plan(levels_left_open, plan.hold, **settings)
        else:
            input = setup.input if setup.input in read_headers(Path(plan)) else None
            wanted = Plan.from_csv(plan, input=input, **settling.settings)
        if settling.interval is None:
            wanted = wanted.slowed(answer_time(plant))
        check_plan(plant, wanted)
        if wanted.sines:
            sines = zip(*((sine.frequency, sine.amplitude) for sine in wanted.sines), strict=True)
            if left := at_every_amplitude(*map(list, sines))[1]:
                say(f"note: when this run is evaluated, {left}")
        with Store.create(store, wanted, setup) as kept:
            return _carried_out(plant, kept, carry)


def drive_to(
    known: ModelFile,
    targets: npt.ArrayLike,
    apparatus: Apparatus,
    store: PathLike,
    approach: Approach = Approach(),
    *,
    carry: Carry = carry,
    say: Say = silent,
) -> RunResult:
    """Saturate an actuator, then bring it to each target, and keep every point in a new store.

    Raises a `StoreError` if the store exists; a `ParameterError` if units differ; a
    `MinorloopError` as of `minorloop.connect`, `TargetDrive`, `Delivery` and `minorloop.run`.

    Parameters
    ----------
    known : ModelFile
        The model, as `minorloop.modelfile.read` returns it.
    targets : (n,) array_like
        Target outputs, in order, in the unit of the model.
    apparatus, store, carry, say
        As of `measure`.
    approach : Approach
        Options for the way to the targets.

    Examples
    --------
    >>> from minorloop.modelfile import read
    >>> names = {"input": "voltage [V]", "output": "curvature [1/m]"}
    >>> ml.save(ml.Preisach([-1.2, 1.2], [[10.0]]), "model.json", **names)
    >>> strip = ml.Apparatus("twin:ipmc")
    >>> ml.drive_to(read("model.json"), [2.0], strip, "drive.sqlite").mode
    'fresh'
    """
    check_new(store)

    def of_model(whole: Actuator) -> str | None:
        return None if len(whole.inputs) == 1 else str(known.input)

    with apparatus.opened(of_model, say) as (plant, setup):
        hint = ", or convert the readings (--convert)"
        known.check_units((setup.input, setup.output), "the actuator", ("", hint))
        chosen, plan = approach.chooser(known, targets, plant)
        chosen.check(plant.inputs[0])
        check_plan(plant, plan)
        for warning in known.warnings:
            say(f"warning: this model is not to be trusted: {warning}")
        setup = replace(setup, design={"drive": chosen.to_json()})
        with Store.create(store, plan, setup) as kept:
            return _carried_out(plant, kept, carry)


def resume(store: PathLike, *, carry: Carry = carry, say: Say = silent) -> RunResult:
    """Continue a run of `measure` or `drive_to` after its last settled point.

    Raises a `StoreError` if the file is not a store or another process writes it, and as of `run`.

    Parameters
    ----------
    store : str or path
        The store.
    carry, say
        As of `measure`.

    Examples
    --------
    >>> ml.Plan([0.0, 0.5], longest=20.0, input="voltage [V]").to_csv("plan.csv")
    >>> ml.measure(ml.Apparatus("twin:ipmc"), "plan.csv", "run.sqlite").mode
    'fresh'
    >>> ml.resume("run.sqlite").mode
    'finished'
    """
    with Store.open(store, write=True) as kept:
        setup = kept.setup
        options = {"specimen": setup.specimen, "seed": setup.seed, **setup.options}
        converted = options.pop("conversion", None)
        reading = options.pop("reading", setup.output)
        with opened(setup.address, say=say, **options) as whole:
            plant = single_channel(whole, setup.input, reading)
            if converted is not None:
                found = conversions.from_json(converted)
                plant = SingleChannel(plant, conversion=found, begun=len(kept) > 0)
            return _carried_out(plant, kept, carry)


def check_new(store: PathLike) -> None:
    """Refuse the name of an existing store, which is not replaced, or of a file that cannot exist.

    Raises a `StoreError` or an `OutputError`.
    """
    if Path(store).exists():
        raise StoreError(
            f"{store} exists already; continue it with minorloop resume --store {store}, "
            "or give another name"
        )
    check_writable(store, force=False)


def _carried_out(plant: Actuator, store: Store, carry: Carry) -> RunResult:
    """Carry out the rest of the plan of a store; return the result of all its points."""
    design = store.setup.design
    if store.plan.sines:
        mode, _ = carry(plant, store, None)
        return RunResult(_of_sines(store), mode)
    if design is None:
        mode, wrong = carry(plant, store, None)
        return _measured(plant, store, mode, wrong)
    if "drive" in design:
        drive = _drive_of(plant, design["drive"])
        mode, wrong = carry(plant, store, drive.choose)
        result = drive.result(store.points())
        found = _measured(plant, store, mode, wrong)
        return replace(found, warnings=(*result.advice, *found.warnings), drive=result)
    chooser = chooser_of(store.setup, store.points())

    def next_level(points: Sequence[Point]) -> float | None:
        chooser.learn_noise([point.sd for point in points])
        return chooser.choose(*_inputs_and_outputs(points))

    mode, wrong = carry(plant, store, next_level)
    findings = chooser.findings(*_inputs_and_outputs(store.points()))
    found = _measured(plant, store, mode, wrong)
    return replace(found, warnings=(*findings.warnings, *found.warnings), findings=findings)


def _drive_of(plant: Actuator, fields: dict[str, Any]) -> Delivery | TargetDrive:
    """Return the drive that a store keeps."""
    written = getattr(plant, "written", float)
    if "every" in fields:
        return Delivery.from_json(fields, written=written)
    covered = getattr(plant, "covered", "")
    return TargetDrive.from_json(fields, written=written, covered=covered)


def _inputs_and_outputs(points: Sequence[Point]) -> tuple[list[float], list[float]]:
    return [point.input for point in points], [point.value for point in points]


def _measured(plant: Actuator, store: Store, mode: ResumeMode, wrong: Sequence[str]) -> RunResult:
    figures = summary(store)
    warnings = (*getattr(plant, "warnings", ()), *_doubts(figures), *wrong)
    return RunResult(figures, mode, warnings)


def _of_sines(store: Store) -> dict[str, Any]:
    """Return the number of sines, by name."""
    totals = store.totals()
    return {
        "store": str(store.path),
        "actuator": store.setup.address,
        "sines": totals["points"],
        "planned": len(store.plan),
        "finished": store.finished,
        "held_s": totals["held"],
    }


def _of_findings(found: RunFindings) -> dict[str, Any]:
    """Return the findings of an adaptive run, by name."""
    score = found.validation
    return {
        "holds": found.holds,
        "outliers": list(found.outliers),
        "repeated": list(found.repeated),
        "changes": list(found.changes),
        "validation": score
        and {
            "holds": int(score.measured.size),
            "nrmse": score.nrmse,
            "covered": score.covered,
            "trusted": score.trusted,
        },
    }


def _doubts(figures: Mapping[str, Any]) -> Iterator[str]:
    """Warn if at least half of the holds had not settled, or the meter was slower than the plan."""
    points, unsettled = figures["points"], figures["unsettled"]
    if points and 2 * unsettled >= points:
        yield (
            f"{unsettled} of {points} points had not settled and are not settled outputs; hold "
            "longer"
        )
    planned, most = figures["sample_interval_s"], figures["longest_interval_s"]
    # Ratio of the sample intervals of a hold and of the plan from which a warning is given
    if most is not None and most > 1.2 * planned:
        yield (
            f"the meter was slow at times: samples were up to {most:.3g} s apart, not {planned:g} "
            "s; their times are the true ones"
        )

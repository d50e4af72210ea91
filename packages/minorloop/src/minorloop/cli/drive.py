"""``minorloop drive``: bring an actuator to targets with the inverse of a model."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common, _conversion
from minorloop.cli.run import carry_out_levels, print_mode, run_warnings, summary

if TYPE_CHECKING:
    from minorloop.drive import DriveResult
    from minorloop.lab.actuator import Actuator
    from minorloop.lab.run import ResumeMode
    from minorloop.lab.store import Setup, Store

NAME = "drive"
EXAMPLE = (
    "minorloop drive model.json targets.csv --target curvature --actuator twin:ipmc "
    "--store drive.sqlite"
)

_MISSED = 1
"""Exit status after a drive that missed targets: 2 would mean that it failed."""
_HINT = ", or convert the readings with --laser, --linear, --polynomial or --table"


def run(
    model: _common.ModelFile,
    file: _common.DataFile,
    target: _common.Target,
    actuator: _common.Address,
    store: Annotated[Path, typer.Option(show_default=False, help="New file for the points.")],
    corrections: Annotated[
        int,
        _common.whole_option(
            "Further holds of a target, at most, that correct its error by the sensor; 0 is open "
            "loop."
        ),
    ] = 0,
    within: Annotated[
        float, _common.number_option("Error that is not corrected, in the unit of the output.")
    ] = 0.0,
    absolute: Annotated[
        bool,
        typer.Option(
            "--absolute",
            help="Targets count from the zero of the sensor; otherwise from that of the model.",
        ),
    ] = False,
    laser: _conversion.Laser = None,
    linear: _conversion.Linear = None,
    polynomial: _conversion.Polynomial = None,
    table: _conversion.Table = None,
    name: _conversion.Name = None,
    unit: _conversion.Unit = None,
    hold: Annotated[
        float, _common.seconds_option("Longest hold of a target, in seconds.")
    ] = _common.HOLD,
    every: Annotated[
        float | None,
        _common.seconds_option(
            "For a model with after-effect: seconds between inputs. A target is met after the "
            "first interval, and kept while the output creeps."
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        _common.number_option("Slope of a settled output, in its unit per second, as for run."),
    ] = None,
    saturation: Annotated[
        float | None,
        _common.number_option(
            "Input that saturates the actuator before the first target; the lowest level of the "
            "model if not given."
        ),
    ] = None,
    specimen: _common.Specimen = None,
    noise: _common.Noise = 0.0,
    seed: _common.Seed = 0,
    report: _common.Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Saturate an actuator, then bring it to each target; resume continues a stopped drive.

    If a target ends further off than the model lets expect, the exit status is 1.
    """
    from minorloop import modelfile
    from minorloop.delivery import Delivery
    from minorloop.drive import TargetDrive, saturation_of
    from minorloop.lab.run import check_plan
    from minorloop.lab.store import Setup, Store

    if every is not None:
        _refuse_with_every(corrections, within, absolute, tolerance)
    _common.check_new_store(store)
    _common.check_outputs([store, report], inputs=[model, file], force=force)
    options = _conversion.ConversionOptions(laser, linear, polynomial, table, name, unit)
    known = modelfile.read(model)
    targets = _common.read_column(file, target, known.output.unit)
    with _common.connected(actuator, specimen=specimen, noise=noise, seed=seed) as plant:
        channel = _channel(plant, str(known.input))
        plant = options.converted(channel)
        names = str(plant.inputs[0]), str(plant.outputs[0])
        _common.check_units(known, names, "the actuator", ("", _HINT))
        first = saturation_of(known.operator, plant.inputs[0]) if saturation is None else saturation
        written = getattr(plant, "written", float)
        shared: dict[str, Any] = {"nrmse": known.nrmse, "written": written}
        chosen: Delivery | TargetDrive
        if every is None:
            correcting = (corrections, within, absolute)
            chosen = TargetDrive(known.operator, targets, first, *correcting, **shared)
            plan = chosen.plan(hold, input=names[0], tolerance=tolerance)
        else:
            limits = plant.inputs[0].low, plant.inputs[0].high
            chosen = Delivery(known.model, targets, every, hold, first, *limits, **shared)  # type: ignore[arg-type]
            plan = chosen.plan(input=names[0])
        chosen.check(plant.inputs[0])
        check_plan(plant, plan)
        design = {"drive": chosen.to_json()}
        given = {"noise": noise, **options.for_setup(channel.outputs[0])}
        setup = Setup(actuator, *names, specimen, seed, given, design)
        _common.print_warnings(known.warnings)
        with Store.create(store, plan, setup) as opened:
            carry_out(plant, opened, as_json, report, force)


def _refuse_with_every(
    corrections: int, within: float, absolute: bool, tolerance: float | None
) -> None:
    """Refuse options that a delivery in time does not have."""
    given = {"corrections": corrections or None, "within": within or None}
    given |= {"absolute": absolute or None, "tolerance": tolerance}
    why = "cannot be combined with --every, which uses no reading and waits for no settled output"
    _common.refuse_given(given, why)


def _channel(plant: Actuator, input: str) -> Actuator:
    """Return the input with a name, and its output, of an actuator with several inputs."""
    from minorloop.lab.wrapped_actuator import single_channel

    return plant if len(plant.inputs) == 1 else single_channel(plant, input)


def carry_out(
    plant: Actuator,
    store: Store,
    as_json: bool,
    report: Path | None = None,
    force: bool = False,
) -> None:
    """Carry out the rest of a drive in a store, and print the targets with what was achieved."""
    from minorloop.delivery import Delivery
    from minorloop.drive import TargetDrive
    from minorloop.drive_report import drive_report

    fields, written = (store.setup.design or {})["drive"], getattr(plant, "written", float)
    chosen: Delivery | TargetDrive
    if "every" in fields:
        chosen = Delivery.from_json(fields, written=written)
    else:
        covered = getattr(plant, "covered", "")
        chosen = TargetDrive.from_json(fields, written=written, covered=covered)
    mode, faults = carry_out_levels(plant, store, chosen.choose)
    result, figures = chosen.result(store.points()), summary(store)
    warnings = [*result.advice, *run_warnings(plant, figures), *faults]
    if report is not None:
        drive_report(result, figures, warnings).write(report, force=force)
    if as_json:
        _common.print_json({**figures, **result.to_dict(), "warnings": warnings, "mode": mode})
    else:
        _print(result, figures, warnings, mode)
    if result.missed:
        raise typer.Exit(_MISSED)


def is_drive(setup: Setup) -> bool:
    """Whether the store of a run belongs to a drive."""
    return "drive" in (setup.design or {})


def _print(
    result: DriveResult, known: dict[str, Any], warnings: list[str], mode: ResumeMode
) -> None:
    print_mode(mode)
    unit = known["output"]
    columns = [f"target {unit}", str(known["input"]), "achieved", "error", "sd", "holds", ""]
    _common.print_table(columns, result.rows)
    score = result.summary()
    if score["rms"] is not None:
        typer.echo(f"error: {score['rms']:.3g} rms, {score['worst']:.3g} at most, in {unit}")
    if math.isfinite(result.offset):
        typer.echo(f"the sensor reads {result.offset:+.4g} more than the model in saturation")
    _common.print_advice(warnings)
    typer.echo(f"kept in {known['store']}")

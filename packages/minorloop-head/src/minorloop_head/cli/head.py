"""``minorloop head``: calibrate a head, identify its wires, drive it, and inspect a pipe by it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._run_progress import carry_out_levels
from minorloop.values import called, parsed
from minorloop_head.cli import _water
from minorloop_head.cli._board import board
from minorloop_head.cli._calibration import calibrate, photograph
from minorloop_head.cli._scan import scan

if TYPE_CHECKING:
    from minorloop_head.procedures.head_file import HeadFile

NAME = "head"
_HELP = "Calibrate a catheter head, identify its two wires, drive it, and inspect a pipe by it."
app = typer.Typer(help=_HELP)

_AGAIN = "the runs before this one are kept whole; the same command continues it"
_MM = 1e-3
_said = partial(typer.echo, err=True)
_Address = Annotated[
    str,
    typer.Option(
        show_default=False,
        help="Address of the head, such as bench:head.toml, see minorloop devices; or a simulated "
        "one: twin:head, or twin:pipe, which has a camera.",
    ),
]
_Seeing = Annotated[
    str | None,
    typer.Option(
        help="Camera that gives the angles, for a head without sensors at its joints, such as "
        "camera:0, camera:http://... or module:PACKAGE.FUNCTION; its calibration is that in the "
        "file of the head. The simulated pipe, twin:pipe, has its own."
    ),
]
_Specimen = Annotated[
    int | None, _common.whole_option("Seed of a twin's specimen; nominal if not given.")
]
_Noise = Annotated[
    float, _common.number_option("Standard deviation of a twin's sensor, in its unit.")
]
_Seed = Annotated[int, _common.whole_option("Seed of a twin's noise.")]
_PipeSeed = Annotated[
    int,
    _common.whole_option(
        "With twin:pipe: seed that draws its pipe and the noise; 0 is a demonstration, with a pit "
        "that is easy to find."
    ),
]
_Resume = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="Resume the interrupted work in --out, with the same other options. "
        "Lines before a damaged line of its journal are kept.",
    ),
]
_File = Annotated[
    Path, typer.Option(show_default=False, help="File of the head, as head identify writes it.")
]
_Store = Annotated[
    Path, typer.Option(show_default=False, help="Folder of the runs; they are continued.")
]
_Written = Annotated[
    Path,
    typer.Option(
        show_default=False,
        help="File to write. If it exists, it keeps its calibration, and its wires are "
        "replaced with --force.",
    ),
]
_Serial = Annotated[
    str | None,
    typer.Option(help="Serial number of the head; only if the actuator does not know it."),
]
_Inputs = Annotated[
    str,
    typer.Option(
        metavar="KEY=VALUE,...",
        show_default=False,
        help="highest: largest current in A, 0.4 if not given; bands of the model of each "
        "wire, 12; hold: longest hold of a current in s, 40; minor-loops=yes: measure a "
        "decaying staircase too, for inputs that turn back often: almost twice the holds of "
        "the curves, and somewhat less error in wide loops; may be added later, with --force.",
    ),
]
_Inspected = Annotated[
    Path,
    typer.Option(
        show_default=False,
        help="New or empty folder for journal.jsonl, findings.csv, unconfirmed.csv, "
        "findings.json, report.html, pictures, and 3-D models of scanned findings.",
    ),
]
_Advances = Annotated[
    str,
    typer.Option(
        metavar="MM,...",
        help="Advances of the catheter in mm from which it looks round; 0 without a catheter.",
    ),
]
_Looking = Annotated[
    str | None, typer.Option(help="Address, such as camera:/dev/video2. twin:pipe has its own.")
]
_Known = Annotated[
    Path | None,
    typer.Option(
        help="File of the head, as head identify writes it. twin:pipe is identified without."
    ),
]
_Probe = Annotated[
    Path | None,
    typer.Option(
        help="TOML file of the pulser and the digitiser of a head of devices, which then also "
        "scans the finds of the camera; the pump must be a line of the bench."
    ),
]
_Pipe = Annotated[
    str | None, typer.Option(help="Identity of the pipe, for the report.", show_default=False)
]
_LeastWall = Annotated[
    float | None,
    _common.number_option("Least remaining wall in mm under an accepted finding."),
]
_Probed = Annotated[
    str,
    typer.Option(show_default=False, help="Its address: twin:pipe, the only head with a probe."),
]
_Swept = Annotated[
    Path,
    typer.Option(
        show_default=False,
        help="New or empty folder for journal.jsonl, findings.csv, findings.json and report.html.",
    ),
]
_Around = Annotated[
    str,
    typer.Option(metavar="DEG,DEG", help="First and last angle around the pipe, 90 at the bottom."),
]
_Along = Annotated[str, typer.Option(metavar="MM,MM", help="First and last place along the pipe.")]


@app.command(
    epilog="Example: minorloop head identify --actuator twin:head --noise 0.05 --store runs "
    "--head head.json"
)
def identify(
    actuator: _Address,
    store: _Store,
    head: _Written,
    serial: _Serial = None,
    inputs: _Inputs = "",
    camera: _Seeing = None,
    specimen: _Specimen = None,
    noise: _Noise = 0.0,
    seed: _Seed = 0,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Measure both wires of a head, identify and check them; the same command continues it.

    The exit status is 1 if a model is off by more than 5 % of the range of its wire in the check.
    """
    from minorloop_head.inspection import HeadAddress, identify_head
    from minorloop_head.procedures.identify import HeadExcitation

    found = identify_head(
        HeadAddress(actuator, camera, specimen, noise, seed),
        store,
        head,
        called(HeadExcitation, "--inputs", parsed(inputs).options),
        serial=serial,
        force=force,
        told=_said,
        carry_out=lambda plant, store: carry_out_levels(plant, store, None, again=_AGAIN)[0],
    )
    _show(found, head, as_json)
    if found.identified is not None and found.identified.untrusted:
        raise typer.Exit(1)


def _show(found: HeadFile, path: Path, as_json: bool) -> None:
    known = found.identified
    assert known is not None
    errors = {
        axis: {"rms_deg": each.rms, "largest_deg": each.largest}
        for axis, each in zip(("pan", "tilt"), known.check, strict=True)
    }
    lags, advice = [wire.lag for wire in known.wires], [*known.untrusted, *known.advice]
    if as_json:
        content: dict[str, Any] = {"head": str(path), "serial": found.serial, "check": errors}
        _common.print_json({**content, "lag_s": lags, "coupling": known.coupling, "advice": advice})
        return
    rows = [
        (axis, f"{lag:.3g}", f"{each['rms_deg']:.2f}", f"{each['largest_deg']:.2f}")
        for (axis, each), lag in zip(errors.items(), lags, strict=True)
    ]
    columns = ("axis", "lag [s]", "check, rms [deg]", "largest [deg]")
    _common.print_table(columns, rows, f"head {found.serial}, checked on random inputs")
    _common.print_advice(advice)
    then = "" if known.untrusted else f"; next: minorloop head drive, or console --head {path}"
    typer.echo(f"kept in {path}{then}")


@app.command(
    epilog="Example: minorloop head drive targets.csv --head head.json --actuator twin:head"
)
def drive(
    file: _common.DataFile,
    head: _File,
    actuator: _Address,
    hold: Annotated[float, _common.number_option("Seconds for each target.")] = 8.0,
    camera: _Seeing = None,
    specimen: _Specimen = None,
    noise: _Noise = 0.0,
    seed: _Seed = 0,
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Bring both axes of a head to targets under control, one row after the other.

    The table has the columns pan and tilt, in deg.
    Faults of the readings are named with their times. An angle whose readings were not used is
    that of the model, and is marked so. The exit status is 1 if a target was not reached within
    5 % of the reach of its wire, was not held still within as much, or is not confirmed by used
    readings, or a wire was cooled because of its readings.
    """
    import numpy as np

    from minorloop.lab.conversion import read_column
    from minorloop_head.cli import _head_drive
    from minorloop_head.geometry import AXES
    from minorloop_head.inspection import HeadAddress, drive_head
    from minorloop_head.procedures.head_file import read_head

    _common.check_outputs([save], inputs=[file, head], force=force)
    read_head(head)  # its errors come before those of the table
    columns = [read_column(file, name, "deg", "a head is driven") for name in AXES]
    unfinished = _head_drive.UnfinishedDrive(save, force, as_json)
    with unfinished.said():
        result = drive_head(
            np.column_stack(columns),
            hold,
            HeadAddress(actuator, camera, specimen, noise, seed),
            head,
            told=_said,
            unfinished=unfinished,
        )
    _head_drive.finish_drive(result, save, force, as_json)
    if not result.done:
        raise typer.Exit(1)


@app.command(
    epilog="Example: minorloop head inspect --actuator bench:head.toml --camera camera:/dev/video2 "
    "--head head.json --out inspected"
)
def inspect(
    actuator: _Address,
    out: _Inspected,
    advances: _Advances = "0",
    camera: _Looking = None,
    head: _Known = None,
    probe: _Probe = None,
    specimen: _Specimen = None,
    seed: _PipeSeed = 0,
    pipe: _Pipe = None,
    least_wall: _LeastWall = None,
    water: _water.Level = _water.FULL,
    resume: _Resume = False,
    as_json: _common.Json = False,
) -> None:
    """Search the wall within reach for holes, pits and cracks, and measure each, without operator.

    The camera finds them. A head with a probe, that of twin:pipe, also touches each, scans it in
    the flooded pipe and measures its depth. The head is made safe at the end, and after an error
    or Ctrl-C. Findings until then are kept, and --resume goes on from there, also after a
    power cut. The exit status is 1 if no view could be searched.
    """
    from minorloop_head.cli.inspect import check_usable
    from minorloop_head.inspection import inspect as inspect_pipe
    from minorloop_head.inspection import inspected_head
    from minorloop_head.inspection.report import shown_tables, summary, wall_words
    from minorloop_head.vision.imaging import opencv

    places = _common.numbers("advances", advances, range(1, 1001), "advances in mm")
    opencv()  # before anything moves
    filling = _water.water_of(water)
    opened = inspected_head(
        actuator, camera, head, specimen=specimen, seed=seed, water=filling, probe=probe
    )
    with _noted(), _common.working("opening the head", logged=True) as now:
        found = inspect_pipe(
            opened,
            out,
            [_MM * each for each in places],
            pipe=pipe,
            least_wall=None if least_wall is None else _MM * least_wall,
            resume=resume,
            told=now,
        )
    if as_json:
        _common.print_json(found.content)
    else:
        for columns, rows, title in shown_tables(found.content):
            _common.print_table(columns, rows, title)
        typer.echo(" ".join(wall_words(found.content)))
        typer.echo(f"{summary(found.content)}\nkept in {out}")
    check_usable(found.content)


@app.command(
    epilog="Example: minorloop head sweep --actuator twin:pipe --around 10,40 --along 19,21 "
    "--out swept"
)
def sweep(
    actuator: _Probed,
    out: _Swept,
    around: _Around = "0,180",
    along: _Along = "19,21",
    specimen: _Specimen = None,
    seed: _PipeSeed = 0,
    water: _water.Level = _water.FULL,
    resume: _Resume = False,
    as_json: _common.Json = False,
) -> None:
    """Map the flooded wall by ultrasound, and find pits and cracks in it, without the camera.

    The probe fires while the catheter rolls. A square centimetre takes the head two to three
    minutes. After Ctrl-C, the map of all bursts is kept, and --resume goes on from there, also
    after a power cut. Only the simulated head has a probe.
    """
    from minorloop_head.inspection import sweep as sweep_wall
    from minorloop_head.inspection import swept_head

    degrees, places = (
        _common.numbers(name, text, (2,), f"two numbers in {unit}")
        for name, text, unit in (("around", around, "degrees"), ("along", along, "mm"))
    )
    filling = _water.water_of(water)
    opened = swept_head(actuator, specimen=specimen, seed=seed, water=filling)
    angles, ends = [math.radians(each) for each in degrees], [_MM * each for each in places]
    with _noted(), _common.working("identifying the head", logged=True) as now:
        found = sweep_wall(opened, out, angles, ends, resume=resume, told=now)
    if as_json:
        _common.print_json(found.content)
        return
    if rows := found.findings:
        cells = [["-" if each is None else str(each) for each in row.values()] for row in rows]
        _common.print_table(list(rows[0]), cells)
    typer.echo(f"{found.summary}\nkept in {out}")


@contextmanager
def _noted() -> Iterator[None]:
    """Print the notes of an error on the interrupted work."""
    try:
        yield
    except BaseException as error:
        for note in getattr(error, "__notes__", ()):
            typer.echo(note, err=True)
        raise


app.command(epilog="Example: minorloop head board head.json --out firmware --float32 --memory 32")(
    board
)
app.command(
    epilog="Example: minorloop head photograph --camera camera:/dev/video2 "
    "--actuator bench:head.toml --out mount"
)(photograph)
app.command(
    epilog="Example: minorloop head calibrate --pictures lens --mount mount "
    "--target charuco,squares=9x7,side=3 --head head.json --serial H-07"
)(calibrate)
app.command(
    epilog="Example: minorloop head scan block.mat --speeds 1480,5900 --given step=0.5 --out found"
)(scan)

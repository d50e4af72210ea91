"""``minorloop drive``: bring an actuator to targets with the inverse of a model."""

from typing import Annotated

import typer

from minorloop.cli import _common, _measured

NAME = "drive"
EXAMPLE = (
    "minorloop drive model.json targets.csv --target curvature --actuator twin:ipmc "
    "--store drive.sqlite"
)


_Corrections = Annotated[
    int,
    _common.whole_option(
        "Further holds of a target, at most, that correct its error by the sensor; 0 is open loop."
    ),
]
_Within = Annotated[
    float, _common.number_option("Error that is not corrected, in the unit of the output.")
]
_Absolute = Annotated[
    bool,
    typer.Option(
        "--absolute",
        help="Targets count from the zero of the sensor; otherwise from that of the model.",
    ),
]
_Hold = Annotated[float, _common.seconds_option("Longest hold of a target, in seconds.")]
_Every = Annotated[
    float | None,
    _common.seconds_option(
        "For a model with after-effect: seconds between inputs. A target is met after the first "
        "interval, and kept while the output creeps."
    ),
]
_Tolerance = Annotated[
    float | None,
    _common.number_option("Slope of a settled output, in its unit per second, as for run."),
]
_Saturation = Annotated[
    float | None,
    _common.number_option(
        "Input that saturates the actuator before the first target; the lowest level of the model "
        "if not given."
    ),
]


def run(
    model: _common.ModelFile,
    file: _common.DataFile,
    target: _common.Target,
    actuator: _common.Address,
    store: _common.NewStore,
    corrections: _Corrections = 0,
    within: _Within = 0.0,
    absolute: _Absolute = False,
    convert: _common.Convert = None,
    hold: _Hold = 200.0,
    every: _Every = None,
    tolerance: _Tolerance = None,
    saturation: _Saturation = None,
    report: _common.Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Saturate an actuator, then bring it to each target; resume continues a stopped drive.

    If a target is missed by more than is expected of the model, the exit status is 1.
    """
    from minorloop import modelfile
    from minorloop.lab.conversion import read_column
    from minorloop.measurement import Apparatus, Approach, drive_to

    approach = Approach(corrections, within, absolute, hold, every, tolerance, saturation)
    _common.check_outputs([report], inputs=[model, file, store], force=force)
    known = modelfile.read(model)
    targets = read_column(file, target, known.output.unit)
    apparatus = Apparatus(actuator, conversion=convert)
    found = drive_to(known, targets, apparatus, store, approach, **_measured.SHOWN)
    _measured.show(found, as_json, report, force)

"""``minorloop frequency``: gain and phase from measured sines, before and after a model."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from minorloop.cli import _common

NAME = "frequency"
EXAMPLE = "minorloop frequency sines.sqlite --model model.json --report bode.html"

_Data = Annotated[
    Path,
    typer.Argument(
        help="Experiment store of sines, as run makes it; or a CSV file with columns of time, "
        "frequency, input and output.",
        show_default=False,
    ),
]
_Model = Annotated[
    Path | None, typer.Option(help="Model of the hysteresis, as identify --save writes it.")
]
_Input = Annotated[str | None, typer.Option(help="CSV file: column of the input.")]
_Output = Annotated[str | None, typer.Option(help="CSV file: column of the output.")]
_Frequency = Annotated[
    str, typer.Option(help="CSV file: column of the frequency in Hz, 0 in rows that are no sine.")
]
_Periods = Annotated[
    int, _common.whole_option("CSV file: periods to evaluate at the end of each sine.")
]


def run(
    file: _Data,
    model: _Model = None,
    input: _Input = None,
    output: _Output = None,
    time: _common.Time = None,
    frequency: _Frequency = "frequency",
    periods: _Periods = 2,
    save: _common.Save = None,
    report: _common.Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Gain and phase of the fundamental from measured sines, before and after a model.

    With a model, the gains from its output to that of the actuator are computed too. They do not
    depend on the amplitude if the actuator is hysteresis followed by linear dynamics.
    """
    from minorloop import modelfile
    from minorloop.identification.sine_response import response_of_file

    read = [file] if model is None else [file, model]
    _common.check_outputs([save, report], inputs=read, force=force)
    known = None if model is None else modelfile.read(model)
    with _common.working(f"reading {file.name}") as now:
        found = response_of_file(
            file,
            known,
            input=input,
            output=output,
            time=_common.named(time),
            frequency=frequency,
            periods=periods,
            progress=_common.reading(file, now),
        )
    if known is not None:
        _common.print_warnings(known.warnings)
    _common.finish(
        as_json,
        found.to_dict,
        lambda: typer.echo(f"{found.names[1]} against {found.names[0]}\n{found}"),
        _common.table(save, found.columns(), force),
        _common.drawn(report, partial(found.report, file.name), force),
    )

"""``minorloop frequency``: gain and phase from measured sines, before and after a model."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError, RecordError

if TYPE_CHECKING:
    from minorloop.identification.frequency import FrequencyResponse
    from minorloop.identification.sine_response import SinePeriods
    from minorloop.lab.sines import MeasuredSine

NAME = "frequency"
_HELD = "input held"
"""Column that is 1 where the input of a row was held since the row before; 0 where it is linear."""
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
    str,
    typer.Option(help="CSV file: column of the frequency in Hz, 0 in rows that are no sine."),
]
_Periods = Annotated[
    int, _common.whole_option("CSV file: periods to evaluate at the end of each sine.")
]
_Samples = Annotated[
    Path | None, typer.Option(help="Write the samples of a store to this CSV file.")
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
    samples: _Samples = None,
    report: _common.Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Gain and phase of the fundamental from measured sines, before and after a model.

    With a model, the gains from its output to that of the actuator are computed too. They do not
    depend on the amplitude if the actuator is hysteresis followed by linear dynamics.
    """
    from minorloop import modelfile
    from minorloop.identification.sine_response import sine_response, unsaturated
    from minorloop.lab.store import is_store

    read = [file] if model is None else [file, model]
    _common.check_outputs([save, samples, report], inputs=read, force=force)
    known = None if model is None else modelfile.read(model)
    operator = None if known is None else known.operator
    if is_store(file):
        if (input, output, time) != (None, None, None):
            raise ParameterError(
                f"{file} is an experiment store, which has one input and one output; leave "
                "--input, --output and --time out"
            )
        sines, names, measured = _of_store(file, operator)
    else:
        if samples is not None:
            raise ParameterError(f"--samples is for an experiment store, and {file} is none")
        sines, names = _of_csv(file, operator, (input, output, time, frequency), periods)
        measured = []
    if known is not None:
        known.check_units(names, "the sines")
    response, notes = sine_response(sines)
    if known is not None:
        notes += unsaturated(known.operator, [one.sine.preamble for one in measured])
        _common.print_warnings(known.warnings)
    notes += _slow(measured)
    steps: list[Callable[[], None]] = [partial(_show, response, names, notes, as_json)]
    # Files first: the reader of the output may end.
    if report is not None:
        draw = partial(response.report, file.name, names, [*notes, *response.advice])
        steps.insert(0, partial(_common.write_report, draw, report, force=force))
    if samples is not None:
        steps.insert(0, partial(_write_samples, measured, names, samples, force))
    if save is not None:
        steps.insert(0, partial(_common.write_csv, save, _columns(response, names), force=force))
    _common.do_all(steps)


def _of_store(
    file: Path, operator: Any
) -> tuple[list[SinePeriods], tuple[str, str], list[MeasuredSine]]:
    from minorloop.identification.sine_response import measured_periods
    from minorloop.lab.run import measured_sines
    from minorloop.lab.store import Store

    with Store.open(file) as store:
        measured = measured_sines(store)
        names = store.setup.input, store.setup.output
    return [measured_periods(one, operator) for one in measured], names, measured


def _of_csv(
    file: Path,
    operator: Any,
    columns: tuple[str | None, str | None, str | None, str],
    periods: int,
) -> tuple[list[SinePeriods], tuple[str, str]]:
    from minorloop.identification.sine_response import logged_periods
    from minorloop.lab.columns import read_headers

    input, output, time, frequency = columns
    if not os.path.exists(file):
        raise RecordError(f"{file} does not exist; give an experiment store or a CSV file")
    if input is None or output is None:
        missing = "--input" if input is None else "--output"
        raise ParameterError(f"{missing} is missing; name a column of {file}")
    with _common.working(f"reading {file.name}") as now:
        record = _common.read_log(file, input, output, time, now)
        hertz = _common.read_column(file, frequency, "Hz", "frequencies are")
        held = _common.read_column(file, _HELD) if _HELD in read_headers(file) else None
    if not record.timed:
        raise ParameterError(f"{file} has no column of time; name it with --time")
    log = record.t, record.u, record.y, hertz
    sines = logged_periods(*log, operator, periods=periods, held=held)
    return sines, (str(record.input), str(record.output))


def _slow(measured: list[MeasuredSine]) -> list[str]:
    from minorloop.lab.sines import SLOW

    slowest = max((one.slow for one in measured), default=1.0)
    if slowest <= SLOW:
        return []
    return [
        f"the bench took up to {slowest - 1:.1%} longer than planned, so frequencies are lower by "
        "this; give it a slower tick"
    ]


def _columns(response: FrequencyResponse, names: tuple[str, str]) -> dict[str, Any]:
    """Return the columns of the table, one row for each frequency and amplitude."""
    from minorloop.identification.frequency import decibels, degrees
    from minorloop.lab.records import Quantity

    count = response.amplitudes.size
    unit = Quantity.parse(names[0]).unit
    columns = {
        "frequency [Hz]": [f for f in response.frequencies.tolist() for _ in range(count)],
        str(Quantity("amplitude", unit)): response.amplitudes.tolist() * response.frequencies.size,
        "gain [dB]": decibels(response.plant).T.ravel().tolist(),
        "phase [deg]": degrees(response.plant).T.ravel().tolist(),
        "distortion": response.distortion.T.ravel().tolist(),
    }
    if response.after is not None:
        columns["gain after operator [dB]"] = decibels(response.after).T.ravel().tolist()
        columns["phase after operator [deg]"] = degrees(response.after).T.ravel().tolist()
    return columns


def _write_samples(
    measured: list[MeasuredSine], names: tuple[str, str], path: Path, force: bool
) -> None:
    """Write the samples of all sines as a log; rows before a sine have frequency 0."""
    import numpy as np

    rows, end = [], 0.0
    for one in measured:
        sine = one.sine
        begin = end + 2 * sine.hold
        t = begin + sine.interval * np.arange(1, sine.count + 1)
        before = np.array([end + sine.hold / 2, begin])
        held = float(one.held)
        rows.append((before, np.zeros(2), one.before, np.full(2, np.nan), np.full(2, held)))
        rows.append((t, np.full(t.size, sine.frequency), one.u, one.y, np.full(t.size, held)))
        end = float(t[-1])
    headers = ("time [s]", "frequency [Hz]", *names, _HELD)
    columns = map(np.concatenate, zip(*rows, strict=True))
    table = dict(zip(headers, columns, strict=True))
    _common.write_csv(path, table, force=force)


def _show(
    response: FrequencyResponse, names: tuple[str, str], notes: list[str], as_json: bool
) -> None:
    if as_json:
        from minorloop.identification.frequency import decibels, degrees

        after = response.after
        several = response.amplitudes.size > 1 and after is not None
        gains = response.gain_spread() if several else None
        phases = response.phase_spread() if several else (None, None)
        _common.print_json(
            {
                "input": names[0],
                "output": names[1],
                "frequencies_hz": response.frequencies,
                "amplitudes": response.amplitudes,
                "offset": response.bias,
                "gain_db": decibels(response.plant),
                "phase_deg": degrees(response.plant),
                "after_gain_db": None if after is None else decibels(after),
                "after_phase_deg": None if after is None else degrees(after),
                "distortion": response.distortion,
                "unsettled": response.unsettled,
                "gain_spread_before_db": gains and gains.before,
                "gain_spread_after_db": gains and gains.after,
                "phase_spread_before_deg": phases[0],
                "phase_spread_after_deg": phases[1],
                "advice": [*notes, *response.advice],
            }
        )
        return
    typer.echo(f"{names[1]} against {names[0]}\n{response}")
    _common.print_advice(notes)

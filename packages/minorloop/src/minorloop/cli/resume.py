"""``minorloop resume``: continue a run that was stopped."""

from pathlib import Path
from typing import Annotated

import typer

from minorloop.cli import _common, drive
from minorloop.cli._conversion import ConversionOptions
from minorloop.cli.run import carry_out

NAME = "resume"
EXAMPLE = "minorloop resume --store runs.sqlite"


def run(
    store: Annotated[Path, typer.Option(show_default=False, help="The store that run wrote.")],
    as_json: _common.Json = False,
) -> None:
    """Continue a run after its last settled point, whatever stopped it."""
    from minorloop.lab.store import Store
    from minorloop.lab.wrapped_actuator import single_channel

    with Store.open(store, write=True) as opened:
        setup = opened.setup
        options = {"specimen": setup.specimen, "seed": setup.seed, **setup.options}
        options.pop("conversion", None)
        reading = options.pop("reading", None)
        with _common.connected(setup.address, **options) as whole:
            conversion = ConversionOptions.of_setup(setup)
            output = reading if conversion.to_json() else setup.output
            channel = single_channel(whole, setup.input, output)
            plant = conversion.converted(channel, begun=len(opened) > 0)
            if drive.is_drive(setup):
                drive.carry_out(plant, opened, as_json)
            else:
                carry_out(plant, opened, as_json)

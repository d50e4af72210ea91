"""``minorloop run``: carry out a plan on an actuator, and store every settled point."""

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from minorloop.cli import _common, _measured
from minorloop.values import called, parsed

NAME = "run"
EXAMPLE = "minorloop run --actuator twin:ipmc --plan plan.csv --store runs.sqlite"


class _RunCommand(TyperCommand):
    """``minorloop run``; its help lists the addresses that exist."""

    def get_help(self, ctx: Any) -> str:
        """Return the help with the addresses."""
        from minorloop.connect import addresses

        (actuator,) = (each for each in self.params if each.name == "actuator")
        actuator.help = f"Its address: {', '.join(addresses())}."  # type: ignore[attr-defined]
        return super().get_help(ctx)


COMMAND = _RunCommand


def run(
    actuator: _common.Address,
    plan: Annotated[
        str,
        typer.Option(
            show_default=False,
            help="CSV file, as plan --save writes it; or adaptive, to choose each input from the "
            "measurements before it: adaptive[:KEY=VALUE,...] with holds (12) or hours, hold in "
            "seconds (200), low, high, step, least_gain, levels (20).",
        ),
    ],
    store: _common.NewStore,
    input: _common.Input = None,
    output: _common.Output = None,
    convert: _common.Convert = None,
    holds: Annotated[
        str,
        typer.Option(
            metavar="KEY=VALUE,...",
            help="When a hold ends: tolerance (slope of a settled output, in its unit per second), "
            "shortest (seconds), and interval (seconds between samples).",
        ),
    ] = "",
    as_json: _common.Json = False,
) -> None:
    """Carry out a plan: levels held until the output settles, or sines; resume continues it."""
    from minorloop.measurement import AdaptivePlan, Apparatus, HoldEnds, measure

    value = parsed(plan)
    adaptive = value.kind == "adaptive"
    found = measure(
        Apparatus(actuator, input, output, convert),
        called(AdaptivePlan, "--plan adaptive", value.options) if adaptive else Path(plan),
        store,
        called(HoldEnds, "--holds", parsed(holds).options),
        **_measured.SHOWN,
    )
    _measured.show(found, as_json)

"""``minorloop resume``: continue a run that was stopped."""

from pathlib import Path
from typing import Annotated

import typer

from minorloop.cli import _common, _measured

NAME = "resume"
EXAMPLE = "minorloop resume --store runs.sqlite"


def run(
    store: Annotated[Path, typer.Option(show_default=False, help="The store that run wrote.")],
    as_json: _common.Json = False,
) -> None:
    """Continue a run after its last settled point, whatever stopped it."""
    from minorloop.measurement import resume

    _measured.show(resume(store, **_measured.SHOWN), as_json)

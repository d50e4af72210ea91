"""The command line: one file a verb. Nothing heavy is imported until a verb runs."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import typer

from minorloop.cli import demo, identify, invert, plan, simulate
from minorloop.errors import MinorloopError

_REFUSED = 2
_INTERRUPTED = 130
# The root of what the parser raises; typer exports its leaves only.
_UsageError: type[Exception] = typer.BadParameter.__mro__[2]

app = typer.Typer(
    help="Hysteresis of smart actuators: from measured data to precise positioning.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for _verb in (identify, simulate, invert, plan, demo):
    app.command(_verb.NAME)(_verb.run)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; an error is one line on stderr and exit status 2.

    Parameters
    ----------
    arguments : sequence of str, optional
        What follows the name of the program; ``sys.argv`` if not given.

    Returns
    -------
    int
        The exit status.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        status = app(given or ["--help"], prog_name="minorloop", standalone_mode=False)
    except MinorloopError as error:
        return _refuse(str(error))
    except _UsageError as error:
        said = getattr(error, "format_message", error.__str__)()
        return _refuse(f"{said.rstrip('.')}; see minorloop --help")
    except MemoryError:
        return _refuse("there is not enough memory for this; use fewer levels or fewer rows")
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except (typer.Abort, KeyboardInterrupt):
        status = _INTERRUPTED
    if status == _INTERRUPTED:
        print("interrupted", file=sys.stderr)
    return int(status or 0)


def _refuse(message: str) -> int:
    print("error: " + " ".join(message.split()), file=sys.stderr)
    return _REFUSED

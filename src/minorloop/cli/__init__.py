"""The command line: one file a verb. Nothing heavy is imported until a verb runs."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Annotated

import typer

from minorloop.cli import (
    console,
    demo,
    drive,
    export,
    fleet,
    frequency,
    identify,
    invert,
    plan,
    reduce,
    resume,
    runs,
    simulate,
    study,
)
from minorloop.cli import run as run_verb
from minorloop.errors import MinorloopError, SafetyError
from minorloop.version import __version__

_FAILED = 1
_REFUSED = 2
_UNSAFE = 3
_INTERRUPTED = 130
_LONGEST = 800
"""Characters of an error on one line, about ten lines of a terminal: a longer one loses its
middle."""
# The root of what the parser raises; typer exports its leaves only.
_UsageError: type[Exception] = typer.BadParameter.__mro__[2]

app = typer.Typer(
    help="Hysteresis of smart actuators: from measured data to precise positioning.",
    epilog="Start with: minorloop demo --out demo. Every command has its own --help.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_VERBS = (
    *(reduce, identify, simulate, invert, plan, run_verb, drive, resume, runs, frequency),
    *(export, fleet, study, console, demo),
)
for _verb in _VERBS:
    _kind = getattr(_verb, "COMMAND", None)
    app.command(_verb.NAME, cls=_kind, epilog=f"Example: {_verb.EXAMPLE}")(_verb.run)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"minorloop {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    pass


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; an error is one line on stderr and exit status 2.

    Parameters
    ----------
    arguments : sequence of str, optional
        What follows the name of the program; ``sys.argv`` if not given.

    Returns
    -------
    int
        The exit status: 0 for success, 2 for a refusal, 3 where a source may still be on, 130 for
        an interruption, 1 where the program that reads the output has ended, nothing in a fleet
        could be identified, or an identified model is not to be trusted.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by whoever started the program
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    if hasattr(sys.stdout, "reconfigure"):
        # A unit or a file name that the terminal cannot show must not end the program.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = int(app(given or ["--help"], prog_name="minorloop", standalone_mode=False) or 0)
        sys.stdout.flush()
    except SafetyError as error:
        _refuse(str(error))
        return _UNSAFE
    except MinorloopError as error:
        return _refuse(str(error))
    except _UsageError as error:
        return _refuse(_usage(error))
    except MemoryError:
        return _refuse("there is not enough memory for this; use fewer levels or fewer rows")
    except (BrokenPipeError, SystemExit):  # the parser makes the second of the first
        _drop_output()
        return _FAILED
    except OSError as error:
        _drop_output()
        return _refuse(f"something could not be read or written: {error}")
    except (typer.Abort, KeyboardInterrupt):
        status = _INTERRUPTED
    if status == _INTERRUPTED:
        print("interrupted", file=sys.stderr)
    return status


def _usage(error: Exception) -> str:
    """Return the message of the parser, and where to read more."""
    said = getattr(error, "format_message", error.__str__)()
    context = getattr(error, "ctx", None)
    return f"{said.rstrip('.')}; see {context.command_path if context else 'minorloop'} --help"


def _refuse(message: str) -> int:
    """Print one line on stderr, without characters that control a terminal."""
    line = " ".join(message.split())
    line = "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in line
    )
    if len(line) > _LONGEST:
        line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
    print(f"error: {line}", file=sys.stderr)
    return _REFUSED


def _drop_output() -> None:
    """Redirect a stdout that cannot be written, or the interpreter complains at exit."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

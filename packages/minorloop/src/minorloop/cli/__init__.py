"""The command line: one file for each verb. Slow imports wait until a verb runs."""

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from typing import Annotated, Any

import typer
import typer.main

from minorloop.cli import (
    _common,
    demo,
    devices,
    drive,
    export,
    fleet,
    frequency,
    identify,
    invert,
    lab,
    plan,
    reduce,
    resume,
    runs,
    score,
    simulate,
)
from minorloop.cli import run as run_verb
from minorloop.errors import MinorloopError, SafetyError
from minorloop.registry import loaded, registered
from minorloop.version import __version__

_FAILED = 1
_REFUSED = 2
_UNSAFE = 3
_INTERRUPTED = 130
_LONGEST = 800
"""Most characters of an error, about ten lines of a terminal; the middle of a longer one is cut."""
# The base class of the errors of the parser; typer exports subclasses only.
_UsageError: type[Exception] = typer.BadParameter.__mro__[2]

app = typer.Typer(
    help="Hysteresis of smart actuators: from measured data to precise positioning.",
    epilog="Start with: minorloop demo --out demo. Every command has its own --help.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
VERBS = "minorloop.verbs"
"""Entry points of verbs of other packages: modules like those of this folder, or with an ``app``
of several verbs."""
_VERBS = (
    *(reduce, identify, simulate, score, invert, plan, run_verb, drive, resume, runs, frequency),
    *(export, fleet, devices, lab, demo),
    *(loaded(point, name) for name, point in registered(VERBS).items()),
)
for _verb in _VERBS:
    if hasattr(_verb, "app"):
        app.add_typer(_verb.app, name=_verb.NAME)
    else:
        _kind = getattr(_verb, "COMMAND", None)
        app.command(_verb.NAME, cls=_kind, epilog=f"Example: {_verb.EXAMPLE}")(_verb.run)


def _print_version(given: bool) -> None:
    if given:
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


@cache
def _command() -> Any:
    """Return the parser of all verbs; it is built once even if a program runs several commands."""
    return typer.main.get_command(app)


def main(
    arguments: Sequence[str] | None = None,
    parser: Callable[[], Any] = _command,
    name: str = "minorloop",
) -> int:
    """Run a command line, by default that of the process, and return its exit status.

    An error is printed as one line on stderr and, with ``--json``, as one JSON object on stdout
    unless the result is already there. The status is 0 for success, 2 for a refusal, 3 if a source
    may still be on, 130 for an interruption, and 1 if the program that reads the output has ended,
    nothing in a fleet could be identified, or an identified model is not to be trusted.
    ``parser`` returns the parser of another program, and ``name`` is the name of that program.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    for stream in ("stdout", "stderr"):
        if getattr(sys, stream) is None:  # closed by whoever started the program
            setattr(sys, stream, open(os.devnull, "w"))  # noqa: SIM115
    if hasattr(sys.stdout, "reconfigure"):
        # A unit or a file name that the terminal cannot show must not end the program.
        sys.stdout.reconfigure(errors="backslashreplace")
    _common.expect_json("--json" in given)
    try:
        command = parser()
        status = int(command(given or ["--help"], prog_name=name, standalone_mode=False) or 0)
        sys.stdout.flush()
    except MinorloopError as error:
        _refuse(type(error).__name__, str(error))
        return _UNSAFE if isinstance(error, SafetyError) else _REFUSED
    except _UsageError as error:
        return _refuse("UsageError", _usage(error))
    except MemoryError:
        advice = "there is not enough memory for this; use fewer levels or fewer rows"
        return _refuse("MemoryError", advice)
    except BrokenPipeError:
        _drop_output()
        return _FAILED
    except SystemExit as end:  # of completion, or made by the parser of a BrokenPipeError
        if not end.code:
            return 0
        _drop_output()
        return _FAILED
    except OSError as error:
        _refuse("OSError", f"something could not be read or written: {error}")
        _drop_output()
        return _REFUSED
    except BaseException as error:
        if not isinstance(error, typer.Abort) and not _interrupted(error):
            raise
        status = _INTERRUPTED
    if status == _INTERRUPTED:  # the parser returns this too
        print("interrupted", file=sys.stderr)
        _print_error("Interrupted", "interrupted")
    return status


def _interrupted(error: BaseException | None) -> bool:
    """Whether an error was caused by an interruption, as in a compiler that was stopped."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _usage(error: Exception) -> str:
    """Return the message of the parser, and which help to read."""
    said = getattr(error, "format_message", error.__str__)()
    context = getattr(error, "ctx", None)
    if said.endswith("?"):
        return str(said)
    return f"{said.rstrip('.')}; see {context.command_path if context else 'minorloop'} --help"


def _refuse(kind: str, message: str) -> int:
    """Print an error as one line on stderr, without terminal control characters."""
    line = " ".join(message.split())
    line = "".join(letter if letter.isprintable() else "\ufffd" for letter in line)
    if len(line) > _LONGEST:
        line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
    print(f"error: {line}", file=sys.stderr)
    _print_error(kind, line)
    return _REFUSED


def _print_error(kind: str, message: str) -> None:
    """Print the error as JSON if JSON is still expected."""
    try:
        _common.print_missing_json({"error": {"kind": kind, "message": message}})
        sys.stdout.flush()
    except OSError:
        _drop_output()


def _drop_output() -> None:
    """Redirect a stdout that cannot be written, lest the interpreter print an error at exit."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

"""The errors of minorloop.

    MinorloopError
      ParameterError      (ValueError)   an option or a parameter of a model
      SignalError         (ValueError)   samples that cannot be used
      UnreachableError    (ValueError)   a target that the model cannot reach
      NotInvertibleError  (ValueError)   a model that has no inverse
      RecordError         (ValueError)   a measured record: columns, units, numbers
      ModelFileError      (ValueError)   a model file that is damaged or too new
      LimitError          (ValueError)   an input beyond what an actuator allows
      OutputError         (OSError)      a place that cannot be written
      StoreError          (OSError)      an experiment store that cannot be used
      InstrumentError     (OSError)      an instrument that answers late, wrongly or not at all
      SafetyError         (OSError)      a source that may still be on; an InstrumentError
      FleetError          (OSError)      workers or a scheduler of a fleet that are lost
      MissingExtraError   (ImportError)  an optional dependency that is not installed

A message says what is wrong, the value, the allowed range, and what to do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


class MinorloopError(Exception):
    """Root of the tree: catch it to catch all errors of minorloop."""


class ParameterError(MinorloopError, ValueError):
    """An option or a parameter of a model is out of its range."""


class SignalError(MinorloopError, ValueError):
    """Samples have a wrong shape, or are not finite, too few or constant."""


class UnreachableError(MinorloopError, ValueError):
    """A target lies beyond the outputs that the model can produce."""


class NotInvertibleError(MinorloopError, ValueError):
    """The model is not monotone, so a right inverse does not exist."""


class RecordError(MinorloopError, ValueError):
    """A measured record has a missing column, text among numbers, or no rows."""


class ModelFileError(MinorloopError, ValueError):
    """A model file is damaged, inconsistent, or written by a newer version."""


class LimitError(MinorloopError, ValueError):
    """An input is beyond the limits of an actuator; it was refused, not clipped."""


class OutputError(MinorloopError, OSError):
    """A file or folder cannot be written."""


class StoreError(MinorloopError, OSError):
    """An experiment store is missing, damaged, in use, or belongs to another run."""


class InstrumentError(MinorloopError, OSError):
    """An instrument answers late, wrongly or not at all; the actuator was made safe."""


class SafetyError(InstrumentError):
    """A source did not confirm that it is off; it may still be on."""


class FleetError(MinorloopError, OSError):
    """The workers or the scheduler of a fleet are lost; finished results are kept."""


class MissingExtraError(MinorloopError, ImportError):
    """An optional dependency is not installed.

    ``package``: the package that could not be imported; ``extra``: the extra of minorloop that
    installs it.
    """

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(f"{package} is not installed; pip install 'minorloop[{extra}]' brings it")


def counted(count: int, noun: str) -> str:
    """Return a count with its noun, such as ``1 gap`` or ``2 gaps``."""
    return f"{count} {noun}{'s' * (count != 1)}"


def are(count: int) -> str:
    """Return the verb that a count needs: ``is`` for one, ``are`` otherwise."""
    return "is" if count == 1 else "are"


def all_done(steps: Iterable[Callable[[], object]]) -> None:
    """Do every step, even if an earlier one fails; then raise the first error."""
    first: Exception | None = None
    for step in steps:
        try:
            step()
        except Exception as error:
            first = first or error
    if first is not None:
        raise first

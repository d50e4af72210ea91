"""Instruments through PyVISA: SCPI and similar commands in lines of text.

A device of the driver ``visa`` has ``resource``, ``library``, ``timeout`` and ``baud``; its sources
have the commands of `Commands`, its sensors ``read``. A digital line has the commands ``on`` and
``off``, and may have a question, ``ask``, with the answers ``is_on`` and ``is_off``.

After each input the source gets the questions ``confirm`` and ``errors``. If neither is given, it
gets ``done``, to which any answer is right. After ``safe`` it gets the same questions, but the
answer to ``confirm`` must be ``rest``. ``safe_query``, whose answer must be ``safe_answer``,
replaces ``confirm`` then. ``"done": null`` is for a source without answers.
"""

import math
import re
import warnings
from collections.abc import Mapping
from functools import partial
from string import Formatter

import msgspec
import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, ParameterError, all_done
from minorloop.lab.actuator import SIX_DIGITS
from minorloop.lab.drivers.bench_file import open_bench as open_bench
from minorloop.lab.drivers.device import DevicePlan, PlannedDevice, Section
from minorloop.lab.drivers.link import Link, LinkSettings, number, opened

NEEDS = "pyvisa", "instruments"
"""Library of the driver, and the extra that installs it."""

_UNANSWERED = (
    "{} answers nothing, so it cannot confirm that it is safe; check it at the end of the run, or "
    "give confirm, errors, safe_query or done"
)
_NO_ERROR = re.compile(r"[+-]?0+(?=[ \t,]|$)", re.ASCII)


class Commands(Section, kw_only=True):
    """Lines of text that a source understands.

    Raises a `ValueError` if there is no command that makes it safe, or ``set`` does not contain the
    number.

    Parameters
    ----------
    safe : list of str
        Commands that make it safe: ``VOLT 0``, ``OUTP OFF``.
    set : str
        Command that sets the input, with the number in braces: ``VOLT {:.9g}``. An input that it
        rounds by more than 5e-6 of the range is refused, because the record would be wrong.
    on : list of str
        Commands sent once, before the first input: the range, the current limit, output on.
    confirm : str, optional
        Query for the present input: ``VOLT?``. The answer must equal the input within
        ``tolerance``.
    tolerance : float
        Largest difference of the answer, in the unit of the input.
    errors : str, optional
        Query for errors, ``SYST:ERR?``, after each input. An answer that does not begin with the
        number 0 is an error.
    safe_query : str, optional
        Query after ``safe`` instead of ``confirm``, such as ``OUTP?``.
    safe_answer : str, optional
        Required answer to it, such as ``0``; after ``on`` the answer must differ.
    done : str or None
        Query if neither ``confirm`` nor ``errors`` is given; any answer shows that the lines before
        are done. None if the instrument does not answer it.
    """

    safe: list[str]
    set: str = "VOLT {:.9g}"
    on: list[str] = msgspec.field(default_factory=list)
    confirm: str | None = None
    tolerance: float = 1e-3
    errors: str | None = None
    safe_query: str | None = None
    safe_answer: str | None = None
    done: str | None = "*OPC?"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.safe:
            raise ValueError("there is no command that makes the source safe; give safe")
        try:
            different = self.set.format(1.0) != self.set.format(2.0)
        except (ValueError, IndexError, KeyError, AttributeError) as error:
            raise ValueError(f"set is {self.set!r}, which has no number: {error}") from None
        if not different:
            raise ValueError(f"set is {self.set!r}, which has no number; write VOLT {{:.9g}}")
        if (self.safe_query is None) != (self.safe_answer is None):
            raise ValueError(
                f"safe_query is {self.safe_query!r} and safe_answer is {self.safe_answer!r}; give "
                "both or neither"
            )
        self.numbers(1.0)

    @property
    def answers(self) -> bool:
        """Whether the instrument can confirm that it is safe."""
        queries = self.safe_query, self.confirm, self.errors, self.done
        return any(query is not None for query in queries)

    def numbers(self, value: float) -> list[float]:
        """Return the numbers in the command for an input.

        Raises a `ValueError` if it does not write a plain number.
        """
        found = []
        for _, name, spec, conversion in Formatter().parse(self.set):
            if name is not None:
                field = f"{{{name}{f'!{conversion}' if conversion else ''}:{spec}}}"
                try:
                    found.append(float(field.format(value)))
                except ValueError:
                    raise ValueError(
                        f"set is {self.set!r}, which writes {field.format(value)!r} for "
                        f"{value:g}; write VOLT {{:.9g}}"
                    ) from None
        return found


class _Query(Section, kw_only=True):
    read: str = "READ?"


class _LineCommands(Section, kw_only=True):
    on: str
    off: str
    ask: str | None = None
    is_on: str = "1"
    is_off: str = "0"


class ScpiSource:
    """Sets an input by a line of text.

    ``link``: the line to the instrument; ``rest``: answer to ``confirm`` when the source is safe;
    ``span``: width of the range of the input, in its unit; by default the size of each input.
    """

    def __init__(
        self, link: Link, commands: Commands, *, rest: float = 0.0, span: float | None = None
    ) -> None:
        self._link, self._commands, self._rest, self._span = link, commands, rest, span
        alone = commands.confirm is None and commands.errors is None
        self._done = commands.done if alone else None
        self._is_on = False

    def set(self, value: float) -> None:
        """Apply an input.

        Raises an `InstrumentError` if the instrument does not take it, or answers another input; a
        `ParameterError` if the command would contain another number, and nothing is sent then.
        """
        if not math.isfinite(value):
            raise InstrumentError(f"{value} is not a valid input; nothing was sent")
        how = self._commands
        width = abs(value) if self._span is None else self._span
        if any(abs(said - value) > SIX_DIGITS * width for said in how.numbers(value)):
            raise ParameterError(
                f"{how.set!r} makes {how.set.format(value)!r} of {value:.9g}, which is another "
                "input; write more digits, such as {:.9g}, or give inputs that need fewer"
            )
        self._link.send(how.set.format(value))
        if not self._is_on:
            self._switch_on()
        if how.confirm is not None:
            found = number(self._link.ask(how.confirm), self._link.name)
            if not abs(found - value) <= how.tolerance:  # also refuses NaN
                raise InstrumentError(
                    f"{self._link.name} was set to {value:g} and answers {found:g}; check its range"
                )
        if how.errors is not None:
            answer = self._link.ask(how.errors)
            if _NO_ERROR.match(answer) is None:
                raise InstrumentError(f"{self._link.name} reports {answer[:100]!r}")
        if self._done is not None:
            self._link.ask(self._done)

    def _switch_on(self) -> None:
        how = self._commands
        for line in how.on:
            self._link.send(line)
        asked = how.safe_query if how.on else None
        if asked is not None and self._link.ask(asked) == how.safe_answer:
            raise InstrumentError(
                f"{self._link.name} was switched on and answers {how.safe_answer!r} to "
                f"{asked!r}, as when it is safe"
            )
        self._is_on = True

    def safe(self) -> None:
        """Send all commands that make it safe, even if one fails, and ask whether it is safe.

        An instrument executes one line after the other, so an answer shows that the earlier lines
        are done. For each earlier answer that missed its deadline, the question is repeated, so
        that a late answer does not count for this question.

        Raises the first error, or an `InstrumentError` if the answer is not as required.
        """
        try:
            all_done(partial(self._link.send, line) for line in self._commands.safe)
        finally:
            self._is_on = False
        for _ in range(1 + getattr(self._link, "owed", 0)):
            self._ask_if_safe()

    def _ask_if_safe(self) -> None:
        how = self._commands
        if how.safe_query is not None:
            found = self._link.ask(how.safe_query)
            if found != how.safe_answer:
                raise InstrumentError(
                    f"{self._link.name} was made safe and answers {found[:80]!r} to "
                    f"{how.safe_query!r}, not {how.safe_answer!r}"
                )
        elif how.confirm is not None:
            value = number(self._link.ask(how.confirm), self._link.name)
            if not abs(value - self._rest) <= how.tolerance:
                raise InstrumentError(
                    f"{self._link.name} was made safe and answers {value:g} to {how.confirm!r}, "
                    f"not rest, {self._rest:g}; let safe set rest too, or give safe_query and "
                    "safe_answer"
                )
        if how.errors is not None:
            self._ask_for_errors(how.errors)
        if self._done is not None:
            self._link.ask(self._done)

    def _ask_for_errors(self, query: str) -> None:
        """Empty the queue of errors; raise the first, which may be older than this command."""
        first = found = self._link.ask(query)
        for _ in range(30):  # most errors in the queue of an instrument
            if _NO_ERROR.match(found) is not None:
                break
            found = self._link.ask(query)
        if _NO_ERROR.match(first) is None:
            raise InstrumentError(
                f"{self._link.name} reports {first[:100]!r} after it was made safe"
            )

    def written(self, value: float) -> float:
        """Return the input that the command contains for ``value``; nothing is sent."""
        return self._commands.numbers(value)[0]


class ScpiMeter:
    """Reads an output by a query.

    ``link``: the line to the instrument; ``query``: query for a reading.
    """

    def __init__(self, link: Link, query: str = "READ?") -> None:
        self._link, self._query = link, query

    def read(self) -> float:
        """Return the reading now.

        Raises an `InstrumentError` if there is no answer in time, or it is not a number.
        """
        return number(self._link.ask(self._query), self._link.name)


class VisaDevice(PlannedDevice):
    """An instrument with several channels, each with its own commands."""

    settings, source, sensor, line = LinkSettings, Commands, _Query, _LineCommands

    def __init__(self, plan: DevicePlan) -> None:
        super().__init__(plan)
        self._link = opened(self._how, plan.folder)
        self._link.last_lines = tuple(line for each in self._sources for line in each.safe)
        self.name = self._link.name
        self._setters = [
            ScpiSource(self._link, how, rest=wire.rest, span=wire.high - wire.low)
            for wire, how in zip(plan.sources, self._sources, strict=True)
        ]
        self._meters = [ScpiMeter(self._link, each.read) for each in self._sensors]
        silent = [each for each in self._sources if not each.answers]
        self.warnings = [_UNANSWERED.format(self.name)] if silent else []

    def set(self, values: FloatArray) -> None:
        """Set all sources, one after the other."""
        for source, value in zip(self._setters, values.tolist(), strict=True):
            source.set(value)

    def written(self, value: float) -> float:
        """Return the input that the command of the first source contains; nothing is sent."""
        return self._setters[0].written(value)

    def read(self) -> FloatArray:
        """Return the readings of all meters."""
        return np.array([meter.read() for meter in self._meters])

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch lines on or off."""
        for place, on in values.items():
            line = self._lines[place]
            self._link.send(line.on if on else line.off)
            wanted = line.is_on if on else line.is_off
            if line.ask is not None and (answer := self._link.ask(line.ask)) != wanted:
                raise InstrumentError(
                    f"{self.name} answers {answer[:80]!r} to {line.ask!r}, not {wanted!r}"
                )

    def safe(self) -> None:
        """Make all sources safe, and set the lines to rest."""
        lines = self._plan.resting_lines
        all_done([*(source.safe for source in self._setters), lambda: self.switch(lines)])

    def close(self) -> None:
        """Close the connection."""
        self._link.close()


open_device = VisaDevice


def found() -> list[str]:
    """Return the resources that PyVISA-py finds, without serial ports: USB, GPIB and network."""
    try:
        import pyvisa

        with warnings.catch_warnings():  # of libraries for a kind of connection that are missing
            warnings.simplefilter("ignore")
            found = pyvisa.ResourceManager("@py").list_resources()
    except Exception:  # each backend has its own errors
        return []
    return [str(each) for each in found if not str(each).startswith("ASRL")]

"""A source and a meter for SCPI and similar commands in lines of text."""

import math
import re
from collections.abc import Sequence
from string import Formatter

from minorloop.errors import InstrumentError, ParameterError
from minorloop.lab.actuator import SIX_DIGITS
from minorloop.lab.drivers.link import Link

__all__ = ["ScpiMeter", "ScpiSource"]

_MOST_ERRORS = 30
"""Most errors in the queue of an instrument."""
_NO_ERROR = re.compile(r"[+-]?0+(?=[ \t,]|$)", re.ASCII)


class ScpiSource:
    """Sets an input by a line of text.

    Parameters
    ----------
    link : Link
        The line to the instrument.
    set : str
        Command that sets the input, with the number in braces: ``VOLT {:.9g}``. An input that it
        rounds by more than 5e-6 of ``span`` is refused, because the record would be wrong.
    on : sequence of str
        Commands sent once, before the first input: the range, the current limit, output on.
    safe : sequence of str
        Commands that make it safe: ``VOLT 0``, ``OUTP OFF``.
    confirm : str, optional
        Query for the present input: ``VOLT?``. The answer must equal the input within
        ``tolerance``.
    tolerance : float
        In the unit of the input.
    errors : str, optional
        Query for errors, ``SYST:ERR?``, after each input. An answer that does not begin with the
        number 0 is an error.
    rest : float
        Answer to ``confirm`` when the source is safe.
    safe_query : str, optional
        Query after ``safe`` instead of ``confirm``, such as ``OUTP?``.
    safe_answer : str, optional
        Required answer to it, such as ``0``; after ``on`` the answer must differ.
    done : str or None
        Query if neither ``confirm`` nor ``errors`` is given; any answer shows that the lines before
        are done. None if the instrument does not answer it.
    span : float, optional
        Width of the range of the input, in its unit; the size of each input if not given.

    Raises
    ------
    ParameterError
        If there is no command that makes it safe, or ``set`` does not contain the number.
    """

    def __init__(
        self,
        link: Link,
        *,
        set: str = "VOLT {:.9g}",
        on: Sequence[str] = (),
        safe: Sequence[str] = ("VOLT 0", "OUTP OFF"),
        confirm: str | None = None,
        tolerance: float = 1e-3,
        errors: str | None = None,
        span: float | None = None,
        rest: float = 0.0,
        safe_query: str | None = None,
        safe_answer: str | None = None,
        done: str | None = "*OPC?",
    ) -> None:
        if not safe:
            raise ParameterError("there is no command that makes the source safe; give safe")
        try:
            different = set.format(1.0) != set.format(2.0)
        except (ValueError, IndexError, KeyError, AttributeError) as error:
            raise ParameterError(f"set is {set!r}, which has no number: {error}") from None
        if not different:
            raise ParameterError(f"set is {set!r}, which has no number; write VOLT {{:.9g}}")
        if (safe_query is None) != (safe_answer is None):
            raise ParameterError(
                f"safe_query is {safe_query!r} and safe_answer is {safe_answer!r}; give both or "
                "neither"
            )
        self._link, self._set, self._span = link, set, span
        self._numbers(1.0)
        self._on, self._safe = tuple(on), tuple(safe)
        self._confirm, self._tolerance, self._errors = confirm, tolerance, errors
        self._rest, self._safe_query, self._safe_answer = rest, safe_query, safe_answer
        self._done = done if confirm is None and errors is None else None
        self._is_on = False

    @property
    def answers(self) -> bool:
        """Whether the instrument can confirm that it is safe."""
        queries = self._safe_query, self._confirm, self._errors, self._done
        return any(query is not None for query in queries)

    def set(self, value: float) -> None:
        """Apply an input.

        Raises
        ------
        InstrumentError
            If the instrument does not take it, or answers another input.
        ParameterError
            If the command would contain another number; nothing is sent then.
        """
        if not math.isfinite(value):
            raise InstrumentError(f"{value} is not a valid input; nothing was sent")
        said = self._numbers(value)
        width = abs(value) if self._span is None else self._span
        if any(abs(number - value) > SIX_DIGITS * width for number in said):
            raise ParameterError(
                f"{self._set!r} makes {self._set.format(value)!r} of {value:.9g}, which is another "
                "input; write more digits, such as {:.9g}, or give inputs that need fewer"
            )
        self._link.send(self._set.format(value))
        if not self._is_on:
            self._switch_on()
        if self._confirm is not None:
            found = number(self._link.ask(self._confirm), self._link.name)
            if not abs(found - value) <= self._tolerance:  # also refuses NaN
                raise InstrumentError(
                    f"{self._link.name} was set to {value:g} and answers {found:g}; check its range"
                )
        if self._errors is not None:
            answer = self._link.ask(self._errors)
            if _NO_ERROR.match(answer) is None:
                raise InstrumentError(f"{self._link.name} reports {answer[:100]!r}")
        if self._done is not None:
            self._link.ask(self._done)

    def _switch_on(self) -> None:
        for line in self._on:
            self._link.send(line)
        asked = self._safe_query if self._on else None
        if asked is not None and self._link.ask(asked) == self._safe_answer:
            raise InstrumentError(
                f"{self._link.name} was switched on and answers {self._safe_answer!r} to "
                f"{asked!r}, as when it is safe"
            )
        self._is_on = True

    def safe(self) -> None:
        """Send all commands that make it safe, even if one fails, and ask whether it is safe.

        An instrument executes one line after the other, so an answer shows that the lines before
        are done. If earlier answers missed their deadline, the question is repeated as often, so
        that a late answer does not count for this question.

        Raises
        ------
        InstrumentError
            The first error, or if the answer is not as required.
        """
        first: InstrumentError | None = None
        for line in self._safe:
            try:
                self._link.send(line)
            except InstrumentError as error:
                first = first or error
        self._is_on = False
        if first is not None:
            raise first
        for _ in range(1 + getattr(self._link, "owed", 0)):
            self._ask_if_safe()

    def _ask_if_safe(self) -> None:
        if self._safe_query is not None:
            found = self._link.ask(self._safe_query)
            if found != self._safe_answer:
                raise InstrumentError(
                    f"{self._link.name} was made safe and answers {found[:80]!r} to "
                    f"{self._safe_query!r}, not {self._safe_answer!r}"
                )
        elif self._confirm is not None:
            value = number(self._link.ask(self._confirm), self._link.name)
            if not abs(value - self._rest) <= self._tolerance:
                raise InstrumentError(
                    f"{self._link.name} was made safe and answers {value:g} to {self._confirm!r}, "
                    f"not rest, {self._rest:g}; let safe set rest too, or give safe_query and "
                    "safe_answer"
                )
        if self._errors is not None:
            self._ask_for_errors(self._errors)
        if self._done is not None:
            self._link.ask(self._done)

    def _ask_for_errors(self, query: str) -> None:
        """Empty the queue of errors; raise the first, which may be older than this command."""
        first = found = self._link.ask(query)
        for _ in range(_MOST_ERRORS):
            if _NO_ERROR.match(found) is not None:
                break
            found = self._link.ask(query)
        if _NO_ERROR.match(first) is None:
            raise InstrumentError(
                f"{self._link.name} reports {first[:100]!r} after it was made safe"
            )

    def written(self, value: float) -> float:
        """Return the input that the command contains for ``value``; nothing is sent."""
        return self._numbers(value)[0]

    def _numbers(self, value: float) -> list[float]:
        """Return the numbers in the command for an input."""
        found = []
        for _, name, spec, conversion in Formatter().parse(self._set):
            if name is not None:
                field = f"{{{name}{f'!{conversion}' if conversion else ''}:{spec}}}"
                try:
                    found.append(float(field.format(value)))
                except ValueError:
                    raise ParameterError(
                        f"set is {self._set!r}, which writes {field.format(value)!r} for "
                        f"{value:g}; write VOLT {{:.9g}}"
                    ) from None
        return found


class ScpiMeter:
    """Reads an output by a query.

    Parameters
    ----------
    link : Link
        The line to the instrument.
    read : str
        Query for a reading.
    scale, zero : float
        The output is ``scale * (reading - zero)``.

    Raises
    ------
    ParameterError
        If they are not finite, or the scale is 0.
    """

    def __init__(
        self, link: Link, *, read: str = "READ?", scale: float = 1.0, zero: float = 0.0
    ) -> None:
        if not math.isfinite(scale) or scale == 0:
            raise ParameterError(
                f"scale is {scale!r}; give the change of the output for one unit of the reading, a "
                "finite number that is not 0"
            )
        if not math.isfinite(zero):
            raise ParameterError(f"zero is {zero!r}; give the reading at an output of 0")
        self._link, self._read = link, read
        self._scale, self._zero = scale, zero

    def read(self) -> float:
        """Return the output now.

        Raises
        ------
        InstrumentError
            If there is no answer in time, or it is not a number.
        """
        reading = number(self._link.ask(self._read), self._link.name)
        return self._scale * (reading - self._zero)


def number(answer: str, name: str) -> float:
    """Return the number in an answer.

    Raises an `InstrumentError` if it is not exactly one number.
    """
    try:
        if "_" in answer or not answer.isascii():
            raise ValueError
        return float(answer)
    except ValueError:
        raise InstrumentError(f"{name} answers {answer[:80]!r}, which is not a number") from None

"""A source and a meter that speak SCPI, or any other line that can be written down."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from string import Formatter

from minorloop.errors import InstrumentError, ParameterError
from minorloop.lab.drivers.link import Link

__all__ = ["ScpiMeter", "ScpiSource"]

_ROUNDED = 5e-6
"""Share of the range by which six digits may miss an input."""
_MOST_ERRORS = 30
"""Errors that an instrument keeps, at most."""
_NO_ERROR = re.compile(r"[+-]?0+(?=[ \t,]|$)", re.ASCII)


class ScpiSource:
    """Sets an input by a line of text.

    Parameters
    ----------
    link : Link
        The line to the instrument.
    set : str
        What sets the input, with the number in braces: ``VOLT {:.9g}``. An input that it rounds
        by more than 5e-6 of ``span`` is refused, for it would be recorded as another.
    on : sequence of str
        What to send once, before the first input: the range, the current limit, output on.
    safe : sequence of str
        What to send to make it safe: ``VOLT 0``, ``OUTP OFF``.
    confirm : str, optional
        What asks for the input that is set: ``VOLT?``. What comes back has to be the input to
        within ``tolerance``.
    tolerance : float
        In the unit of the input.
    errors : str, optional
        What asks for an error, ``SYST:ERR?``, after each input; an answer that does not begin
        with the number 0 is one.
    rest : float
        What ``confirm`` says when the source is safe.
    safe_query : str, optional
        What is asked after ``safe`` instead of ``confirm``, such as ``OUTP?``.
    safe_answer : str, optional
        What has to come back then, such as ``0``, and may not come back after ``on``.
    done : str or None
        What is asked where neither ``confirm`` nor ``errors`` is given; any answer says that the
        lines before are done. None where the instrument answers no such thing.
    span : float, optional
        Width of the range of the input, in its unit; the size of each input if not given.

    Raises
    ------
    ParameterError
        If there is no line that makes it safe, or ``set`` does not write a number as one.
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
            raise ParameterError("there is no line that makes the source safe; give some")
        try:
            different = set.format(1.0) != set.format(2.0)
        except (ValueError, IndexError, KeyError, AttributeError) as error:
            raise ParameterError(f"set is {set!r}, which takes no number: {error}") from None
        if not different:
            raise ParameterError(f"set is {set!r}, which takes no number; write VOLT {{:.9g}}")
        if (safe_query is None) != (safe_answer is None):
            raise ParameterError(
                f"safe_query is {safe_query!r} and safe_answer is {safe_answer!r}; give both or "
                "neither"
            )
        self._link, self._set, self._span = link, set, span
        self._written(1.0)
        self._on, self._safe = tuple(on), tuple(safe)
        self._confirm, self._tolerance, self._errors = confirm, tolerance, errors
        self._rest, self._safe_query, self._safe_answer = rest, safe_query, safe_answer
        self._done = done if confirm is None and errors is None else None
        self._is_on = False

    @property
    def answers(self) -> bool:
        """Whether it can be asked if it is safe."""
        queries = self._safe_query, self._confirm, self._errors, self._done
        return any(query is not None for query in queries)

    def set(self, value: float) -> None:
        """Put an input on.

        Raises
        ------
        InstrumentError
            If the instrument does not take it, or says that another input is on.
        ParameterError
            If the line that sets it would say another number; nothing is sent then.
        """
        if not math.isfinite(value):
            raise InstrumentError(f"{value} is no input; nothing was sent")
        said = self._written(value)
        width = abs(value) if self._span is None else self._span
        if any(abs(number - value) > _ROUNDED * width for number in said):
            raise ParameterError(
                f"{self._set!r} makes {self._set.format(value)!r} of {value:.9g}, which is another "
                "input; write more digits, such as {:.9g}, or give inputs that need fewer"
            )
        self._link.tell(self._set.format(value))
        if not self._is_on:
            self._switch_on()
        if self._confirm is not None:
            found = number(self._link.ask(self._confirm), self._link.name)
            if not abs(found - value) <= self._tolerance:  # not a number is not the input either
                raise InstrumentError(
                    f"{self._link.name} was told {value:g} and says {found:g}; check its range"
                )
        if self._errors is not None:
            answer = self._link.ask(self._errors)
            if _NO_ERROR.match(answer) is None:
                raise InstrumentError(f"{self._link.name} reports {answer[:100]!r}")
        if self._done is not None:
            self._link.ask(self._done)

    def _switch_on(self) -> None:
        for line in self._on:
            self._link.tell(line)
        asked = self._safe_query if self._on else None
        if asked is not None and self._link.ask(asked) == self._safe_answer:
            raise InstrumentError(
                f"{self._link.name} was switched on and answers {self._safe_answer!r} to "
                f"{asked!r}, as when it is safe"
            )
        self._is_on = True

    def safe(self) -> None:
        """Send all that makes it safe, whatever becomes of each line, and ask whether it is.

        An instrument does one line after the other, so an answer says that it has done those
        before. Where answers were given up, that many more are asked for: one that comes late is
        not taken for this one.

        Raises
        ------
        InstrumentError
            The first error, or if it does not answer as it should.
        """
        first: InstrumentError | None = None
        for line in self._safe:
            try:
                self._link.tell(line)
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
                    f"{self._link.name} was made safe and says {value:g} to {self._confirm!r}, not "
                    f"{self._rest:g}, which is rest; let safe set that too, or give safe_query and "
                    "safe_answer"
                )
        if self._errors is not None:
            self._ask_for_errors(self._errors)
        if self._done is not None:
            self._link.ask(self._done)

    def _ask_for_errors(self, query: str) -> None:
        """Empty the queue of errors; raise the first, which may be one of the lines before."""
        first = found = self._link.ask(query)
        for _ in range(_MOST_ERRORS):
            if _NO_ERROR.match(found) is not None:
                break
            found = self._link.ask(query)
        if _NO_ERROR.match(first) is None:
            raise InstrumentError(
                f"{self._link.name} reports {first[:100]!r} after it was made safe"
            )

    def _written(self, value: float) -> list[float]:
        """The numbers that the line says for an input."""
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
    """Reads an output by a line of text.

    Parameters
    ----------
    link : Link
        The line to the instrument.
    read : str
        What asks for a reading.
    scale, zero : float
        The output is ``scale * (reading - zero)``.

    Raises
    ------
    ParameterError
        If they are no finite numbers, or the scale is 0.
    """

    def __init__(
        self, link: Link, *, read: str = "READ?", scale: float = 1.0, zero: float = 0.0
    ) -> None:
        if not math.isfinite(scale) or scale == 0:
            raise ParameterError(
                f"scale is {scale!r}, with which no reading says anything; give how much of the "
                "output one unit of the reading is"
            )
        if not math.isfinite(zero):
            raise ParameterError(f"zero is {zero!r}; give the reading at an output of 0")
        self._link, self._read = link, read
        self._scale, self._zero = scale, zero

    def read(self) -> float:
        """The output now.

        Raises
        ------
        InstrumentError
            If there is no answer in time, or it is not one number.
        """
        reading = number(self._link.ask(self._read), self._link.name)
        return self._scale * (reading - self._zero)


def number(answer: str, name: str) -> float:
    """The one number that an answer is.

    Raises
    ------
    InstrumentError
        If it is anything else.
    """
    try:
        if "_" in answer or not answer.isascii():
            raise ValueError
        return float(answer)
    except ValueError:
        raise InstrumentError(f"{name} answers {answer[:80]!r}, which is no number") from None

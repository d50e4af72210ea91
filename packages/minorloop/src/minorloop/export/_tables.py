"""Numbers and tables in C, and the templates that they are written into."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.errors import ParameterError

_COARSEST = 0.01
"""Largest effect of rounding, as a share of a range. A choice: a larger effect would be a large
part of the error of a good model."""
DIGITS, DIGITS_LINEAR = 8, 32
"""Errors allowed in units of the last digit of inputs and of outputs. A choice: a few operations
round between them, and those of the recursion of a linear part add up."""


@dataclass(frozen=True)
class Numbers:
    """Format of numbers of one type in C."""

    single: bool
    """Whether they are ``float``; ``double`` otherwise."""

    @property
    def type(self) -> str:
        """Name of the type in C."""
        return "float" if self.single else "double"

    @property
    def size(self) -> int:
        """Bytes of one number."""
        return 4 if self.single else 8

    @property
    def _doubles(self) -> str:
        return "export doubles, or " if self.single else ""

    def array(self, values: npt.ArrayLike) -> npt.NDArray[Any]:
        """Return numbers rounded to the type.

        Raises a `ParameterError` if a number is too large for it.
        """
        wide = np.asarray(values, dtype=np.float64)
        if self.single and (np.abs(wide) > np.finfo(np.float32).max).any():
            raise ParameterError(
                f"the model holds {np.abs(wide).max():g}, more than a float can; export doubles"
            )
        return wide.astype(np.float32 if self.single else np.float64)

    def check_range(self, what: str, values: npt.ArrayLike) -> None:
        """Refuse ranges whose squares or ratios the type cannot hold.

        Raises a `ParameterError` if the range is too large or too small.
        """
        low, high = float(np.min(values)), float(np.max(values))
        # Largest range of a signal, and reciprocal of the least, by the type of the C: their
        # squares are below 1e38 and 1e308, the largest numbers of these types
        most = 1e15 if self.single else 1e150
        if high / 2 - low / 2 > most / 2 or 0 < high - low < 1 / most:
            raise ParameterError(
                f"the {what} goes from {low:g} to {high:g}, and C with a {self.type} can have "
                f"ranges from {1 / most:g} to {most:g}; {self._doubles}identify in another unit"
            )

    def check_distinct(self, levels: npt.ArrayLike) -> npt.NDArray[Any]:
        """Return levels rounded to the type.

        Raises a `ParameterError` if two of them are then equal.
        """
        rounded, exact = self.array(levels), np.asarray(levels)
        if not (np.diff(rounded) > 0).all():
            raise ParameterError(
                f"levels are only {np.diff(exact).min():g} apart around {np.abs(exact).max():g}, "
                "which a float cannot distinguish; export doubles"
            )
        return rounded

    def digit(
        self, largest: float, effect: float, of: str, advice: str, digits: int = DIGITS
    ) -> float:
        """Return the error allowed for the last digits of a number.

        Raises a `ParameterError` if it is too large a share of a range.

        ``largest``: the number; ``effect``: effect of its last digit, as a share of a range;
        ``of``: description of the effect, which is ``{:.2g} %`` in it; ``advice``: a remedy other
        than doubles; ``digits``: allowed error in last digits.
        """
        if digits * effect > _COARSEST:
            raise ParameterError(
                f"the last digit of a {self.type} near {largest:g} {of.format(100 * effect)}, and "
                f"{100 * _COARSEST / digits:.2g} % are allowed; {self._doubles}{advice}"
            )
        return digits * effect

    def one(self, value: float) -> str:
        """Return a literal of exactly this number, in brackets if it is negative."""
        number = self.array(value)
        text = f"{float(number):.9g}" if self.single else repr(float(number))
        if not set(text) & {".", "e"}:
            text += ".0"
        text += "f" if self.single else ""
        return f"({text})" if text.startswith("-") else text

    def table(self, values: Iterable[float]) -> str:
        """Return the content of an initialiser."""
        return wrapped(self.one(value).strip("()") for value in values)


def wrapped(words: Iterable[str]) -> str:
    """Return words with commas, in lines of bounded length."""
    lines, line = [], ""
    for word in words:
        # Longest line of a table
        if line and len(line) + len(word) + 2 > 96:
            lines.append(line)
            line = ""
        line += f"{word}, " if line else f"    {word}, "
    return "\n".join(text.rstrip() for text in [*lines, line])


def text_only(words: Mapping[str, str]) -> dict[str, str]:
    """Return texts that are safe in a comment in C."""
    return {
        name: " ".join("".join(c if c.isprintable() else " " for c in text).split())
        .replace("*/", "* /")
        .replace("/*", "/ *")
        for name, text in words.items()
    }


@cache
def _environment(package: str) -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader(package),
        undefined=StrictUndefined,
        autoescape=False,
        keep_trailing_newline=True,
    )


def render(template: str, context: dict[str, Any], package: str = "minorloop.export") -> str:
    """Return the text of a file from a template in the package's folder ``templates``."""
    return str(_environment(package).get_template(template).render(context))

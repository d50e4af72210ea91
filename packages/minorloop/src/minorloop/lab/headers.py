"""Headers of columns: names with units."""

import difflib
import re
from collections.abc import Container, Sequence
from pathlib import Path

from minorloop.errors import RecordError
from minorloop.files import check_name

_UNITS = """
s ms us µs μs ns min h d V mV uV µV kV A mA uA µA nA m cm mm um µm nm 1/m Hz kHz MHz N mN uN µN kN
Pa kPa MPa bar mbar T mT uT µT G Oe kOe A/m kA/m emu Am2 K mK C °C degC F deg ° rad mrad W mW
J mJ Ohm ohm Ω kg g mg % ppm dB a.u. arb. counts
"""
UNITS = frozenset(_UNITS.split())
"""Units that are recognised in a row of units, and in round brackets."""
_ENDINGS = {"V", "s"} | {unit for unit in UNITS if len(unit) > 1 and unit != "min"}
"""Units that are recognised after an underscore, where one letter may be a label."""


def split_header(header: str) -> tuple[str, str]:
    """Return name and unit of a header such as ``voltage [V]``; an absent unit is empty.

    Round brackets, and the end of a name such as ``voltage_mV``, count if they are a known unit.
    """
    match = re.fullmatch(r"\s*(.*?)\s*\[([^\[\]]*)\]\s*", header)
    if match and match[1]:
        return match[1], match[2].strip()
    match = re.fullmatch(r"\s*(.*?)\s*\(([^()]*)\)\s*", header)
    if match and match[1] and match[2].strip() in UNITS:
        return match[1], match[2].strip()
    return split_ending(header.strip(), _ENDINGS)


def split_ending(name: str, units: Container[str]) -> tuple[str, str]:
    """Return a name and the unit after its last underscore, if that is one of some units."""
    stem, _, end = name.rpartition("_")
    return (stem, end) if stem.strip("_") and end in units else (name, "")


def find_column(name: str, headers: Sequence[str], *, source: object) -> str:
    """Return the header with a name, which is the whole header, or its part before the unit.

    A name may have a unit, such as ``distance [mm]``, if the header has none.

    Raises a `RecordError` if no header or several headers match.

    ``name``: the name; ``headers``: headers of a table; ``source``: the table, for messages.
    """
    check_name("the column", name, RecordError)
    if name in headers:
        return name
    matches = [header for header in headers if name.strip() in (header, split_header(header)[0])]
    if not matches:  # the unit is given with the name; the header has none, or writes it otherwise
        given = split_header(name)
        matches = [header for header in headers if split_header(header) in (given, (given[0], ""))]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise RecordError(f"column '{name}' of {source} could be any of {_listed(matches)}")
    bare = {split_header(header)[0]: header for header in headers}
    known = {text.casefold(): header for text, header in bare.items()} | {
        header.casefold(): header for header in headers
    }
    close = difflib.get_close_matches(name.casefold(), list(known), n=1)
    hint = f"; did you mean '{known[close[0]]}'?" if close else "; name one of these"
    raise RecordError(f"{source} has no column '{name}', it has {_listed(headers)}{hint}")


def deviation_column(headers: Sequence[str], output: str) -> str | None:
    """Return the column ``sd`` in the unit of an output, as `reduce` writes it; None without one.

    ``headers``: headers of the columns; ``output``: name and unit of the output, such as
    ``curvature [1/m]``.
    """
    wanted = ("sd", split_header(output)[1])
    return next((header for header in headers if split_header(header) == wanted), None)


def with_unit(name: str, header: str) -> str:
    """Return a header with its unit, or with the unit of the name by which it was found."""
    return name.strip() if header == split_header(name)[0] else header


def _listed(headers: Sequence[str], *, most: int = 12) -> str:
    shown = (header if len(header) <= 60 else header[:57] + "..." for header in headers[:most])
    text = ", ".join(f"'{header}'" for header in shown)
    return text + (f" and {len(headers) - most} more" if len(headers) > most else "")


def check_headers(headers: Sequence[str], file: Path) -> None:
    """Raise a `RecordError` if a header cannot be printed, or appears twice."""
    seen: set[str] = set()
    for number, header in enumerate(headers, 1):
        check_name(f"header {number} of {file}", header, RecordError)
        if header and header in seen:
            raise RecordError(f"{file} has two columns named '{header}'; rename one")
        seen.add(header)


def with_units(headers: Sequence[str], cells: Sequence[str]) -> list[str] | None:
    """Return headers with units from a row of units; None if the row has no units."""
    units = [cell.strip().strip("[]()").strip() for cell in cells]
    known = [unit in UNITS for unit in units]
    if len(units) != len(headers) or not any(known):
        return None
    if not all(yes or unit in ("", "-", "1") for yes, unit in zip(known, units, strict=True)):
        return None
    return [
        f"{header} [{unit}]" if yes and not header.endswith(("]", ")")) else header
        for header, unit, yes in zip(headers, units, known, strict=True)
    ]

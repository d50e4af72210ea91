"""Numbers with their uncertainty, as calibrations give them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Measured:
    """A number that was measured.

    ``value`` and ``sd``: the number and its standard deviation, in the unit.
    """

    name: str
    value: float
    sd: float
    unit: str

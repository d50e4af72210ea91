"""Numbers with their uncertainty, as calibrations give them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Measured:
    """A number that was measured.

    Parameters
    ----------
    name, unit : str
    value, sd : float
        The number and its standard deviation, in the unit.
    """

    name: str
    value: float
    sd: float
    unit: str

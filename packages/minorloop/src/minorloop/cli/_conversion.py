"""Options that convert the readings of a sensor, for ``reduce``, ``run`` and ``drive``."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli._common import numbers
from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator, Channel
    from minorloop.lab.conversion import CalibrationTable, Conversion
    from minorloop.lab.records import Quantity
    from minorloop.lab.store import Setup

_POWERS = range(2, 21)
_LASER = "D0,H0[,SD,SD]"

Laser = Annotated[
    str | None,
    typer.Option(
        metavar=_LASER,
        help="Convert laser distance to curvature: distance to the straight strip and height above "
        "the clamp, and their standard deviations, in the unit of the distance. Curvature is "
        "positive where the distance is below D0: towards the laser.",
    ),
]
Linear = Annotated[
    str | None, typer.Option(metavar="GAIN,OFFSET", help="Convert by gain times reading + offset.")
]
Polynomial = Annotated[
    str | None,
    typer.Option(metavar="C0,C1,...", help="Convert by a polynomial, from the constant on."),
]
Table = Annotated[
    Path | None,
    typer.Option(help="Convert by a table: a file with two columns, reading and value."),
]
Name = Annotated[str | None, typer.Option(help="Name of the converted output.")]
Unit = Annotated[str | None, typer.Option(help="Unit of the converted output.")]


@dataclass(frozen=True)
class ConversionOptions:
    """Options of one conversion, as texts."""

    laser: str | None = None
    linear: str | None = None
    polynomial: str | None = None
    """``laser``, ``linear`` and ``polynomial``: numbers separated by commas."""
    table: Path | dict[str, Any] | None = None
    """A file, or its numbers as ``to_json`` gives them."""
    name: str | None = None
    unit: str | None = None
    """``name`` and ``unit``: of the result."""
    calibration_sd: float = 0.0
    """Standard deviation of the calibration, in the unit of the result."""

    def __post_init__(self) -> None:
        given = [name for name in ("laser", "linear", "polynomial", "table") if self._has(name)]
        if len(given) > 1:
            raise ParameterError(f"--{given[0]} and --{given[1]} are given; give one conversion")
        if self.laser is not None and any(self._named.values()):
            raise ParameterError(
                "--laser gives curvature [1/m]; leave --name, --unit and --calibration-sd out"
            )

    @classmethod
    def of_setup(cls, setup: Setup) -> ConversionOptions:
        """Return the options that a store keeps, also one of an earlier version."""
        design = setup.design or {}
        kept = setup.options.get("conversion", design.get("conversion"))
        return cls(**({"laser": design.get("laser")} if kept is None else kept))

    def for_setup(self, reading: Channel) -> dict[str, Any]:
        """Return what a store keeps for `of_setup`, with the name of what is converted."""
        fields = self.to_json()
        return {"conversion": fields, "reading": str(reading)} if fields else {}

    def converted(self, plant: Actuator, *, begun: bool = False) -> Actuator:
        """Return the actuator with its readings converted, where options are given.

        ``begun`` is true for a run that has points: its first hold is not judged anew.
        """
        from minorloop.lab.records import Quantity
        from minorloop.lab.wrapped_actuator import ConvertedActuator

        reading = plant.outputs[0]
        conversion = self.conversion(Quantity(reading.name, reading.unit))
        if conversion is None:
            return plant
        return ConvertedActuator(plant, conversion, begun=begun)

    def conversion(self, reading: Quantity) -> Conversion | None:
        """Return the conversion of a reading; None if nothing was given."""
        from minorloop.lab.conversion import CalibrationPolynomial

        if self.laser is not None:
            return self._of_laser(self.laser, reading.unit)
        if self.table is not None:
            return self._of_table(self.table)
        coefficients: tuple[float, ...] = (0.0, 1.0)
        if self.linear is not None:
            gain, *offset = numbers("linear", self.linear, (1, 2), "GAIN,OFFSET")
            if gain == 0:
                raise ParameterError(
                    f"--linear is {self.linear!r}, whose gain is 0, so that every reading gives "
                    "the same; give GAIN,OFFSET with another gain"
                )
            coefficients = (*(offset or [0.0]), gain)
        elif self.polynomial is not None:
            coefficients = tuple(numbers("polynomial", self.polynomial, _POWERS, "C0,C1,..."))
        elif not any(self._named.values()):
            return None
        return CalibrationPolynomial(**self._named, coefficients=coefficients)

    def to_json(self) -> dict[str, Any]:
        """Return the options that are given, with the numbers of a table, ready for JSON."""
        fields = {name: value for name, value in asdict(self).items() if value}
        if self.table is not None:
            found = self._of_table(self.table)
            known = {name: list(getattr(found, name)) for name in ("readings", "values")}
            fields["table"] = {"name": found.name, "unit": found.unit, **known}
        return fields

    @property
    def _named(self) -> dict[str, Any]:
        return {"name": self.name, "unit": self.unit, "calibration_sd": self.calibration_sd}

    def _has(self, name: str) -> bool:
        return getattr(self, name) is not None

    def _of_laser(self, text: str, unit: str) -> Conversion:
        from minorloop.lab.conversion import LaserCurvature

        d0, h0, *sds = numbers("laser", text, (2, 4), _LASER)
        sd_d0, sd_h0 = sds or (0.0, 0.0)
        return LaserCurvature(d0, h0, sd_d0, sd_h0, unit)

    def _of_table(self, table: Path | dict[str, Any]) -> CalibrationTable:
        from minorloop.lab.conversion import CalibrationTable

        if isinstance(table, dict):
            found = CalibrationTable(**table)
        else:
            found = CalibrationTable.from_csv(table, calibration_sd=self.calibration_sd)
        return replace(found, name=self.name or found.name, unit=self.unit or found.unit)

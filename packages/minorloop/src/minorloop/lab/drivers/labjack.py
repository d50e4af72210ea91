"""Analog and digital channels of a LabJack T4, T7 or T8, through the LJM library.

Keys of the device: ``model`` (such as ``T7``), ``connection`` (``USB``, ``ETHERNET``, ``WIFI``)
and ``identifier`` (serial number, name or address); each is ``ANY`` if not given. A source has
``channel``, such as ``DAC0``, and may have ``tolerance``, of its voltage read back, in V. A
sensor has ``channel``, such as ``AIN0``, and may have ``range``, in V. A line has ``channel``,
such as ``FIO0``.
"""

import contextlib
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, MissingExtraError
from minorloop.lab.drivers.description import Section, parsed
from minorloop.lab.drivers.device import DevicePlan, all_done

__all__ = ["NEEDS", "LabJack", "found", "open_device"]

NEEDS = "labjack", "labjack"
"""Library of the driver, and the extra that installs it."""


class _LabjackSettings(Section, kw_only=True):
    model: str = "ANY"
    connection: str = "ANY"
    identifier: str = "ANY"


class _LabjackSource(Section, kw_only=True):
    channel: str
    tolerance: float = 0.01


class _LabjackSensor(Section, kw_only=True):
    channel: str
    range: float | None = None


class _LabjackLine(Section, kw_only=True):
    channel: str


class LabJack:
    """A LabJack as a device with several channels.

    Parameters
    ----------
    plan : DevicePlan

    Raises
    ------
    ParameterError
        If a key is missing, unknown, or of another type.
    MissingExtraError
        If labjack-ljm is not installed.
    InstrumentError
        If there is no such device, or the LJM library of the manufacturer is missing.
    """

    def __init__(self, plan: DevicePlan) -> None:
        self._ljm = _library()
        how = parsed(_LabjackSettings, plan.keys, f"device {plan.name!r}", "device")
        self._sources = [wire.parsed(_LabjackSource) for wire in plan.sources]
        sensors = [wire.parsed(_LabjackSensor) for wire in plan.sensors]
        self._sensors = [each.channel for each in sensors]
        self._lines = [wire.parsed(_LabjackLine).channel for wire in plan.lines]
        self._rest, self._resting_lines = plan.rest, plan.resting_lines
        self._name = f"LabJack {how.model} {how.identifier}"
        self._handle = self._call("openS", how.model, how.connection, how.identifier)
        try:
            ranges = {f"{e.channel}_RANGE": e.range for e in sensors if e.range is not None}
            self._write(list(ranges), list(ranges.values()))
        except BaseException:
            self.close()
            raise

    def set(self, values: FloatArray) -> None:
        """Set the voltages of all sources, and read them back."""
        names = [source.channel for source in self._sources]
        self._write(names, values.tolist())
        for source, wanted, found in zip(self._sources, values, self._read(names), strict=True):
            if not abs(found - wanted) <= source.tolerance:
                raise InstrumentError(
                    f"{source.channel} of {self._name} was set to {wanted:g} V and has {found:g} V"
                )

    def read(self) -> FloatArray:
        """Return the voltages of all sensors."""
        return np.array(self._read(self._sensors))

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch lines on or off, and read them back."""
        names = [self._lines[line] for line in values]
        self._write(names, [float(on) for on in values.values()])
        for name, on, found in zip(names, values.values(), self._read(names), strict=True):
            if bool(found) != on:
                raise InstrumentError(
                    f"{name} of {self._name} was set to {int(on)} and has {found:g}"
                )

    def safe(self) -> None:
        """Set sources and lines to rest, and read them back."""
        all_done([lambda: self.set(self._rest), lambda: self.switch(self._resting_lines)])

    def close(self) -> None:
        """Close the connection."""
        self._call("close", self._handle)

    def _write(self, names: Sequence[str], values: Sequence[float]) -> None:
        if names:
            self._call("eWriteNames", self._handle, len(names), list(names), list(values))

    def _read(self, names: Sequence[str]) -> list[float]:
        if not names:
            return []
        return [float(v) for v in self._call("eReadNames", self._handle, len(names), list(names))]

    def _call(self, name: str, *given: Any) -> Any:
        try:
            return getattr(self._ljm, name)(*given)
        except self._ljm.LJMError as error:
            said = " ".join(str(error).split())
            raise InstrumentError(f"{self._name} cannot be used: {said}") from None
        except AttributeError:  # of a library that is None
            raise InstrumentError(
                f"{self._name} cannot be used: the LJM library is missing; install that of LabJack"
            ) from None


def open_device(plan: DevicePlan) -> LabJack:
    """Return a LabJack; see `LabJack`."""
    return LabJack(plan)


def found() -> list[str]:
    """Return models and serial numbers of the LabJacks that are connected."""
    try:
        ljm = _library()
        _, models, _, serials, _ = ljm.listAllS("ANY", "ANY")
    except Exception:  # no driver, or no library
        return []
    names = {4: "T4", 7: "T7", 8: "T8"}
    return [f"{names.get(m, m)} {s}" for m, s in zip(models, serials, strict=True)]


def _library() -> Any:
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints that its library is missing
            from labjack import ljm
    except ImportError:
        raise MissingExtraError("labjack-ljm", "labjack") from None
    return ljm

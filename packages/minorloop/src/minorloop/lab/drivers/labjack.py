"""Analog and digital channels of a LabJack T4, T7 or T8, through the LJM library.

Keys of the device: ``model`` (such as ``T7``), ``connection`` (``USB``, ``ETHERNET``, ``WIFI``)
and ``identifier`` (serial number, name or address); each is ``ANY`` by default. A source has
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
from minorloop.errors import MissingExtraError
from minorloop.lab.drivers.device import DevicePlan, PlannedDevice, Section

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


class LabJack(PlannedDevice):
    """A LabJack as a device with several channels."""

    settings, source, sensor, line = _LabjackSettings, _LabjackSource, _LabjackSensor, _LabjackLine

    def __init__(self, plan: DevicePlan) -> None:
        self._ljm = _library()
        super().__init__(plan)
        how = self._how
        self.name = f"LabJack {how.model} {how.identifier}"
        self._handle = self._call("openS", how.model, how.connection, how.identifier)
        ranges = {f"{e.channel}_RANGE": e.range for e in self._sensors if e.range is not None}
        try:
            self._write(list(ranges), list(ranges.values()))
        except BaseException:
            self.close()
            raise

    def set(self, values: FloatArray) -> None:
        """Set the voltages of all sources, and read them back."""
        names = [source.channel for source in self._sources]
        self._write(names, values.tolist())
        for source, wanted, found in zip(self._sources, values, self._read(names), strict=True):
            self._confirm(source.channel, wanted, found, source.tolerance)

    def read(self) -> FloatArray:
        """Return the voltages of all sensors."""
        return np.array(self._read([sensor.channel for sensor in self._sensors]))

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch lines on or off, and read them back."""
        names = [self._lines[line].channel for line in values]
        self._write(names, [float(on) for on in values.values()])
        for name, on, found in zip(names, values.values(), self._read(names), strict=True):
            self._confirm(name, on, float(bool(found)))

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
            raise self._failed(error) from None
        except AttributeError:  # the library is None
            raise self._failed("the LJM library is missing; install that of LabJack") from None


open_device = LabJack


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

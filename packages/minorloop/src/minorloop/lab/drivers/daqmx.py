"""Analog and digital channels of a device of NI, through NI-DAQmx.

The device has ``device``, its name, such as ``Dev1``. A source has ``channel``, such as ``ao0``,
and may have ``confirm``, an analog input such as ``ai2`` that is wired to it, which is read back
and must agree within ``tolerance``, in V. A sensor has ``channel``, such as ``ai0``, and may have
``range``, two voltages, and ``terminals``: ``default``, ``rse``, ``nrse``, ``diff`` or
``pseudo_diff``. A line has ``channel``, such as ``port0/line0``. Without ``confirm`` it is only
known that NI-DAQmx has taken a voltage.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, Literal

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, MissingExtraError
from minorloop.lab.drivers.description import Section, parsed
from minorloop.lab.drivers.device import DevicePlan, all_done

__all__ = ["NEEDS", "DaqDevice", "found", "open_device"]

NEEDS = "nidaqmx", "daqmx"
"""Library of the driver, and the extra that installs it."""

_WAIT = 1.0
"""Seconds to wait for a sample."""


class _DaqmxSettings(Section, kw_only=True):
    device: str


class _DaqmxSource(Section, kw_only=True):
    channel: str
    confirm: str | None = None
    tolerance: float = 0.02


class _DaqmxSensor(Section, kw_only=True):
    channel: str
    range: tuple[float, float] = (-10.0, 10.0)
    terminals: Literal["default", "rse", "nrse", "diff", "pseudo_diff"] = "default"


class _DaqmxLine(Section, kw_only=True):
    channel: str


class DaqDevice:
    """A device of NI with several channels: one task for each kind.

    Parameters
    ----------
    plan : DevicePlan

    Raises
    ------
    ParameterError
        If a key is missing, unknown, or of another type.
    MissingExtraError
        If nidaqmx is not installed.
    InstrumentError
        If there is no such device, or the NI-DAQmx driver is missing.
    """

    def __init__(self, plan: DevicePlan) -> None:
        try:
            import nidaqmx
        except ImportError:
            raise MissingExtraError("nidaqmx", "daqmx") from None
        self._daq: Any = nidaqmx
        self._name = parsed(_DaqmxSettings, plan.keys, f"device {plan.name!r}", "device").device
        self._sources = [wire.parsed(_DaqmxSource) for wire in plan.sources]
        self._limits = [(wire.low, wire.high) for wire in plan.sources]
        self._sensors = [wire.parsed(_DaqmxSensor) for wire in plan.sensors]
        self._lines = [wire.parsed(_DaqmxLine).channel for wire in plan.lines]
        self._rest, self._on = plan.rest, dict(plan.resting_lines)
        self._resting_lines = plan.resting_lines
        self._tasks: dict[str, Any] = {}
        self._begin()

    def set(self, values: FloatArray) -> None:
        """Set the voltages of all sources; read back those that are wired to an input."""
        if not self._sources:
            return
        self._write("sources", values.tolist())
        wired = [(each, v) for each, v in zip(self._sources, values, strict=True) if each.confirm]
        for (source, wanted), found in zip(wired, self._read("confirm", len(wired)), strict=True):
            if not abs(found - wanted) <= source.tolerance:
                raise InstrumentError(
                    f"{source.channel} of {self._name} was set to {wanted:g} V, and "
                    f"{source.confirm} reads {found:g} V"
                )

    def read(self) -> FloatArray:
        """Return the voltages of all sensors."""
        return np.array(self._read("sensors", len(self._sensors)))

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch lines on or off."""
        if values:
            on = {**self._on, **values}
            self._write("lines", [on[line] for line in sorted(on)])
            self._on = on

    def safe(self) -> None:
        """Set sources and lines to rest."""
        all_done([lambda: self.set(self._rest), lambda: self.switch(self._resting_lines)])

    def close(self) -> None:
        """Close the tasks; outputs keep their voltage."""
        while self._tasks:
            _, task = self._tasks.popitem()
            with suppress(Exception):
                task.close()

    def _begin(self) -> None:
        """Make the tasks."""
        try:
            for name, channels, add in (
                ("sources", self._sources, self._add_sources),
                ("confirm", [s for s in self._sources if s.confirm], self._add_confirming),
                ("sensors", self._sensors, self._add_sensors),
                ("lines", self._lines, self._add_lines),
            ):
                if channels:
                    self._tasks[name] = self._daq.Task()
                    add(self._tasks[name])
        except self._daq.errors.Error as error:
            raise self._failed(error) from None

    def _add_sources(self, task: Any) -> None:
        for source, (low, high) in zip(self._sources, self._limits, strict=True):
            place = f"{self._name}/{source.channel}"
            task.ao_channels.add_ao_voltage_chan(place, min_val=low, max_val=high)

    def _add_confirming(self, task: Any) -> None:
        for source in self._sources:
            if source.confirm is not None:
                place = f"{self._name}/{source.confirm}"
                task.ai_channels.add_ai_voltage_chan(place, min_val=-10.0, max_val=10.0)

    def _add_sensors(self, task: Any) -> None:
        from nidaqmx.constants import TerminalConfiguration

        for sensor in self._sensors:
            low, high = sensor.range
            task.ai_channels.add_ai_voltage_chan(
                f"{self._name}/{sensor.channel}",
                terminal_config=TerminalConfiguration[sensor.terminals.upper()],
                min_val=low,
                max_val=high,
            )

    def _add_lines(self, task: Any) -> None:
        for line in self._lines:
            task.do_channels.add_do_chan(f"{self._name}/{line}")

    def _write(self, task: str, values: Sequence[Any]) -> None:
        """Write one sample of each channel."""
        if not self._tasks:
            self._begin()
        try:
            data = values[0] if len(values) == 1 else list(values)
            self._tasks[task].write(data, auto_start=True, timeout=_WAIT)
        except self._daq.errors.Error as error:
            raise self._failed(error) from None

    def _read(self, task: str, count: int) -> list[float]:
        """Return one sample of each channel."""
        if not count:
            return []
        if not self._tasks:
            self._begin()
        try:
            return [float(v) for v in np.atleast_1d(self._tasks[task].read(timeout=_WAIT))]
        except self._daq.errors.Error as error:
            raise self._failed(error) from None

    def _failed(self, error: Exception) -> InstrumentError:
        """Close the tasks, which the next command makes again; return what to raise."""
        self.close()
        said = " ".join(str(error).split())
        return InstrumentError(f"{self._name} cannot be used: {said[:200]}")


def open_device(plan: DevicePlan) -> DaqDevice:
    """Return a device of NI; see `DaqDevice`."""
    return DaqDevice(plan)


def found() -> list[str]:
    """Return names and products of the devices that NI-DAQmx knows."""
    try:
        from nidaqmx.system import System

        return [f"{each.name} {each.product_type}" for each in System.local().devices]
    except Exception:  # no driver, or no library
        return []

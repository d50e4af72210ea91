"""Analog and digital channels of a device of NI, through NI-DAQmx.

The device has ``device``, its name, such as ``Dev1``. A source has ``channel``, such as ``ao0``,
and may have ``confirm``, an analog input such as ``ai2`` that is wired to it, which is read back
and must agree within ``tolerance``, in V. A sensor has ``channel``, such as ``ai0``, and may have
``range``, two voltages, and ``terminals``: ``default``, ``rse``, ``nrse``, ``diff`` or
``pseudo_diff``. A line has ``channel``, such as ``port0/line0``. Without ``confirm`` it is only
known that NI-DAQmx has accepted a voltage.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Literal

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import MissingExtraError
from minorloop.lab.drivers.device import DevicePlan, PlannedDevice, Section

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


class DaqDevice(PlannedDevice):
    """A device of NI with several channels: one task for each kind."""

    settings, source, sensor, line = _DaqmxSettings, _DaqmxSource, _DaqmxSensor, _DaqmxLine

    def __init__(self, plan: DevicePlan) -> None:
        try:
            import nidaqmx
        except ImportError:
            raise MissingExtraError("nidaqmx", "daqmx") from None
        super().__init__(plan)
        self._daq: Any = nidaqmx
        self.name = self._how.device
        self._on = dict(plan.resting_lines)
        self._tasks: dict[str, Any] = {}
        self._do(lambda: None)

    def set(self, values: FloatArray) -> None:
        """Set the voltages of all sources; read back voltages that are wired to an input."""
        if not self._sources:
            return
        self._write("sources", values.tolist())
        wired = [(each, v) for each, v in zip(self._sources, values, strict=True) if each.confirm]
        for (source, wanted), found in zip(wired, self._read("confirm", len(wired)), strict=True):
            reads = f"{source.confirm} reads"
            self._confirm(source.channel, wanted, found, source.tolerance, reads)

    def read(self) -> FloatArray:
        """Return the voltages of all sensors."""
        return np.array(self._read("sensors", len(self._sensors)))

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch lines on or off."""
        if values:
            on = {**self._on, **values}
            self._write("lines", [on[line] for line in sorted(on)])
            self._on = on

    def close(self) -> None:
        """Close the tasks; outputs keep their voltage."""
        while self._tasks:
            _, task = self._tasks.popitem()
            with suppress(Exception):
                task.close()

    def _begin(self) -> None:
        """Make the tasks."""
        from nidaqmx.constants import TerminalConfiguration

        limits = [(wire.low, wire.high) for wire in self._plan.sources]
        for source, (low, high) in zip(self._sources, limits, strict=True):
            outputs = self._task("sources").ao_channels
            outputs.add_ao_voltage_chan(self._at(source.channel), min_val=low, max_val=high)
            if source.confirm is not None:
                inputs = self._task("confirm").ai_channels
                place = self._at(source.confirm)
                inputs.add_ai_voltage_chan(place, min_val=-10.0, max_val=10.0)
        for sensor in self._sensors:
            low, high = sensor.range
            self._task("sensors").ai_channels.add_ai_voltage_chan(
                self._at(sensor.channel),
                terminal_config=TerminalConfiguration[sensor.terminals.upper()],
                min_val=low,
                max_val=high,
            )
        for line in self._lines:
            self._task("lines").do_channels.add_do_chan(self._at(line.channel))

    def _at(self, channel: str) -> str:
        return f"{self.name}/{channel}"

    def _task(self, name: str) -> Any:
        if name not in self._tasks:
            self._tasks[name] = self._daq.Task()
        return self._tasks[name]

    def _write(self, task: str, values: Sequence[Any]) -> None:
        """Write one sample of each channel."""
        data = values[0] if len(values) == 1 else list(values)
        self._do(lambda: self._tasks[task].write(data, auto_start=True, timeout=_WAIT))

    def _read(self, task: str, count: int) -> list[float]:
        """Return one sample of each channel."""
        if not count:
            return []
        found = self._do(lambda: self._tasks[task].read(timeout=_WAIT))
        return [float(v) for v in np.atleast_1d(found)]

    def _do(self, step: Callable[[], Any]) -> Any:
        """Do a step with the tasks; after an error the next step makes them again."""
        try:
            if not self._tasks:
                self._begin()
            return step()
        except self._daq.errors.Error as error:
            self.close()
            raise self._failed(error) from None


open_device = DaqDevice


def found() -> list[str]:
    """Return names and products of the devices that NI-DAQmx knows."""
    try:
        from nidaqmx.system import System

        return [f"{each.name} {each.product_type}" for each in System.local().devices]
    except Exception:  # no driver, or no library
        return []

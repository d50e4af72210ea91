"""Registers and coils of a device that speaks Modbus TCP, through pymodbus.

Keys of the device: ``host``, ``port`` (502), ``unit_id`` (1), ``word_order`` (``big`` or
``little``), ``timeout``. A source has ``register``, a holding register, counted from 0, and
``type``: ``float32`` (the default), ``int16``, ``uint16``, ``int32`` or ``uint32``; whole numbers
are rounded to the nearest. A sensor has ``register``, ``type`` and ``kind``: ``input`` (the
default) or ``holding``. A line has ``coil``. After each command the registers and coils are read
back and compared.
"""

import logging
from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, MissingExtraError
from minorloop.lab.drivers.device import DevicePlan, PlannedDevice, Section

NEEDS = "pymodbus", "modbus"
"""Library of the driver, and the extra that installs it."""

_Kind: TypeAlias = Literal["float32", "int16", "uint16", "int32", "uint32"]


class _ModbusSettings(Section, kw_only=True):
    host: str
    port: int = 502
    unit_id: int = 1
    word_order: Literal["big", "little"] = "big"
    timeout: float = 0.5


class _ModbusSource(Section, kw_only=True):
    register: int
    type: _Kind = "float32"


class _ModbusSensor(_ModbusSource, kw_only=True):
    kind: Literal["input", "holding"] = "input"


class _ModbusLine(Section, kw_only=True):
    coil: int


class ModbusDevice(PlannedDevice):
    """A device with registers and coils."""

    settings, source, sensor, line = _ModbusSettings, _ModbusSource, _ModbusSensor, _ModbusLine

    def __init__(self, plan: DevicePlan) -> None:
        try:
            from pymodbus.client import ModbusTcpClient
        except ImportError:
            raise MissingExtraError("pymodbus", "modbus") from None
        super().__init__(plan)
        # Its messages repeat the errors that are raised here.
        logging.getLogger("pymodbus").addHandler(logging.NullHandler())
        self.name = f"{self._how.host}:{self._how.port}"
        self._client = ModbusTcpClient(
            self._how.host, port=self._how.port, timeout=self._how.timeout, retries=0
        )
        self._asked("connect")

    def set(self, values: FloatArray) -> None:
        """Write the registers of all sources, and compare them."""
        for source, value in zip(self._sources, values.tolist(), strict=True):
            number = value if source.type == "float32" else round(value)
            words = self._call("convert_to_registers", number, self._type(source))
            self._asked("write_registers", source.register, words)
            found = self._register("read_holding_registers", source)
            place = f"register {source.register}"
            # Largest difference of a register that was read back, as a share of the number
            self._confirm(place, number, found, 1e-6 * max(1.0, abs(number)))

    def read(self) -> FloatArray:
        """Return the registers of all sensors."""
        ask = {"input": "read_input_registers", "holding": "read_holding_registers"}
        return np.array([self._register(ask[each.kind], each) for each in self._sensors])

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch coils on or off, and compare them."""
        for line, on in values.items():
            coil = self._lines[line].coil
            self._asked("write_coil", coil, on)
            found = self._asked("read_coils", coil, count=1).bits[0]
            self._confirm(f"coil {coil}", on, float(bool(found)))

    def close(self) -> None:
        """Close the connection."""
        self._client.close()

    def _register(self, ask: str, place: _ModbusSource) -> float:
        kind = self._type(place)
        words = self._asked(ask, place.register, count=kind.value[1]).registers
        return float(self._call("convert_from_registers", words, kind))

    def _type(self, place: _ModbusSource) -> Any:
        return self._client.DATATYPE[place.type.upper()]

    def _call(self, name: str, *given: Any) -> Any:
        """Convert registers; a number that they cannot hold is an error."""
        try:
            return getattr(self._client, name)(*given, word_order=self._how.word_order)
        except Exception as error:  # struct.error, ValueError, ModbusException
            raise InstrumentError(f"{self.name} cannot hold {given[0]}: {error}") from None

    def _asked(self, name: str, *given: Any, **options: Any) -> Any:
        """Return the answer to a question; open the connection again if it was lost."""
        from pymodbus.exceptions import ModbusException

        try:
            if not self._client.connected and not self._client.connect():
                raise InstrumentError(f"nothing answers at {self.name}; check host, port and cable")
            if name == "connect":
                return None
            answer = getattr(self._client, name)(*given, device_id=self._how.unit_id, **options)
        except (ModbusException, OSError) as error:
            self._client.close()
            if isinstance(error, InstrumentError):
                raise
            said = " ".join(str(error).split())
            raise InstrumentError(
                f"{self.name} gave no answer within {self._how.timeout:g} s: {said}"
            ) from None
        if answer.isError():
            raise InstrumentError(f"{self.name} refuses {name} at {given[0]}: {answer}")
        return answer


open_device = ModbusDevice

import asyncio
import threading

import numpy as np
import pytest

from minorloop.errors import InstrumentError
from minorloop.lab.drivers.device import DeviceChannel, DevicePlan
from minorloop.lab.drivers.modbus import open_device

pytest.importorskip("pymodbus", reason="needs pymodbus: minorloop[modbus]")
HOST = "127.0.0.1"


class Server:
    """The simulator of pymodbus on loopback, in a thread; registers are 0 at first."""

    def __enter__(self):
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()))
        self._thread.start()
        assert self._ready.wait(20)
        return self

    async def _serve(self):
        from pymodbus.server import ModbusTcpServer
        from pymodbus.simulator import DataType, SimData, SimDevice

        words = [SimData(0, count=20, values=0, datatype=DataType.REGISTERS)]
        bits = [SimData(0, count=8, values=[False], datatype=DataType.BITS)]
        device = SimDevice(id=1, simdata=(bits, bits, words, words))
        server = ModbusTcpServer(device, address=(HOST, 0))
        self._loop, self._over = asyncio.get_running_loop(), asyncio.Event()
        serving = asyncio.create_task(server.serve_forever())
        while server.transport is None:
            await asyncio.sleep(0.001)
        self.port = server.transport.sockets[0].getsockname()[1]
        self._ready.set()
        await self._over.wait()
        await self._turn()  # accepts what has just connected
        for connection in list(server.active_connections.values()):
            connection.close()
        await server.shutdown()
        await serving
        await self._turn()  # closes the sockets

    async def _turn(self):
        for _ in range(20):
            await asyncio.sleep(0)

    def __exit__(self, *_):
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join()


def plan(port, **changes):
    known = {
        "sources": (
            DeviceChannel("x", {"register": 0}, low=0.0, high=0.4, rest=0.0),
            DeviceChannel("y", {"register": 2, "type": "int16"}, low=-400, high=400, rest=5.0),
        ),
        "sensors": (
            DeviceChannel("a", {"register": 0, "kind": "holding"}),
            DeviceChannel("b", {"register": 2, "type": "int16", "kind": "holding"}),
            DeviceChannel("c", {"register": 8}),
        ),
        "lines": (
            DeviceChannel("lamp", {"coil": 3}, rest=1.0),
            DeviceChannel("valve", {"coil": 0}),
        ),
    }
    return DevicePlan("box", {"host": HOST, "port": port}, **{**known, **changes})


def test_registers_and_coils_are_written_read_back_and_made_safe():
    with Server() as server:
        device = open_device(plan(server.port))
        device.set(np.array([0.25, -300.4]))
        assert device.read() == pytest.approx([0.25, -300.0, 0.0])
        device.switch({1: True, 0: False})
        read = device._client.read_coils
        assert read(0, count=4).bits[:4] == [True, False, False, False]
        device.safe()
        assert device.read() == pytest.approx([0.0, 5.0, 0.0])
        assert read(0, count=4).bits[:4] == [False, False, False, True]
        with pytest.raises(InstrumentError, match="cannot hold 40000"):
            device.set(np.array([0.0, 40000.0]))
        far = plan(server.port, sensors=(DeviceChannel("far", {"register": 500}),))
        lost = open_device(far)
        with pytest.raises(InstrumentError, match="refuses read_input_registers at 500"):
            lost.read()
        lost.close()
        device.close()
        assert device.read()[1] == 5.0  # it was opened again
        device.close()


def test_a_register_that_keeps_another_number_is_not_taken_for_set(monkeypatch):
    with Server() as server:
        device = open_device(plan(server.port))
        real = device._asked

        def asked(name, *given, **options):
            return None if name.startswith("write") else real(name, *given, **options)

        monkeypatch.setattr(device, "_asked", asked)
        with pytest.raises(InstrumentError, match=r"register 0 of .* was set to 0.25 and has 0"):
            device.set(np.array([0.25, 0.0]))
        with pytest.raises(InstrumentError, match=r"coil 3 of .* was set to 1 and has 0"):
            device.switch({0: True})
        device.close()


def test_a_device_that_is_missing_is_named():
    with Server() as server:
        port = server.port
        device = open_device(plan(port))
    for act in (device.read, device.safe, lambda: open_device(plan(port))):
        with pytest.raises(
            InstrumentError, match=r"(nothing answers at|gave no answer).*"
        ) as found:
            act()
        assert f"{HOST}:{port}" in str(found.value)
    device.close()

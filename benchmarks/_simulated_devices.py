"""A board, a camera and a tracker for benchmarks: programs that know nothing of minorloop."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from minorloop.dynamics.heated_wire import HeatedWire
from minorloop.head.console.plant import open_tip
from minorloop.head.control.limits import WireLimits
from minorloop.head.procedures.head_file import HeadFile, IdentifiedWires, save_head
from minorloop.head.vision.imaging import opencv
from minorloop.operators.preisach import Preisach

EXAMPLES = Path(__file__).parents[1] / "examples"
_PICTURES = 12
_BANDS, _HIGHEST = 16, 0.4
_MIDDLE, _SPREAD, _WIDTH, _LAG = 55.0 / 700.0, 12.0 / 700.0, 6.0 / 700.0, 1.5
"""Of the wires of the board, in square amperes, and in seconds."""
_LATENT = 2e-3


class Device:
    """A program that is started, pulled, and put back.

    Parameters
    ----------
    file : str
        In the folder of examples.
    *options : str
        Its arguments.
    """

    def __init__(self, file: str, *options: str) -> None:
        self._command = [sys.executable, "-I", "-S", str(EXAMPLES / file), *options]
        self.put_back()

    def put_back(self) -> None:
        """Start it."""
        self._process = subprocess.Popen(self._command, stdout=subprocess.DEVNULL)

    def pull(self) -> None:
        """End it at once."""
        self._process.kill()
        self._process.wait()


@contextlib.contextmanager
def devices(folder: Path) -> Iterator[tuple[dict[str, Device], list[str]]]:
    """Run the three devices; yield them by name, and the options of a console that uses them."""
    pictures = folder / "pictures"
    save_pictures(pictures)
    save_head_file(folder / "head.json")
    bench = (EXAMPLES / "head.toml").read_text()
    (folder / "head.toml").write_text(bench.replace("/dev/ttyACM0", str(folder / "board")))
    stream, poses = _free_port(socket.SOCK_STREAM), _free_port(socket.SOCK_DGRAM)
    running = {
        "camera": Device("simulated_camera.py", str(pictures), "--port", str(stream)),
        "board": Device("simulated_board.py", "--port", str(folder / "board")),
        "tracker": Device("simulated_tracker.py", str(poses)),
    }
    options = {
        "--plant": f"bench:{folder / 'head.toml'}",
        "--camera": f"camera:http://127.0.0.1:{stream}/",
        "--tracker": f"udp:{poses}",
        "--head": str(folder / "head.json"),
    }
    try:
        yield running, [word for option in options.items() for word in option]
    finally:
        for device in running.values():
            device.pull()


def save_pictures(folder: Path) -> None:
    """Write pictures of a pipe, in which the camera turns a little, as JPEG files."""
    cv2, (tip, _) = opencv(), open_tip("twin:pipe")
    folder.mkdir()
    for k in range(_PICTURES):
        tip.move_to((2e-3 * k, 1e-3 * k, 0.0, 0.0, 0.0, 0.0))
        cv2.imwrite(str(folder / f"{k:02}.jpg"), tip.frame().image)


def save_head_file(path: Path) -> None:
    """Write the file of the head on the simulated board, with the camera of the pictures."""
    _, view = open_tip("twin:pipe")
    wire, on = _wire(), datetime(2026, 1, 31, tzinfo=UTC)
    known = IdentifiedWires(
        on=on,
        wires=(wire, wire),
        coupling=np.eye(2),
        limits=WireLimits(),
        highest=_HIGHEST,
        stores={},
    )
    save_head(HeadFile(serial="H-01", identified=known, calibration=view, calibrated=on), path)


def _wire() -> HeatedWire:
    levels = np.linspace(0.0, _HIGHEST**2, _BANDS + 1)

    def density(alpha, beta):
        slope = np.cosh((0.5 * (alpha + beta) - _MIDDLE) / (2.0 * _SPREAD)) ** -2
        return slope * np.exp(-(((0.5 * (alpha - beta) - _WIDTH) / _WIDTH) ** 2))

    shape = Preisach.from_density(levels, density, relay="unipolar")
    weights = 60.0 * shape.weights / shape.weights.sum()
    return HeatedWire(Preisach(levels, weights, relay="unipolar"), _LAG, _LATENT)


def _free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])

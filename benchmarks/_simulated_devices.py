"""A board, a camera and a tracker for benchmarks: programs that know nothing of minorloop."""

from __future__ import annotations

import contextlib
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

EXAMPLES = Path(__file__).parents[1] / "examples"


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
        self._command = [sys.executable, "-I", str(EXAMPLES / file), *options]
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
    bench = (EXAMPLES / "head.toml").read_text()
    (folder / "head.toml").write_text(bench.replace("/dev/ttyACM0", str(folder / "board")))
    stream, told, poses = _free_ports(socket.SOCK_STREAM, socket.SOCK_DGRAM, socket.SOCK_DGRAM)
    camera = ["--port", str(stream), "--listen", str(told)]
    running = {
        "camera": Device("simulated_pipe.py", *camera),
        "board": Device("simulated_board.py", "--port", str(folder / "board"), "--tell", str(told)),
        "tracker": Device("simulated_tracker.py", str(poses)),
    }
    options = {
        "--plant": f"bench:{folder / 'head.toml'}",
        "--camera": f"camera:http://127.0.0.1:{stream}/",
        "--tracker": f"udp:{poses}",
        "--head": str(EXAMPLES / "head.json"),
    }
    try:
        yield running, [word for option in options.items() for word in option]
    finally:
        for device in running.values():
            device.pull()


def holes() -> list[tuple[float, float, float]]:
    """Return where the holes of the simulated pipe are: degrees, mm along it, mm wide."""
    command = [sys.executable, "-I", str(EXAMPLES / "simulated_pipe.py"), "--holes"]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    found = [re.findall(r"-?[\d.]+", line) for line in lines]
    return [(float(angle), float(place), float(width)) for angle, place, width in found]


def _free_ports(*kinds: socket.SocketKind) -> list[int]:
    """Return a free port of each kind; they are different."""
    with contextlib.ExitStack() as ends:
        free = [ends.enter_context(socket.socket(socket.AF_INET, kind)) for kind in kinds]
        for each in free:
            each.bind(("127.0.0.1", 0))
        return [int(each.getsockname()[1]) for each in free]

"""The simulated board of the examples, as a process of its own."""

import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

from minorloop.lab.drivers.device import DeviceChannel, DevicePlan
from minorloop.lab.drivers.serial_board import SerialBoard

EXAMPLES = Path(__file__).parents[3] / "examples"
_VOLTAGE, _TIP = DeviceChannel("voltage", {}, low=-0.5, high=0.5), DeviceChannel("tip", {})


class OneChannelBoard(SerialBoard):
    """A board of protocol 2 as a source and a meter of a bench."""

    def __init__(self, link):
        super().__init__(link, DevicePlan("board", {}, (_VOLTAGE,), (_TIP,)))

    def set(self, value):
        super().set([value])

    def read(self):
        return float(super().read()[0])


@contextmanager
def simulated_board(folder, *options, bench="stage.toml"):
    """Yield a bench file for a board that runs, and the process; the log is ``board.log``."""
    if bench == "stage.toml":
        options = ("--unit", "V", "--high", "100", "--of", "um", *options)
    program = [sys.executable, "-I", "-S", EXAMPLES / "simulated_board.py"]
    log = folder / "board.log"
    with subprocess.Popen(
        [*program, "--log", log, "--port", folder / "board", *options],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        port = process.stdout.readline().strip()
        text = (EXAMPLES / bench).read_text().replace("/dev/ttyACM0", port)
        (folder / bench).write_text(text)
        try:
            yield f"bench:{folder / bench}", process
        finally:
            process.kill()


def commands(folder):
    """The commands that the board has received, as words."""
    return [line.split()[1:] for line in (folder / "board.log").read_text().splitlines()]

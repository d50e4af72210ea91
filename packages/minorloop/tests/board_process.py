"""The simulated board of the examples, as a process of its own."""

import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

EXAMPLES = Path(__file__).parents[3] / "examples"


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

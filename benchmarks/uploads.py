"""Files that would take far more memory than they have bytes: on the command line, in the console.

Each is answered in a sentence, or read if it only pretends to be large. Times are of the processor;
memory is the most that the process of the command, or a worker of the console, ever had.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks._console import Server
from benchmarks._floods import HEADERS, matlab, variable, workbook
from benchmarks._timing import Row

SECONDS, MEGABYTES = 2.0, 500.0
_TICKS = os.sysconf("SC_CLK_TCK")


def rows(quick: bool) -> list[Row]:
    """Measure, and return the rows of the report."""
    with tempfile.TemporaryDirectory() as folder, Server(folder) as server:
        for _ in range(4):  # so that the workers have started
            _drop(server, "small.csv", b"u,y\n" + b"".join(b"%d,1\n" % k for k in range(9)))
        found = []
        for name, make in FILES.items():
            file = make(Path(folder) / name, quick)
            found += [_commanded(file), _uploaded(server, file)]
            file.unlink()
    return found


def _commanded(file: Path) -> Row:
    """Return what the command line makes of a file."""
    command = [sys.executable, "-m", "minorloop", "identify", file.name]
    with subprocess.Popen(
        [*command, "--input", "u", "--output", "y"],
        cwd=file.parent,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        said = process.stderr.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    taken, most = used.ru_utime + used.ru_stime, used.ru_maxrss * 1024 / 1e6
    refused = process.returncode == 2 and said.count("\n") == 1
    return _row(file, "command line", taken, most, said.strip() if refused else "", refused)


def _uploaded(server: Server, file: Path) -> Row:
    """Return what the console makes of a file."""
    workers = [pid for pid in server.pids() if _text(pid, "comm").startswith("page-worker")]
    for pid in workers:
        Path(f"/proc/{pid}/clear_refs").write_text("5")  # the peak begins anew
    before = sum(map(_worked, workers))
    status, said = _drop(server, file.name, file.read_bytes())
    taken = sum(map(_worked, workers)) - before
    most = max(map(_peak, workers)) / 1e6
    return _row(file, "console", taken, most, said, status == 422 and "\n" not in said)


def _row(file: Path, where: str, taken: float, most: float, said: str, refused: bool) -> Row:
    size = file.stat().st_size
    expected = not file.name.startswith("sound")
    met = refused == expected and (not expected or (taken <= SECONDS and most <= MEGABYTES))
    required = f"a sentence, <= {SECONDS:g} s, <= {MEGABYTES:g} MB" if expected else "it is read"
    answer = said if refused else "it is read"
    return Row(
        f"{file.name}, {size / 1e3:.0f} kB, {where}",
        taken,
        required=required,
        met=met,
        accuracy=f"{most:.0f} MB: {answer}",
    )


def _drop(server: Server, name: str, content: bytes) -> tuple[int, str]:
    answer = server.ask("POST", f"/api/lab?name={name}", content)
    return answer.status, json.loads(answer.read()).get("error", "")


def _text(pid: int, name: str) -> str:
    return Path(f"/proc/{pid}/{name}").read_text()


def _worked(pid: int) -> float:
    """Seconds of the processor that a process has had."""
    fields = _text(pid, "stat").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def _peak(pid: int) -> float:
    """Most bytes of memory that a process has had."""
    return 1024 * float(_text(pid, "status").split("VmHWM:")[1].split()[0])


def _wide(file: Path, quick: bool) -> Path:
    """Few cells, of which each row has one in the last column."""
    row = "<row r='{0}'><c r='A{0}'><v>{0}</v></c><c r='XFD{0}'><v>1</v></c></row>"
    return workbook(file, (HEADERS, 1), *[(row.format(k), 1) for k in range(2, 29_000)])


def _alike(file: Path, quick: bool) -> Path:
    """Cells that are all alike, so that they compress a thousand times."""
    row = "<row><c><v>1</v></c><c><v>1</v></c></row>"
    return workbook(file, (HEADERS, 1), (row, 300_000 if quick else 2_500_000))


def _texts(file: Path, quick: bool) -> Path:
    """Texts that no cell uses."""
    return workbook(file, (HEADERS, 1), strings=("a", 600_000 if quick else 18_000_000))


def _row_of_cells(file: Path, quick: bool) -> Path:
    """One row of cells that compress just as little as is read: it has too many columns."""
    cells = "".join(f"<c><v>{k * 7919 % 10_000}</v></c>" for k in range(500_000))
    return workbook(file, (HEADERS, 1), (f"<row>{cells}</row>", 1))


def _zeros(file: Path, quick: bool) -> Path:
    """One compressed variable of zeros."""
    millions = 50 if quick else 480
    block = bytes(8 * 10**6)
    return matlab(file, variable(b"u", millions * 10**6, (block for _ in range(millions))))


def _many(file: Path, quick: bool) -> Path:
    """Variables of which each alone would be read."""
    block = [bytes(8 * 10**6)] * 3
    part = [variable(b"u%d" % k, 3 * 10**6, block) for k in range(12)]
    return matlab(file, *part)


def _pretending(file: Path, quick: bool) -> Path:
    """Few cells, of which the sheet says that they are 17 thousand millions."""
    before = (
        "<row r='{0}'><c r='A{0}'><v>{1}</v></c><c r='B{0}'><v>{2}</v></c><c r='XFD{0}'/></row>"
    )
    u = np.abs(np.linspace(-1.0, 1.0, 2000) ** 2)
    rows = [(before.format(k + 2, x, x**2), 1) for k, x in enumerate(u)]
    return workbook(file, ("<dimension ref='A1:XFD1048576'/>", 1), (HEADERS, 1), *rows)


FILES: dict[str, Callable[[Path, bool], Path]] = {
    "wide.xlsx": _wide,
    "alike.xlsx": _alike,
    "texts.xlsx": _texts,
    "row.xlsx": _row_of_cells,
    "zeros.mat": _zeros,
    "many.mat": _many,
    "sound.xlsx": _pretending,
}

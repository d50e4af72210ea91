"""Export of a model as an FMI 2.0 co-simulation unit, from the same C, without Python."""

import hashlib
import io
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from html import escape
from pathlib import Path
from typing import Any

from minorloop.arrays import as_seconds
from minorloop.dynamics.cascade import Cascade, First
from minorloop.dynamics.linear import Linear
from minorloop.errors import OutputError, ParameterError
from minorloop.export._kinds import about
from minorloop.export._tables import render
from minorloop.export.c99 import source, split
from minorloop.files import PathLike, check_writable, write_atomically
from minorloop.lab.records import Quantity
from minorloop.modelfile import ModelFile, Provenance
from minorloop.operators.memory import ROOM
from minorloop.operators.preisach import Preisach
from minorloop.version import __version__

_PATIENCE = 120
"""Seconds after which a compiler counts as blocked."""
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-Wall", "-Wextra")
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""The earliest time of a zip file, so that equal models give equal bytes."""


def export_fmu(
    model: ModelFile | Preisach | Cascade,
    path: PathLike,
    *,
    name: str = "minorloop",
    memory: int = ROOM,
    input: str | Quantity = "input",
    output: str | Quantity = "output",
    interval: float | None = None,
    force: bool = False,
) -> list[str]:
    """Write a model as an FMI 2.0 co-simulation unit.

    It returns the platforms of the compiled unit, as the standard names them.

    The variables of the unit are input, output, and ``error_bound``, a bound of the output error
    from dropped extrema. The input is held over each communication step, and the output is that at
    its end: the output after the step that begins with ``u[k]`` is ``y[k]`` of ``simulate``, and a
    simulator shows it in row k + 1. The unit also contains the source, so that it can be compiled
    for other platforms. The compiler is ``$CC``, which may have options, or ``cc``.

    Raises a `ParameterError` if C cannot hold the model, an option is out of its range, or there is
    no C compiler; an `OutputError` if the file cannot be written, or the compiler fails.

    Parameters
    ----------
    model : ModelFile, Preisach or Cascade
        The model. The after-effect of a file is left out; a cascade is as for `source`, and
        communication steps are then whole numbers of the interval of its linear part.
    path : str or path
        The file to write, ``*.fmu``.
    name : str
        Name of the unit and of the files in it.
    memory : int
        Remembered extrema of the input.
    input, output : str or Quantity
        Names and units, such as ``voltage [V]``; those of a `ModelFile` replace them.
    interval : float, optional
        Default step of a simulator in seconds, and step of a continuous linear part; by default the
        interval of the linear part, or 0.01.
    force : bool
        Whether an existing file may be replaced.
    """
    target = check_writable(path, force=force)
    if target.suffix != ".fmu":
        raise ParameterError(f"the unit is named {target.name}; give a name that ends in .fmu")
    if isinstance(model, ModelFile):
        input, output = model.input, model.output
        model = model.model if isinstance(model.model, Cascade) else model.operator  # type: ignore[assignment]
    step = None if interval is None else as_seconds("interval", interval)
    own = model.linear.interval if isinstance(model, Cascade) else None
    if step is not None and own is not None and abs(step / own - round(step / own)) > 1e-9:
        raise ParameterError(
            f"interval is {step:g} s; with this linear part give a whole number of {own:g} s"
        )
    operator, linear, first = split(model, own or step if isinstance(model, Cascade) else None)
    if not isinstance(operator, Preisach):
        raise ParameterError(
            f"the model is a {type(operator).__name__}, and units can contain only Preisach "
            "models; identify one from the same record"
        )
    named = [q if isinstance(q, Quantity) else Quantity.parse(q) for q in (input, output)]
    whole = operator if linear is None else Cascade(operator, linear, first)
    labelled = ModelFile(whole, named[0], named[1], 0, Provenance())
    code = source(labelled, name=name, memory=memory, inverse=False)
    files = {file: text for file, text in code.files.items() if "_selftest" not in file}
    context = _context(operator, files, named, linear, first, name, step or own or 0.01)
    files[f"{name}_fmi2.c"] = render("fmi2.c", context)
    system, suffix = _platform()
    binary = _compiled(files, name, suffix)
    content = {
        "modelDescription.xml": render("modelDescription.xml", context).encode(),
        **{f"sources/{file}": text.encode() for file, text in files.items()},
        f"binaries/{system}/{name}{suffix}": binary,
    }
    write_atomically(target, _archive(content))
    return [system]


def _context(
    model: Preisach,
    files: dict[str, str],
    named: list[Quantity],
    linear: Linear | None,
    first: First,
    name: str,
    interval: float,
) -> dict[str, Any]:
    digest = hashlib.sha256("".join(f"{k}{files[k]}" for k in sorted(files)).encode())
    low = float(model.levels[0])
    if linear is not None and first == "linear":
        low = float(f"{low / linear.dc_gain:.15g}")  # a gain of 1 is computed to the last digit
    words = [Quantity(escape(q.name), escape(q.unit)) for q in named]
    return {
        "name": name,
        "guid": f"{{{digest.hexdigest()[:32]}}}",
        "version": __version__,
        "about": escape(about(model, linear, first)),
        "input": words[0],
        "output": words[1],
        "units": sorted({word.unit for word in words} - {""}),
        "names": _distinct(words[0].name, words[1].name, "error_bound"),
        "start": repr(low),
        "interval": interval,
        "linear": None
        if linear is None
        else {"interval": repr(linear.interval), "lag": linear.lag},
        "guard": name.upper(),
        "bands": model.bands,
        "prototypes": _prototypes(),
    }


def _distinct(*names: str) -> list[str]:
    """Return the names with underscores, so that all differ from one another and from ``time``."""
    found = ["time"]
    for name in names:
        while name in found:
            name += "_"
        found.append(name)
    return found[1:]


def _prototypes() -> list[str]:
    """Return the declarations of the public functions that the template defines."""
    keys = ["name", "guid", "version", "start", "guard"]
    blank: dict[str, Any] = {
        **dict.fromkeys(keys, "x"),
        "linear": None,
        "bands": 1,
        "prototypes": [],
    }
    text = render("fmi2.c", blank)
    pattern = r"^((?:fmi2\w+|const char \*|void)\s?\*?fmi2\w+\([^{]*?\))\n\{"
    return [f"API {' '.join(p.split())}" for p in re.findall(pattern, text, flags=re.MULTILINE)]


def _platform() -> tuple[str, str]:
    """Return the standard's name of this platform, and the suffix of its libraries."""
    bits = "64" if sys.maxsize > 2**32 else "32"
    system = {"Linux": "linux", "Darwin": "darwin", "Windows": "win"}.get(platform.system())
    if system is None:
        raise ParameterError(f"FMI 2.0 has no name for the platform {platform.system()!r}")
    return f"{system}{bits}", {"linux": ".so", "darwin": ".dylib", "win": ".dll"}[system]


def _compiled(files: dict[str, str], name: str, suffix: str) -> bytes:
    """Return the unit as a shared library."""
    found, options = _compiler(os.environ.get("CC") or "cc")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for file, text in files.items():
            (folder / file).write_text(text)
        library = folder / f"{name}{suffix}"
        sources = [file for file in files if file.endswith(".c")]
        command = [found, *_FLAGS, *options, *sources, "-lm", "-o", library.name]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, timeout=_PATIENCE, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(f"the compiler {found} failed: {error}") from None
        if done.returncode or not library.exists():
            raise OutputError(f"the compiler {found} failed: {done.stderr.strip()[:300]}")
        return library.read_bytes()


def _compiler(wanted: str) -> tuple[str, list[str]]:
    """Return the path of a compiler, and the options that follow its name."""
    try:
        name, *options = [wanted] if shutil.which(wanted) else shlex.split(wanted)
    except ValueError:
        name, options = wanted, []
    found = shutil.which(name)
    if found is None:
        raise ParameterError(f"there is no C compiler {wanted!r}; install one, or name it in CC")
    return found, options


def _archive(files: dict[str, bytes]) -> bytes:
    """Return the files as a zip; equal files give equal bytes."""
    store = io.BytesIO()
    with zipfile.ZipFile(store, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.external_attr = 0o644 << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
    return store.getvalue()

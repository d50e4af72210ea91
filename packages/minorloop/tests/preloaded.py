"""What `offspring` is forked off: a run was carried out here, so that all it needs is loaded."""

import contextlib
import io
import tempfile
from pathlib import Path

from minorloop.cli import main

with contextlib.suppress(ImportError):  # which runs on instruments need
    import pyvisa

    import minorloop.lab.drivers.visa  # noqa: F401

    pyvisa.ResourceManager("@py").close()

with (
    tempfile.TemporaryDirectory() as folder,
    contextlib.redirect_stderr(io.StringIO()),
    contextlib.redirect_stdout(io.StringIO()),
):
    plan, store = Path(folder, "plan.csv"), Path(folder, "runs.sqlite")
    plan.write_text("voltage [V],hold [s]\n1,30\n0,30\n", encoding="utf-8")
    main(["run", "--actuator", "twin:ipmc", "--plan", str(plan), "--store", str(store)])

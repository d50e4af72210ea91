"""What `offspring` is forked off: a run was carried out here, so that all it needs is loaded."""

import contextlib
import io
import tempfile
from pathlib import Path

from minorloop.cli import main

with (
    tempfile.TemporaryDirectory() as folder,
    contextlib.redirect_stderr(io.StringIO()),
    contextlib.redirect_stdout(io.StringIO()),
):
    plan, store = Path(folder, "plan.csv"), Path(folder, "runs.sqlite")
    plan.write_text("voltage [V],hold [s]\n1,30\n0,30\n", encoding="utf-8")
    main(["run", "--actuator", "twin:ipmc", "--plan", str(plan), "--store", str(store)])

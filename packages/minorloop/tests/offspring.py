"""Processes of their own, to be killed, that need not import everything anew.

They are forked off a server that has imported what they need, which takes milliseconds; a fresh
interpreter takes a second or two.
"""

import multiprocessing
import os
import sys
from contextlib import contextmanager
from functools import cache
from pathlib import Path

PRELOADED = ["preloaded"]
"""Modules that the server imports; tests of other packages may add some."""


@cache
def forking():
    """The context of the server, which has to find `preloaded` when it starts."""
    from multiprocessing.forkserver import ensure_running

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    path = os.environ.get("PYTHONPATH")
    here = str(Path(__file__).parent)
    os.environ["PYTHONPATH"] = here if path is None else f"{here}{os.pathsep}{path}"
    try:
        ensure_running()
    finally:
        del os.environ["PYTHONPATH"]
        if path is not None:
            os.environ["PYTHONPATH"] = path
    return context


def _carry_out(line, folder, log):
    from minorloop.cli import main

    os.chdir(folder)
    os.dup2(log.fileno(), 2)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(main(line.split()))


@contextmanager
def started(line, folder=None):
    """The process of a command line in a folder, the present one, and its log as a file."""
    log, theirs = forking().Pipe(duplex=False)
    place = str(Path.cwd() if folder is None else folder)
    process = forking().Process(target=_carry_out, args=(line, place, theirs))
    process.start()
    theirs.close()
    with log, os.fdopen(os.dup(log.fileno())) as lines:
        yield process, lines
    process.join()
    process.close()

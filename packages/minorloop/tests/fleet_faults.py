"""What a worker can be made to do instead of a fit, by the name of its specimen.

`hang` runs for ever in compiled code that holds the interpreter, behind all other processes. `die`
ends the process as a lack of memory does, and `wait` waits until the file
``wait.closed`` beside its record is gone. With ``-once`` after it only the first time. A file that
ends in ``.seen`` says that it began. This module is imported by worker processes.
"""

import os
import signal
import time
from collections import deque
from itertools import repeat

from threadpoolctl import threadpool_info

from minorloop.fleet._fitting import identify_one


def work(task, scratch):
    """Do what the name says, then identify."""
    what, *once = task.specimen.name.split("-")
    if _first(task.specimen) or once[:1] != ["once"]:
        if what == "hang":
            os.nice(19)
            deque(repeat(0), maxlen=0)
        if what == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        while what == "wait" and task.specimen.file.with_suffix(".closed").exists():
            time.sleep(0.01)
    return identify_one(task, scratch)


def _first(specimen):
    mark = specimen.file.with_suffix(".seen")
    seen = mark.exists()
    mark.touch()
    return not seen


def wait_until_seen(specimen, seconds=60.0):
    """Wait until a worker has begun with a specimen."""
    deadline = time.monotonic() + seconds
    while not specimen.file.with_suffix(".seen").exists():
        assert time.monotonic() < deadline, "it did not begin"
        time.sleep(0.01)


def threads():
    """How many threads linear algebra has; prints, which a worker must not take for an answer."""
    print("a library has its say", flush=True)
    found = {name: os.environ[name] for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    pools = threadpool_info()
    return found | {"blas": sorted({one["num_threads"] for one in pools})}

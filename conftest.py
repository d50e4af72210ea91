"""Common to all tests: repeatable examples, figures without a screen, measured data."""

import gc
import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import settings

os.environ["MPLBACKEND"] = "Agg"
# The tests start hundreds of processes: without files of bytecode each would compile the packages
# anew, and each worker would rewrite the asserts of all tests.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# The tests share the cores already: threads of their algebra would only wait for one another. Set
# before NumPy is imported, here and in every process that a test starts.
for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
# The C library then keeps the memory of large arrays for the next ones, instead of asking the
# system for cleared pages each time; it reads this when a worker starts.
os.environ.setdefault("MALLOC_MMAP_THRESHOLD_", str(1 << 28))
os.environ.setdefault("MALLOC_TRIM_THRESHOLD_", str(1 << 29))

settings.register_profile("short", deadline=None, derandomize=True, max_examples=30)
settings.register_profile("whole", settings.get_profile("short"), max_examples=100)
settings.load_profile("short")

# A shell without job control, and nohup, let commands ignore these, and some tests send them.
signal.signal(signal.SIGINT, signal.default_int_handler)
for name in ("SIGQUIT", "SIGHUP"):
    if hasattr(signal, name):
        signal.signal(getattr(signal, name), signal.SIG_DFL)

# The heap of a worker has half a million objects of modules. To look through them for garbage as
# often as the default does takes a tenth of the time of all Python code.
gc.set_threshold(50_000, 20, 50)

HERE = Path(__file__).resolve().parent
SHARED_DATA = HERE.parent / "shared" / "data"

# The longest files, the longest first: no worker is left with one of them at the end. The pages
# come after files that compile what the console needs: its processes would all compile it at once.
LONGEST = (
    "papers/tests/catheter/test_inspection_parts.py",
    "packages/minorloop-head/tests/ultrasound/test_pits.py",
    "packages/minorloop/tests/identification/test_dynamics.py",
    "tests/test_documents.py",
    "packages/minorloop-head/tests/console/test_pages.py",
    "packages/minorloop/tests/export/test_c99.py",
    "packages/minorloop-head/tests/console/test_session.py",
    "packages/minorloop-head/tests/console/test_mark.py",
    "packages/minorloop/tests/fleet/test_workers.py",
    "packages/minorloop/tests/fleet/test_cluster.py",
    "packages/minorloop-head/tests/cli/test_head.py",
    "packages/minorloop/tests/page/test_pages.py",
    "packages/minorloop/tests/identification/test_offset_steps.py",
    "packages/minorloop/tests/cli/test_identify.py",
    "packages/minorloop/tests/lab/test_store.py",
    "packages/minorloop-head/tests/inspection/test_sweep_wall.py",
    "packages/minorloop-head/tests/console/test_loop.py",
    "packages/minorloop-head/tests/console/test_processes.py",
    "packages/minorloop/tests/identification/test_preparation.py",
    "papers/tests/test_ipmc.py",
    "tests/faults/test_faults.py",
    "packages/minorloop/tests/identification/test_rational.py",
    "papers/tests/catheter/test_head_camera.py",
    "packages/minorloop/tests/fleet/test_identification.py",
    "packages/minorloop/tests/page/test_lab_work.py",
)


def compile_in_turn():
    """Let one worker at a time compile the functions of a file: the others load them."""
    try:
        import fcntl
    except ImportError:
        return
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.dispatcher import Dispatcher

    compiled, held = Dispatcher.compile, set()

    def compile_function(self, sig):
        source = self.py_func.__code__.co_filename
        if source in held or self._cache.cache_path is None:
            return compiled(self, sig)
        with global_compiler_lock, open(source, "rb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            held.add(source)
            try:
                return compiled(self, sig)
            finally:
                held.discard(source)

    Dispatcher.compile = compile_function


if "PYTEST_XDIST_WORKER" in os.environ:
    compile_in_turn()


def pytest_configure(config):
    """Try more examples where all tests run, and let each worker begin to collect at another file.

    Where no test was compiled before, each then compiles its share and loads those of the others.
    """
    if not config.option.markexpr:
        settings.load_profile("whole")
    whole = [HERE / each for each in config.args] == [
        HERE / each for each in config.getini("testpaths")
    ]
    if whole and "PYTEST_XDIST_WORKER" in os.environ:
        worker = int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw"))
        files = sorted(file for place in config.args for file in Path(place).rglob("test_*.py"))
        first = len(files) * worker // int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
        config.args[:] = map(str, files[first:] + files[:first])


def pytest_collection_modifyitems(items):
    """Begin with the longest files; pytest-xdist hands them out in this order."""
    rank = {HERE / name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: (rank.get(item.path, len(LONGEST)), item.path))


def pytest_collection_finish():
    """Leave what the collection has made out of every later search for garbage."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def shared_data():
    """Folder of measured records, beside the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip("needs the measured records in ../shared/data, which are not here")
    return SHARED_DATA


@pytest.fixture
def drawn():
    """Pictures of reports drawn, where all others are not."""


@pytest.fixture
def without_pictures(request, monkeypatch):
    """Reports whose figures are made and not drawn, which takes two thirds of a report.

    The tests of reports, those with `drawn`, the code blocks of the pages and the whole tests draw
    them.
    """
    if request.config.option.markexpr and "drawn" not in request.fixturenames:
        monkeypatch.setattr("minorloop.report.Picture.address", "data:image/svg+xml;base64,")

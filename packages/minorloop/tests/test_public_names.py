import inspect
import subprocess
import sys
from importlib import import_module

import pytest

import minorloop
from minorloop import errors

PUBLIC = """
Actuator Adaptive AfterEffect Apparatus BoucWen Cascade Channel Dynamics Fault Fit FleetError
Gaussian GeneralisedPrandtlIshlinskii InstrumentError LimitError Linear Memory MinorloopError
MissingExtraError ModelFileError ModelWarning NotInvertibleError Oscillator OutputError
ParameterError Plan Plane Polynomial PrandtlIshlinskii Preisach Record RecordError RelayModel
SafetyError Setup SignalError Smooth Store StoreError UnreachableError Vibration Viscosity
__version__ connect densities design drive_to excitation identify load measure
next_input plot read reduce resume run save score
"""
NAMES = set(PUBLIC.split())


def run(code):
    """Run code in a fresh interpreter; give what it printed."""
    command = [sys.executable, "-W", "error", "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def test_these_names_are_public():
    assert set(minorloop.__all__) == NAMES
    assert dir(minorloop) == sorted(NAMES)


def test_every_error_is_public():
    classes = {name for name, _ in inspect.getmembers(errors, inspect.isclass)}
    assert classes == {name for name in NAMES if name.endswith("Error")}


@pytest.mark.parametrize("name", sorted(NAMES))
def test_a_public_name_is_the_one_of_its_module(name):
    found = getattr(minorloop, name)
    if inspect.ismodule(found):
        assert found.__name__.endswith(f".{name}")
    elif name != "__version__":
        assert found.__name__ == name
        assert getattr(import_module(found.__module__), name) is found


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'minorloop' has no attribute 'hysteresis'"):
        _ = minorloop.hysteresis


def test_importing_it_imports_nothing_slow():
    loaded = run("import sys, minorloop; print(*sorted({m.split('.')[0] for m in sys.modules}))")
    slow = {"numba", "scipy", "matplotlib", "numpy", "msgspec", "typer", "rich", "jinja2", "pandas"}
    assert not slow & set(loaded.split())


def test_showing_a_store_imports_no_identification():
    loaded = run("import sys, minorloop.cli.runs, minorloop.lab.store; print(*sys.modules)").split()
    assert not {"scipy.special", "minorloop.identification", "minorloop.measurement"} & set(loaded)


IMPORTS = [
    "import minorloop",
    "import minorloop.connect",
    "import minorloop; minorloop.connect; import minorloop.connect",
    "import minorloop; from minorloop.connect import connect",
    "import minorloop; from minorloop import connect",
    "import minorloop; minorloop.Memory",
]
ANEW = f"""
import sys
for before in {IMPORTS}:
    for name in [name for name in sys.modules if name.startswith("minorloop")]:
        del sys.modules[name]
    exec(before)
    print(type(sys.modules["minorloop"].connect).__name__)
"""


def test_connect_is_the_function_whatever_was_imported_before():
    assert run(ANEW).split() == ["function"] * len(IMPORTS)

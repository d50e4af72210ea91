import zipfile

import numpy as np
import pytest

from minorloop import Cascade, Linear, OutputError, ParameterError, PrandtlIshlinskii, Preisach
from minorloop.export.fmu import export_fmu

fmpy = pytest.importorskip("fmpy", reason="needs fmpy, which minorloop[fmi] brings")
validation = pytest.importorskip("fmpy.validation")
pytestmark = pytest.mark.filterwarnings("ignore")  # fmpy's own
LAGS = Linear.from_poles([-20.0, -50.0], dc_gain=1.5, delay=0.03).discretise(0.01)


@pytest.fixture
def model():
    rng = np.random.default_rng(0)
    levels = np.sort(rng.uniform(-2, 3, 13))
    return Preisach(levels, np.tril(rng.uniform(0, 1, (12, 12))), 0.3, slope=0.1)


def simulated(path, u, interval):
    """Outputs of the unit after each step."""
    t = interval * np.arange(u.size + 1)
    held = np.append(u, u[-1])
    table = np.array(list(zip(t, held, strict=True)), dtype=[("time", float), ("voltage", float)])
    found = fmpy.simulate_fmu(
        str(path),
        stop_time=float(t[-1]),
        step_size=interval,
        output_interval=interval,
        input=table,
        output=["tip", "error_bound"],
    )
    assert found.size == t.size
    return found["tip"], found["error_bound"]


def test_valid_and_equal_to_python_one_row_later(model, tmp_path):
    path = tmp_path / "actuator.fmu"
    systems = export_fmu(model, path, input="voltage [V]", output="tip [mm]")
    assert not validation.validate_fmu(str(path))
    u = np.random.default_rng(1).uniform(-2.2, 3.2, 500)
    y, bound = simulated(path, u, 0.25)
    np.testing.assert_allclose(y[1:], model.simulate(u), atol=1e-12 * np.ptp(model.range))
    assert y[0] == pytest.approx(model.simulate(model.levels[:1])[0])
    assert not bound.any()
    names = zipfile.ZipFile(path).namelist()
    assert f"binaries/{systems[0]}/minorloop.so" in names
    assert {"sources/minorloop.c", "sources/minorloop.h"} <= set(names)


def instance_of(path, folder):
    from fmpy.fmi2 import FMU2Slave

    fmpy.extract(str(path), str(folder))
    described = fmpy.read_model_description(str(path))
    unit = FMU2Slave(
        guid=described.guid,
        unzipDirectory=str(folder),
        modelIdentifier=described.coSimulation.modelIdentifier,
        instanceName="one",
    )
    unit.instantiate()
    unit.setupExperiment()
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    return unit


def push(unit, u, step=1.0):
    unit.setReal([0], [u])
    unit.doStep(0.0, step)
    return unit.getReal([1])[0]


def test_states_can_be_kept_restored_and_reset(model, tmp_path):
    from fmpy.fmi1 import FMICallException

    export_fmu(model, tmp_path / "a.fmu")
    unit = instance_of(tmp_path / "a.fmu", tmp_path / "a")
    begin = unit.getReal([1])[0]
    push(unit, 1.0)
    state = unit.getFMUState()
    first = [push(unit, u) for u in (-1.0, 0.5)]
    data = unit.serializeFMUstate(state)
    unit.setFMUState(state)
    assert [push(unit, u) for u in (-1.0, 0.5)] == first
    again = unit.deSerializeFMUstate(data)
    unit.setFMUState(again)
    assert [push(unit, u) for u in (-1.0, 0.5)] == first
    for wrong in (data[:-1], b"\xff" * len(data)):
        with pytest.raises(FMICallException):
            unit.deSerializeFMUstate(wrong)
    unit.freeFMUstate(state)
    unit.reset()
    assert unit.getReal([1])[0] == begin
    unit.terminate()
    unit.freeInstance()


def test_wrong_calls_are_errors_of_the_unit(model, tmp_path):
    from fmpy.fmi1 import FMICallException

    export_fmu(Cascade(model, LAGS), tmp_path / "a.fmu")
    unit = instance_of(tmp_path / "a.fmu", tmp_path / "a")
    for wrong in (
        lambda: unit.setReal([0], [float("nan")]),
        lambda: unit.setReal([1], [0.0]),
        lambda: unit.getReal([7]),
        lambda: unit.doStep(0.0, 0.015),
        lambda: unit.doStep(0.0, -0.01),
        lambda: unit.getInteger([0]),
    ):
        with pytest.raises(FMICallException):
            wrong()
    assert np.isfinite(push(unit, 1.0, 0.02))
    unit.terminate()
    unit.freeInstance()


def test_equal_names_and_xml_characters_are_changed(model, tmp_path):
    export_fmu(model, tmp_path / "a.fmu", input="<x> & [V]", output="<x> & ['m']")
    assert not validation.validate_fmu(str(tmp_path / "a.fmu"))
    variables = fmpy.read_model_description(str(tmp_path / "a.fmu")).modelVariables
    assert [v.name for v in variables] == ["<x> &", "<x> &_", "error_bound"]


@pytest.mark.parametrize(
    ("file", "kind", "options", "compiler", "message"),
    [
        ("a.fmu", "plays", {}, "cc", "the model is a PrandtlIshlinskii"),
        ("a.fmu", "plain", {}, "no-such-compiler -O2", "no C compiler 'no-such"),
        ("a.fmu", "plain", {}, "false", "the compiler .* failed"),
        ("mine.fmu", "plain", {}, "cc", "exists already"),
    ],
)
def test_refusals(file, kind, options, compiler, message, model, tmp_path, monkeypatch):
    monkeypatch.setenv("CC", compiler)
    (tmp_path / "mine.fmu").write_text("mine")
    plays = PrandtlIshlinskii([0.0], [1.0])
    given = {"plain": model, "plays": plays, "lags": Cascade(model, LAGS)}[kind]
    with pytest.raises((ParameterError, OutputError), match=message):
        export_fmu(given, tmp_path / file, **options)

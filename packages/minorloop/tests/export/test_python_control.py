import sys

import numpy as np
import pytest

from later import Later
from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.creep import Creep
from minorloop.dynamics.linear import Linear
from minorloop.errors import MissingExtraError, ParameterError
from minorloop.export.python_control import as_memory, as_state, as_system
from minorloop.operators.memory import Memory
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach

REASON = "needs python-control: minorloop[control]"
control = Later("control", REASON)

RNG = np.random.default_rng(0)
PREISACH = Preisach(np.linspace(-1, 1, 9), np.tril(RNG.uniform(size=(8, 8))), slope=0.1)
PLAYS = PrandtlIshlinskii([0.0, 0.2, 0.5], [1.0, 0.5, 0.7], 0.1)
U = RNG.uniform(-1.1, 1.1, 120)
T = 0.1 * np.arange(U.size)


@pytest.fixture(autouse=True)
def _installed():
    # A folder of that name among the tests of another package passes for an empty one.
    pytest.importorskip("control.nlsys", reason=REASON)


@pytest.mark.parametrize("model", [PREISACH, PLAYS], ids=["preisach", "plays"])
@pytest.mark.parametrize("start", ["negative", "positive"])
def test_responses_equal_those_of_the_model(model, start):
    system = as_system(model, 0.1)
    found = control.input_output_response(system, T, U, as_state(model, start))
    np.testing.assert_allclose(found.outputs, model.simulate(U, start), atol=1e-12)


@pytest.mark.parametrize("operator", [PREISACH, PLAYS], ids=["preisach", "plays"])
@pytest.mark.parametrize("first", ["operator", "linear"])
def test_a_cascade_carries_dynamics_dead_time_and_creep(operator, first):
    creep = Creep([0.5, 3.0], [0.2, 0.1], 0.7)
    model = Cascade(operator, Linear.lags(0.3, 0.1, delay=0.2), first, creep)
    system = as_system(model, 0.1)
    state = as_state(model, before=0.3, interval=0.1)
    found = control.input_output_response(system, T, U, state)
    wanted = model.simulate(
        T, U, operator.memory("negative") if operator is PREISACH else "demagnetised", before=0.3
    )
    np.testing.assert_allclose(found.outputs, wanted, atol=1e-9)


@pytest.mark.parametrize("model", [PREISACH, PLAYS], ids=["preisach", "plays"])
def test_in_an_interconnection_an_integrator_holds_a_target(model):
    plant = as_system(model, 0.1, name="plant", feedthrough=False)
    integrator = control.tf([0.1, 0], [1, -1], 0.1, inputs="e", outputs="u", name="integrator")
    sums = control.summing_junction(["r", "-y"], "e")
    loop = control.interconnect([integrator, plant, sums], inputs="r", outputs="y", dt=0.1)
    low, high = PREISACH.range
    target = 0.4 * low + 0.6 * high if model is PREISACH else 1.5
    initial = np.zeros(loop.nstates)
    names = list(loop.state_labels)
    first = next(i for i, name in enumerate(names) if name.startswith("plant"))
    state = as_state(model)
    initial[first : first + state.size] = state
    t = 0.1 * np.arange(400)
    found = control.input_output_response(loop, t, np.full(400, target), initial)
    assert abs(found.outputs[-1] - target) < 1e-3 * (high - low)


def test_states_and_memories_convert_into_each_other():
    memory = Memory([-1.0, 0.8, -0.5, 0.3])
    state = as_state(PREISACH, memory, room=10)
    assert state.shape == (10,)
    assert as_memory(state) == memory
    assert as_memory(as_state(PREISACH)) == Memory.negative(-1.0)


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (0.0, "begins with 0.0 and not with the lowest level, -1.0"),
        (as_state(PREISACH, Memory([-1.0, 0.8, 0.3]), room=16), r"not a memory; .* with the room"),
        (np.append(as_state(PREISACH)[:-1], np.nan), r"not a memory; .* not finite"),
    ],
)
def test_refuses_to_simulate_from_a_state_that_is_not_a_memory(state, message):
    system = as_system(PREISACH, 0.1)
    padded = np.zeros(system.nstates)
    padded[: np.size(state)] = state
    with pytest.raises(ParameterError, match=message):
        control.input_output_response(system, T, U, padded)


def test_refusals():
    for room in (5, 6.5):
        with pytest.raises(ParameterError, match=f"room is {room}; give a whole number"):
            as_system(PREISACH, room=room)
    for interval in (0, -1.0, None, False):
        with pytest.raises(ParameterError, match="interval is"):
            as_system(PREISACH, interval)
    with pytest.raises(ParameterError, match="the model is a Polynomial"):
        as_system(Polynomial([1.0, 0.0], -1, 1))


def test_without_python_control_the_message_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'minorloop\[control\]'"):
        as_system(PREISACH)

"""The laws of models in time, for each kind of them, and what all kinds refuse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.creep import Creep, fit_creep
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.oscillator import Oscillator
from minorloop.dynamics.sampling import checked_stages, even_interval
from minorloop.dynamics.trajectory import Trajectory
from minorloop.errors import NotInvertibleError, ParameterError, SignalError
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.differential import BoucWen
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.preisach import Preisach

STEP = 0.4
WEIGHTS = np.tril(np.random.default_rng(0).uniform(0.3, 1, (4, 4)))
PLANE = Preisach(np.linspace(-1, 1, 5), WEIGHTS, slope=0.5)
G = Linear.from_poles([-2.0, -0.5], [-1.0], dc_gain=1.5)
LATE = Linear(G.numerator, G.denominator, delay=3 * STEP).discretise(STEP)
CREEP = Creep([1.0, 30.0], [0.15, 0.25], 0.6)
CRAWL = [0.2 * WEIGHTS, 0.1 * WEIGHTS]
MODELS = {
    "linear": LATE,
    "creep": CREEP,
    "operator first": Cascade(PLANE, G.discretise(STEP)),
    "linear first": Cascade(PLANE, LATE, "linear"),
    "operator first, creep": Cascade(PLANE, LATE, creep=CREEP),
    "linear first, creep": Cascade(PLANE, LATE, "linear", CREEP),
    "both sides": Cascade(PLANE, LATE, creep=CREEP, ahead=Linear.lags(0.7)).sampled(STEP),
    "field": AfterEffect(PLANE, np.linspace(0.02, 0.05, 4), 3.0),
    "creeping relays": AfterEffect(PLANE, times=[0.2, 5.0], creep=CRAWL),
    "viscous relays": AfterEffect(PLANE, 20.0, 0.5),
}
INPUTS = st.lists(st.floats(-1.5, 1.5), min_size=2, max_size=30)


def parts(name, before):
    """State that has settled at an input, step, and whole simulation of a model from there."""
    model = MODELS[name]
    if isinstance(model, AfterEffect):
        memory = PLANE.step("negative", before)[1]
        step = lambda state, u: model.step(state, u, STEP)  # noqa: E731
        return memory, step, lambda t, u: model.simulate(t, u, memory)
    whole = lambda t, u: model.simulate(t, u, before=before)  # noqa: E731
    if isinstance(model, Cascade):
        return model.begin(before), model.step, whole
    step = model.step
    if isinstance(model, Creep):
        step = lambda state, u: model.step(state, u, STEP)  # noqa: E731
    return model.settled(before), step, whole


@pytest.mark.parametrize("name", MODELS)
@given(u=INPUTS, before=st.floats(-1, 1))
@settings(max_examples=20)
def test_single_steps_resumed_at_any_cut_equal_simulate(name, u, before):
    state, step, whole = parts(name, before)
    y = []
    for value in u:
        out, after = step(state, value)
        assert step(state, value)[0] == out  # the state before it did not change
        state = after
        y.append(out)
    t = STEP * np.arange(1, len(u) + 1)
    np.testing.assert_allclose(y, whole(t, u), rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", MODELS)
@given(before=st.floats(-1, 1))
@settings(max_examples=10)
def test_a_settled_model_stays_constant(name, before):
    _, _, whole = parts(name, before)
    y = whole(STEP * np.arange(1, 20), np.full(19, before))
    np.testing.assert_allclose(y, y[0], rtol=0, atol=1e-9)


LAG, SAMPLED = Linear.lags(1.0), Linear.lags(1.0).discretise(1.0)
LINE, LAW = Polynomial([0.0, 2.0], -50.0, 50.0), BoucWen(5e4, 800.0, -1100.0)
T = np.arange(300) / 750
FORCE = 60 * np.sin(2 * np.pi * 33 * T)
REFUSED = [
    (ParameterError, "no more zeros than poles", lambda: Linear([1, 2, 3], [1, 2])),
    (ParameterError, "finite coefficients", lambda: Linear([np.nan], [1.0])),
    (ParameterError, "dead time >= 0", lambda: Linear([1.0], [1.0, 1.0], delay=-1)),
    (ParameterError, "positive number of s", lambda: Linear([1.0], [1.0, 1.0], interval=0.0)),
    (ParameterError, "whole number", lambda: Linear([1.0], [1.0, 0.5], interval=1.0, delay=0.5)),
    (ParameterError, "conjugate pairs", lambda: Linear.from_poles([-1 + 1j])),
    (ParameterError, "sampled already", lambda: SAMPLED.discretise(1.0)),
    (ParameterError, "negative real axis", lambda: Linear([1], [1, 0.5], 1.0).continuous()),
    (ParameterError, "discretise", lambda: LAG.settled(1.0)),
    (ParameterError, "not settle", lambda: Linear([1], [1, 0]).simulate([0, 1], [1, 1], before=1)),
    (ParameterError, "holds", lambda: SAMPLED.simulate([0, 1], [1, 1], between="straight")),
    (SignalError, "not increase at index 2", lambda: SAMPLED.simulate([0, 1, 1], [0, 0, 0])),
    (SignalError, "steps of 1 s", lambda: SAMPLED.simulate([0, 1, 3], [0, 0, 0])),
    (ParameterError, "integrates", lambda: Linear([1.0], [1.0, 0.0]).normalised()),
    (ParameterError, "one strength for each time", lambda: Creep([1.0, 2.0], [0.1])),
    (ParameterError, "numbers >= 0", lambda: Creep([1.0], [-0.1])),
    (NotInvertibleError, "prompt", lambda: Creep([1], [1], 0).compensate([0, 1], [0, 1], before=0)),
    (ParameterError, "shortest <= longest", lambda: fit_creep([0, 1, 2], [0, 1, 1], [0, 1, 1])),
    (ParameterError, "linear' and ahead", lambda: Cascade(PLANE, G, "linear", ahead=LAG)),
    (ParameterError, "'operator', 'linear'", lambda: Cascade(PLANE, G, "both")),
    (ParameterError, "give a share of the range", lambda: Cascade(PLANE, G, noise=2.0)),
    (ParameterError, r"0\.2 s and that", lambda: MODELS["operator first"].sampled(0.2)),
    (SignalError, "does not increase", lambda: Cascade(PLANE, G).simulate([0, 0], [0, 1])),
    (NotInvertibleError, "right half plane", lambda: inverse(Linear.from_poles([-1, -2], [3]))),
    (NotInvertibleError, "on the imaginary axis", lambda: inverse(Linear([1.0, 0.0], [1.0, 1.0]))),
    (ParameterError, "DC gain 1", lambda: Trajectory(PLANE, LAG, Linear([1.1], [2.0, 1.0]))),
    (SignalError, "does not increase", lambda: Trajectory(PLANE, LAG).simulate([0, 0], [0, 1])),
    (ParameterError, "mass is 0 kg; give a positive", lambda: Oscillator(0.0, 1.0, 1.0, LAW)),
    (SignalError, "without bound", lambda: Oscillator(2.0, -5e3, 5e4, LAW).simulate(T, FORCE)),
    (ParameterError, "odd number of symmetric taps", lambda: checked_stages([(2, [0.5, 0.5])], 2)),
    (SignalError, "index 1 is 2 s", lambda: even_interval(np.array([0.0, 1.0, 3.0, 4.0]))),
]


def inverse(system, **options):
    return Cascade(LINE, system).invert([0, 0.01], [0, 0], before=0.0, **options)


@pytest.mark.parametrize(("error", "words", "make"), REFUSED)
def test_says_what_is_wrong(error, words, make):
    with pytest.raises(error, match=words):
        make()

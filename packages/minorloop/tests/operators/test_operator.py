"""The laws of an operator, for each kind of it, and what all kinds refuse."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import NotInvertibleError, ParameterError, SignalError, UnreachableError
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.densities import FactoredGaussianDensity
from minorloop.operators.differential import BoucWen, Duhem
from minorloop.operators.generalised_prandtl_ishlinskii import (
    DeadZones,
    GeneralisedPrandtlIshlinskii,
)
from minorloop.operators.memory import Memory
from minorloop.operators.plane import integrate_density
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel

PLANE = np.tril(np.random.default_rng(0).uniform(0.1, 1.0, (5, 5)))
LEVELS = np.array([-1.0, -0.75, -0.2, 0.0, 0.6, 1.0])


def operators(offset=0.3):
    """One operator of each kind, by its name."""
    plays = PrandtlIshlinskii([0.0, 0.2, 0.5], [1.0, 0.5, 0.25], offset)
    zones = DeadZones.from_slopes([-0.8, 0.4], [0.2, 1.0, 0.4])
    return {
        "plane": Preisach(LEVELS, PLANE, offset, "bipolar", "uniform", 0.5),
        "reversible": Preisach(LEVELS, PLANE, offset, "unipolar", "reversible"),
        "relays": RelayModel.from_preisach(Preisach(LEVELS, PLANE, offset)),
        "plays": plays,
        "signed plays": PrandtlIshlinskii([0.0, 0.2, 0.5], [1.0, -0.4, 0.3], offset),
        "plays and zones": GeneralisedPrandtlIshlinskii(plays, zones, offset=7.0),
        "polynomial": Polynomial([offset, 8.2, -0.35], -1.0, 1.0),
        "bouc-wen": BoucWen(5.0 + offset, 1.0, 0.3, 1.0),
        "duhem": Duhem([-1.0, 0.0, 1.0], [2.0, 1.5, 1.0 + offset], [1.0 + offset, 1.5, 2.0]),
    }


def of(*without):
    return pytest.mark.parametrize("kind", [one for one in operators() if one not in without])


every, inverted = of(), of("relays")
erasing = of("polynomial", "bouc-wen", "duhem")
signals = st.lists(st.floats(-1, 1), min_size=1, max_size=30).map(np.array)


@every
@given(u=signals)
def test_the_output_does_not_depend_on_the_rate(kind, u):
    model = operators()[kind]
    thrice = model.simulate(np.repeat(u, 3))[2::3]
    np.testing.assert_allclose(thrice, model.simulate(u), rtol=1e-12, atol=1e-12)


@of("bouc-wen", "duhem")
@given(u=signals)
def test_the_output_never_falls_while_the_input_rises(kind, u):
    steps = np.diff(operators()[kind].simulate(u)) * np.sign(np.diff(u))
    assert (steps >= -1e-12).all()


@erasing
@given(past=signals, u=signals)
def test_a_larger_input_wipes_out_the_past(kind, past, u):
    model, swing = operators()[kind], np.array([1.6, -1.6])
    found = [model.simulate(np.concatenate([one, swing, u])) for one in (past, past[:0])]
    np.testing.assert_allclose(found[0][past.size + 1 :], found[1][1:], rtol=0, atol=1e-12)


@of("plays and zones", "bouc-wen", "duhem")
@given(one=signals, other=signals)
def test_loops_between_equal_inputs_are_congruent(kind, one, other):
    loop = np.concatenate([[0.4, -0.3], np.linspace(-0.3, 0.4, 9), np.linspace(0.4, -0.3, 9)])
    shapes = [operators()[kind].simulate(np.append(past, loop))[-18:] for past in (one, other)]
    np.testing.assert_allclose(*(y - y[0] for y in shapes), rtol=0, atol=1e-12)


@inverted
@given(u=signals, cut=st.integers(0, 30))
def test_steps_trackers_and_parts_give_what_simulate_gives(kind, u, cut):
    model, whole = operators()[kind], operators()[kind].simulate(u)
    tracker, other, stepped = model.track(), model.track(), []
    memory = tracker.memory
    for k, sample in enumerate(u):
        if k == cut:
            rest = model.simulate(u[cut:], tracker.memory)
            np.testing.assert_allclose(rest, whole[cut:], rtol=1e-12, atol=1e-12)
            other = tracker.copy()
        foreseen = tracker.peek(sample)
        y, memory = model.step(memory, sample)
        assert tracker.push(sample) == foreseen == pytest.approx(y, rel=1e-12, abs=1e-12)
        stepped.append(y)
    np.testing.assert_allclose(stepped, whole, rtol=1e-12, atol=1e-12)
    if cut < u.size:  # a copy stays where it was
        assert other.push(u[cut]) == pytest.approx(whole[cut], rel=1e-12, abs=1e-12)


@inverted
@given(past=signals, u=signals)
def test_the_inverse_brings_the_output_back_from_any_past(kind, past, u):
    model = operators()[kind]
    tracker = model.track()
    for sample in past:
        tracker.push(sample)
    wanted = model.simulate(u, tracker.memory)
    found = model.invert(wanted, tracker.memory, "clip")
    again = model.simulate(found.u, tracker.memory)
    np.testing.assert_allclose(again, wanted, atol=1e-9)
    np.testing.assert_allclose(found.y, again, atol=1e-12)
    before = tracker.peek(0.0)
    aimed = tracker.aim(wanted[0], "clip")
    assert tracker.peek(aimed) == pytest.approx(wanted[0], abs=1e-9)
    assert tracker.peek(0.0) == before


@of("relays", "plays", "signed plays", "plays and zones", "duhem")
def test_targets_beyond_the_range_are_refused_or_approached(kind):
    model = operators()[kind]
    low, high = model.range
    memory = model.step("demagnetised", 0.0)[1]
    for far in (high + 1, high + 1e300, low - 1):
        with pytest.raises(UnreachableError, match=r'index 1 is beyond .* pass unreachable="clip"'):
            model.invert([model.step(memory, 0.1)[0], far], memory)
        with pytest.raises(UnreachableError, match="beyond what the model can reach"):
            model.aim(memory, far) if hasattr(model, "aim") else model.track().aim(far)
    clipped = model.invert([low - 1, high + 1, (low + high) / 2], memory, unreachable="clip")
    assert clipped.reachable.tolist() == [False, False, True]
    np.testing.assert_allclose(clipped.y[:2], [low, high], atol=1.1e-3 * (high - low))


@every
def test_signals_in_rows_are_independent_in_threads_too(kind):
    model, u = operators()[kind], np.random.default_rng(2).uniform(-1, 1, (7, 50))
    alone = [model.simulate(row) for row in u]
    np.testing.assert_array_equal(model.simulate(u), alone)
    with ThreadPoolExecutor(4) as pool:
        np.testing.assert_array_equal(list(pool.map(model.simulate, u)), alone)
    assert model.simulate(np.empty((0, 5))).shape == (0, 5)


@every
def test_equality_is_of_values(kind):
    model = operators()[kind]
    assert model == operators()[kind]
    assert model != operators(0.4)[kind]
    assert model != 1.0
    with pytest.raises(AttributeError):
        model.offset = 1.0


@every
@pytest.mark.parametrize("u", [[0.0, np.nan], [np.inf], ["a"], [[[1.0]]], 3.0])
def test_refuses_wrong_signals(kind, u):
    with pytest.raises(SignalError):
        operators()[kind].simulate(u)


@inverted
def test_refuses_wrong_targets_inputs_and_options(kind):
    model = operators()[kind]
    memory = model.track().memory
    with pytest.raises(SignalError, match="one sequence"):
        model.invert([[0.0, 1.0]])
    with pytest.raises(ParameterError, match="unreachable"):
        model.invert([0.0], unreachable="ignore")
    for value in (np.nan, np.inf, -np.inf):
        tracker = model.track()
        with pytest.raises(ParameterError, match="finite"):
            model.step(memory, value)
        with pytest.raises(ParameterError, match="finite"):
            tracker.push(value)
        with pytest.raises(ParameterError, match="finite"):
            tracker.aim(value)
        assert tracker.peek(0.5) == model.track().peek(0.5)


@of("polynomial")
def test_refuses_an_unknown_start(kind):
    with pytest.raises(ParameterError, match="start is 'cold'; give one of 'negative', "):
        operators()[kind].simulate([0.0], "cold")


def preisach(**options):
    return Preisach(**{"levels": LEVELS, "weights": np.zeros((5, 5)), **options})


FIELD = {"field": 0.1, "settling": 1.0}


def after_effect(**options):
    return AfterEffect(Preisach(LEVELS, PLANE), **options)


U, GONE = np.arange(60.0), np.full(60, np.nan)
plays, bent = PrandtlIshlinskii, GeneralisedPrandtlIshlinskii
fit, fit_bent = partial(bent.fit, thresholds=0), bent.fit
ZONES, STILL = DeadZones([0.0], [1.0]), np.zeros(60)
LIMITED, FREE = BoucWen(5e4, 800.0, 1100.0), BoucWen(5e4, 800.0, -1100.0)
BUTTERFLY = Preisach([-1, 0, 1], [[-1.0, 0.0], [0.0, 1.0]])
FLAT = bent(plays([0.0], [1.0]), DeadZones([0.0, 1.0], [1.0, -1.0]))
FALLING = BoucWen(1.0, -1.0, 0.9)
REFUSED = [
    (ParameterError, r"shape \(4, 4\)", lambda: preisach(weights=np.zeros((4, 4)))),
    (ParameterError, "above the diagonal", lambda: preisach(weights=np.ones((5, 5)))),
    (ParameterError, "not strictly increasing", lambda: preisach(levels=LEVELS[::-1])),
    (ParameterError, "'bipolar', 'unipolar'", lambda: preisach(relay="tripolar")),
    (ParameterError, "finite", lambda: preisach(offset=np.nan)),
    (ParameterError, "scale the input up", lambda: preisach(levels=[0, 1e-300, 1, 2, 3, 4])),
    (ParameterError, "in a larger unit", lambda: preisach(weights=np.tri(5) * 1e300)),
    (ParameterError, "alpha >= beta", lambda: preisach().everett(0.0, 0.1)),
    (NotInvertibleError, "signed=False", lambda: BUTTERFLY.invert([0.0])),
    (ParameterError, "cannot represent", lambda: RelayModel.from_preisach(preisach(slope=1.0))),
    (ParameterError, "start", lambda: operators()["relays"].simulate([0.0], "demagnetised")),
    (SignalError, "finite", lambda: operators()["relays"].stepping_inverse([np.nan])),
    (ParameterError, "as many weights", lambda: plays([0.0, 1.0], [1.0])),
    (ParameterError, "increasing: 1 at index 1", lambda: plays([0.0, 1.0, 1.0], [1.0] * 3)),
    (ParameterError, "no input leads to", lambda: plays([0, 1], [1, 1]).step([0.0, 1.5], 0.0)),
    (NotInvertibleError, "radius is 0.5", lambda: plays([0.5, 1.0], [1.0, 1.0]).invert([0.0])),
    (NotInvertibleError, "up to -0.5", lambda: plays([0, 1], [1, -1.5]).aim("negative", 0.0)),
    (SignalError, "constant", lambda: fit(STILL, U)),
    (SignalError, "5 measured samples for 13", lambda: fit(np.arange(5.0), np.arange(5.0))),
    (ParameterError, "whole number >= 1", lambda: fit(U, U, radii=0)),
    (ParameterError, "give a PrandtlIshlinskii", lambda: bent(ZONES, ZONES)),
    (NotInvertibleError, "piece 1 of the dead zones has slope 0", lambda: FLAT.invert([0.0])),
    (SignalError, "60 measured samples for 73", lambda: fit_bent(U, U, thresholds=60)),
    (ParameterError, "knot is zero", lambda: DeadZones.from_slopes([0.0], [1.0, 2.0])),
    (ParameterError, "thresholds are not strictly", lambda: DeadZones([1.0, 0.0], [1.0, 1.0])),
    (NotInvertibleError, "piece 1", lambda: DeadZones([-1.0, 2.0], [1.0, 3.0]).invert(0.0)),
    (ParameterError, "low < high", lambda: Polynomial([1.0], 1, 1)),
    (ParameterError, "reach beyond 1e", lambda: Polynomial([0.0, 1.0, 0.2], -1e155, 1.0)),
    (NotInvertibleError, "constant", lambda: Polynomial([3.0], 0.0, 1.0).invert([3.0])),
    (SignalError, "2 different inputs", lambda: Polynomial.fit([0, 1], [0, 1], 2)),
    (SignalError, "needs at least 3", lambda: Polynomial.fit([0, 1, 1], [0, 1, 2], 2)),
    (ParameterError, "alpha is -1; give a positive slope", lambda: BoucWen(-1.0, 0.0, 0.0)),
    (ParameterError, r"exponent is 0\.1; give at least", lambda: BoucWen(1.0, 0.0, 0.0, 0.1)),
    (ParameterError, "give 2 finite slopes", lambda: Duhem([0.0, 1.0], [1.0], [1.0, 1.0])),
    (ParameterError, "the output has no limit", lambda: FREE.simulate([0.0], "negative")),
    (ParameterError, "input is not known", lambda: LIMITED.invert([0.0], "negative")),
    (NotInvertibleError, "must be positive", lambda: FALLING.invert([0.6], [0.0, 1.0])),
    (ParameterError, "give fields >= 0", lambda: after_effect(field=-0.1, settling=1.0)),
    (ParameterError, "give a field or creep", lambda: after_effect(times=[1.0], **FIELD)),
    (ParameterError, "one number, or 5", lambda: after_effect(field=[0.1, 0.2], settling=1.0)),
    (ParameterError, "increasing positive seconds", lambda: after_effect(times=[2.0, 1.0])),
    (ParameterError, "alpha >= beta", lambda: after_effect(times=[1.0], creep=np.ones((1, 5, 5)))),
    (SignalError, "at index 2", lambda: after_effect().simulate([0, 1, 1], [0, 0, 0])),
    (ParameterError, "interval", lambda: after_effect().track().push(0.0, 0.0)),
    (ParameterError, "spread is 0; give a", lambda: FactoredGaussianDensity(1.0, 0.0)),
    (ParameterError, "on the whole plane", lambda: integrate_density(LEVELS, lambda a, b: a / 0)),
    (ParameterError, "does not nest", lambda: Memory([0, -1])),
    (ParameterError, "does not nest", lambda: Memory([0, 2, 1, 2])),
    (ParameterError, "input 1 is NaN", lambda: Memory.after([0.5, np.nan], low=-1, high=1)),
]


@pytest.mark.parametrize(("error", "words", "make"), REFUSED)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_says_what_is_wrong(error, words, make):
    with pytest.raises(error, match=words):
        make()

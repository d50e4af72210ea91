import dataclasses
import re
import subprocess

import numpy as np
import pytest

import compiled
from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.linear import Linear
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.export.c99 import source
from minorloop.operators.dead_zones import DeadZones
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.memory import Memory
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel

LAGS = Linear.lags(0.05, 0.02, dc_gain=1.5, delay=0.03).discretise(0.01)


def operator(bands=12, seed=0, signed=False, **options):
    rng = np.random.default_rng(seed)
    levels = np.sort(rng.uniform(-2, 3, bands + 1))
    weights = np.tril(rng.uniform(0, 1, (bands, bands)) - 0.3 * signed)
    weights[rng.random((bands, bands)) < 0.2] = 0.0
    return Preisach(levels, weights, 0.3, **options)


KINDS = {
    "plain": ({}, {}),
    "sloped": ({"slope": 0.5, "diagonal": "reversible", "relay": "unipolar"}, {}),
    "signed": ({"signed": True}, {"inverse": False, "memory": 8}),
    "lags after it": ({"slope": 0.1}, {"linear": LAGS}),
    "lags before it": ({"slope": 0.1}, {"linear": LAGS, "first": "linear"}),
    "a gain after it": ({}, {"linear": Linear([2.0], [1.0], 0.01)}),
    "little memory": ({}, {"memory": 6}),
    "one band": ({"bands": 1}, {}),
    "many bands": ({"bands": 300}, {}),
}


BUILDS = [("gcc", False), ("clang", True)]


@pytest.mark.parametrize(
    ("kind", "cc", "float32"),
    [("plain", "gcc", True), ("plain", "clang", False)]
    + [(kind, *build) for kind in KINDS for build in BUILDS],
)
def test_compiles_without_a_warning_and_passes_its_own_test(kind, float32, cc, tmp_path):
    built, options = KINDS[kind]
    code = source(operator(**built), float32=float32, **options)
    said = compiled.self_test(code, tmp_path, *compiled.SANITIZED, cc=cc)
    assert said.startswith("worst error")
    moves = kind != "one band"  # whose only weight is 0
    assert ("inverse" in said) == (moves and options.get("inverse", True))


@pytest.mark.parametrize("kind", ["plain", "lags after it", "lags before it", "a gain after it"])
def test_a_self_test_detects_a_wrong_inverse(kind, tmp_path):
    built, options = KINDS[kind]
    code = source(operator(**built), **options)
    wrong = re.sub(r"(return u)(;| / GAIN;)", r"\1 * (real)1.001\2", code.files["minorloop.c"])
    assert wrong.count("1.001") == 2  # march gives what aim gives on
    dataclasses.replace(code, files={**code.files, "minorloop.c": wrong}).write(tmp_path)
    program = compiled.build(tmp_path, ["minorloop.c", "minorloop_selftest.c"])
    done = subprocess.run([program], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 1
    assert "forward" in done.stdout


def shifted(base, width, bands=10):
    """A model whose inputs have an offset."""
    weights = np.tril(np.random.default_rng(1).uniform(0, 1, (bands, bands)))
    return Preisach(base + np.linspace(0, width, bands + 1), weights)


@pytest.mark.parametrize("diagonal", ["uniform", "reversible"])
@pytest.mark.parametrize("relay", ["bipolar", "unipolar"])
def test_the_last_digit_of_no_input_changes_the_output_by_more_than_stated(relay, diagonal):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        levels = np.cumsum(rng.uniform(0.05, 1, 9) ** 3) + rng.uniform(0, 5)
        weights = np.tril(rng.uniform(0, 1, (8, 8)) ** 4)
        model = Preisach(levels, weights, relay=relay, diagonal=diagonal, slope=rng.uniform(0, 1))
        narrow = int(np.argmin(np.diff(levels)))
        within = rng.uniform(levels[narrow], levels[narrow + 1], 400)
        u = np.where(rng.uniform(size=400) < 0.5, within, rng.choice(levels, 400)).astype(
            np.float32
        )
        beside = np.nextafter(u, np.float32(np.inf)).astype(np.float64)
        change = np.abs(model.simulate(beside) - model.simulate(u.astype(np.float64))).max()
        stated = source(model, float32=True).input_error
        assert change <= 1.01 * stated * np.ptp(model.range)


def test_refuses_an_offset_that_leaves_no_digits():
    model = shifted(1e6, 1.0)
    assert source(model).input_error < 1e-8
    with pytest.raises(ParameterError, match=r"last digit of a float near .* export doubles"):
        source(model, float32=True)


def with_offset(model, offset):
    return dataclasses.replace(model, offset=offset)


@pytest.mark.parametrize("offset", [1e5, 1e9, -1e9, 1e30])
@pytest.mark.parametrize(
    "model",
    [
        operator(),
        operator(bands=1, seed=1),
        PrandtlIshlinskii([0.0, 0.2], [1.0, 0.5]),
        RelayModel([0.0, 0.4, 1.0], np.tril(np.ones((3, 3)))),
    ],
    ids=["Preisach", "one band", "plays", "relays"],
)
def test_refuses_an_output_within_the_last_digits_of_its_offset(model, offset):
    moved = with_offset(model, offset * np.ptp(model.simulate([-3.0, 4.0, -3.0])))
    with pytest.raises(ParameterError, match=r"of the range of the output.* export doubles"):
        source(moved, float32=True, inverse=False)


def scaled(u=1.0, y=1.0):
    model = operator(bands=4)
    return Preisach(model.levels * u, model.weights * y, 0.3 * y)


TOO_FAR = [(1, 1e-20, True), (1, 1e25, True), (1e38, 1, True), (1e-20, 1, True)]
TOO_FAR += [(1, 1e-300, False), (1, 1e160, False)]


@pytest.mark.parametrize(("u", "y", "float32"), TOO_FAR)
def test_refuses_ranges_beyond_the_type(u, y, float32):
    plays = PrandtlIshlinskii([0.0, 0.2], [y, 0.5 * y])
    relays = RelayModel(np.arange(3.0) * u, np.tril(np.ones((3, 3))))
    for model in (scaled(u, y), plays if u == 1 else relays):
        with pytest.raises(ParameterError, match=r"put goes from .* can have ranges from 1e-1"):
            source(model, float32=float32, inverse=False)


def random_inputs(model, count, rng):
    """Jumps over the whole plane and beyond, small steps, thresholds, and repeats."""
    low, high = model.levels[[0, -1]]
    jumps = rng.uniform(low - 0.1, high + 0.1, count)
    steps = low + (high - low) * np.abs((rng.normal(0, 0.02, count).cumsum() % 2) - 1)
    thresholds = rng.choice(model.levels, count)
    kinds = np.repeat(rng.integers(0, 4, count // 50 + 1), 50)[:count]
    return np.choose(kinds, [jumps, steps, thresholds, np.full(count, jumps[0])])


@pytest.mark.parametrize("kind", ["plain", "sloped"])
def test_a_million_random_inputs_give_the_outputs_of_python(kind, tmp_path):
    model = operator(bands=30, **KINDS[kind][0])
    u = random_inputs(model, 1_000_000, np.random.default_rng(1))
    y, bound = compiled.Compiled(source(model, memory=200), tmp_path).walk(u)
    assert not bound.any()
    assert np.abs(y - model.simulate(u)).max() <= 1e-12 * np.ptp(model.range)


def test_a_million_random_targets_are_reached(tmp_path):
    model = operator(bands=30, slope=0.2)
    targets = np.random.default_rng(2).uniform(*model.range, 1_000_000)
    u, y = compiled.Compiled(source(model), tmp_path).chase(targets)
    width = np.ptp(model.range)
    assert np.abs(y - targets).max() <= 1e-12 * width
    assert np.abs(model.simulate(u[:1000]) - targets[:1000]).max() <= 1e-12 * width


def test_single_precision_is_right_to_six_digits_of_the_range(tmp_path):
    model = operator(bands=30)
    code = compiled.Compiled(source(model, float32=True, memory=200), tmp_path)
    u = random_inputs(model, 1_000_000, np.random.default_rng(3)).astype(np.float32)
    width = np.ptp(model.range)
    assert np.abs(code.walk(u)[0] - model.simulate(u)).max() < 5e-6 * width
    targets = np.random.default_rng(4).uniform(*model.range, 100_000).astype(np.float32)
    assert np.abs(code.chase(targets)[1] - targets).max() < 5e-6 * width


@pytest.mark.parametrize("first", ["operator", "linear"])
def test_the_linear_part_equals_a_cascade(first, tmp_path):
    model = operator(slope=0.1)
    code = compiled.Compiled(source(model, linear=LAGS, first=first), tmp_path)
    u = np.random.default_rng(5).uniform(*model.levels[[0, -1]], 300)
    cascade = Cascade(model, LAGS, first)
    low = model.levels[0] if first == "operator" else model.levels[0] / LAGS.dc_gain
    state, expected = cascade.begin(float(low)), []
    for sample in u:
        y, state = cascade.step(state, float(sample))
        expected.append(y)
    np.testing.assert_allclose(code.walk(u)[0], expected, atol=1e-12 * np.ptp(expected))


@pytest.mark.parametrize("first", ["operator", "linear"])
def test_with_a_linear_part_the_output_settles_at_the_target(first, tmp_path):
    model = operator()
    code = compiled.Compiled(source(model, linear=LAGS, first=first), tmp_path)
    gain = LAGS.dc_gain if first == "operator" else 1.0
    target = gain * (0.7 * model.range[1] + 0.3 * model.range[0])
    y = code.chase(np.full(400, target))[1]
    assert abs(y[-1] - target) < 1e-6 * np.ptp(model.range)


def bounded(model, u, room):
    """Outputs when the pair with the least effect is dropped after ``room`` extrema."""
    low, high = model.levels[[0, -1]]
    swing, extrema, y = 2.0 if model.relay == "bipolar" else 1.0, (float(low),), []
    size = Preisach(model.levels, np.abs(model.weights), 0.0, model.relay, model.diagonal)
    for sample in u:
        extrema = Memory.after([*extrema, sample], low=low, high=high).extrema
        y.append(float(model.simulate([extrema[-1]], Memory(extrema))[0]))
        past = extrema[:-1]
        if len(past) < room:
            continue
        losses = []
        for k in range(1, len(past) - 2):
            a, b, c, d = past[k - 1 : k + 3]
            corners = size.everett(max(a, b), min(a, b)) - size.everett(max(b, c), min(b, c))
            corners += size.everett(max(c, d), min(c, d)) - size.everett(max(a, d), min(a, d))
            losses.append(abs(float(corners)) * swing)
        least = 1 + int(np.argmin(losses))
        extrema = (*past[:least], *past[least + 2 :], extrema[-1])
    return np.array(y)


def deep_inputs(model, count, rng):
    """Repeated alternations with decreasing amplitude, so that histories are long."""
    low, high = model.levels[[0, -1]]
    middle, half = rng.uniform(0.4, 0.6) * (low + high), (high - low) / 2
    k = np.arange(count)
    shrink = 1 - (k % 97) / 97 * rng.uniform(0.8, 1.0)
    return middle + half * shrink * np.where(k % 2, 1, -1) * rng.uniform(0.8, 1, count)


@pytest.mark.parametrize("room", [6, 9, 20])
@pytest.mark.parametrize("signed", [False, True])
def test_the_smallest_loop_is_dropped(room, signed, tmp_path):
    model = operator(bands=9, signed=signed)
    u = deep_inputs(model, 500, np.random.default_rng(room))
    code = source(model, memory=room, inverse=not signed)
    y, bound = compiled.Compiled(code, tmp_path).walk(u)
    expected = bounded(model, u, room)
    assert (bound > 0).any()
    np.testing.assert_allclose(y, expected, atol=1e-10 * np.ptp(y))


@pytest.mark.parametrize("signed", [False, True])
def test_the_error_is_within_the_bound(signed, tmp_path):
    model = operator(bands=9, signed=signed)
    width = np.ptp(model.range)
    for room in (6, 8, 16):
        code = source(model, memory=room, inverse=not signed)
        folder = tmp_path / str(room)
        u = deep_inputs(model, 20_000, np.random.default_rng(room))
        u[::701] = model.levels[-1]
        y, bound = compiled.Compiled(code, folder).walk(u)
        error, allowed = np.abs(y - model.simulate(u)), np.append(0.0, bound[:-1])
        assert (error[1:] > 1e-6 * width).any()
        assert (error <= np.maximum(allowed, bound) + 1e-11 * width).all()
        assert np.diff(bound).max() <= code.drop_error * (1 + 1e-9)
        assert (bound[701::701] == 0).all()  # saturation heals all


def test_an_exact_inverse_stays_exact_when_memory_overflows(tmp_path):
    model = operator(bands=9)
    targets = model.simulate(deep_inputs(model, 5_000, np.random.default_rng(0)))
    y = compiled.Compiled(source(model, memory=6), tmp_path).chase(targets)[1]
    assert np.abs(y - targets).max() <= 1e-12 * np.ptp(model.range)


@pytest.mark.parametrize("float32", [False, True], ids=["double", "float"])
@pytest.mark.parametrize("linear", [None, LAGS], ids=["alone", "with lags"])
def test_the_bytes_of_a_state_are_as_reported(float32, linear, tmp_path):
    code = source(operator(), float32=float32, linear=linear)
    assert compiled.Compiled(code, tmp_path).state_bytes == code.state_bytes


def test_refuses_the_inverse_of_a_model_that_is_not_monotone():
    with pytest.raises(NotInvertibleError, match="--no-inverse"):
        source(operator(signed=True))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"memory": 5}, "memory is 5; give a whole number from 6 to"),
        ({"memory": 2.5}, "whole number"),
        ({"memory": True}, "whole number"),
        ({"name": "2fast"}, "cannot begin the names"),
        ({"first": "second"}, "first is 'second'"),
        ({"linear": Linear.lags(0.1)}, "continuous"),
        ({"linear": Linear([1.0], [1.0, -1.0], 0.1)}, "DC gain"),
        ({"linear": Linear([1.0], [1.0, -1.5], 0.1)}, "unstable"),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(ParameterError, match=message):
        source(operator(), **options)


def test_refuses_levels_that_a_float_cannot_distinguish():
    model = Preisach([1.0, 1.0 + 1e-9, 2.0], np.tril(np.ones((2, 2))))
    assert source(model).table_bytes > 0
    with pytest.raises(ParameterError, match="export doubles"):
        source(model, float32=True)


def test_other_models_are_refused():
    with pytest.raises(ParameterError, match="models, relays and plays, and this is a Polynomial"):
        source(Polynomial([1.0, 0.0], -1, 1))


UNBOUNDED = compiled.HARNESS.replace("minorloop_error_bound(&state)", "0")
PLAYS = PrandtlIshlinskii([0.0, 0.2, 0.5, 1.5], [1.0, 0.5, -0.3, 0.7], 0.1)


@pytest.mark.parametrize("cc", ["gcc", "clang"])
@pytest.mark.parametrize("float32", [False, True], ids=["double", "float"])
@pytest.mark.parametrize("inverse", [False, True])
def test_plays_pass_their_own_test(inverse, float32, cc, tmp_path):
    code = source(PLAYS, float32=float32, inverse=inverse)
    compiled.self_test(code, tmp_path, *compiled.SANITIZED, cc=cc)


BENT = [
    GeneralisedPrandtlIshlinskii(
        PLAYS, DeadZones([-0.5, 0.0, 0.5, 2.0], [0.2, 1.0, -0.3, 0.4]), 2.0
    ),
    GeneralisedPrandtlIshlinskii(PLAYS, DeadZones([0.3, 1.0], [0.5, -0.2]), -1.0),
    GeneralisedPrandtlIshlinskii(PLAYS, DeadZones([-2.0, -1.0], [0.5, 0.2])),
    GeneralisedPrandtlIshlinskii(PLAYS, DeadZones([0.0], [0.7]), 1.0),
]


def relays(count, relay="bipolar"):
    rng = np.random.default_rng(count)
    levels = np.cumsum(rng.uniform(0.1, 1, count)) - 1
    return RelayModel(levels, np.tril(rng.normal(size=(count, count))), 0.3, relay)


@pytest.mark.parametrize(("cc", "float32"), [("gcc", True), ("clang", False)])
def test_relays_pass_their_own_test(float32, cc, tmp_path):
    code = source(relays(9), float32=float32, inverse=False)
    compiled.self_test(code, tmp_path, *compiled.SANITIZED, cc=cc)


@pytest.mark.parametrize(("count", "relay"), [(2, "unipolar"), (30, "bipolar")])
def test_relays_give_the_outputs_of_python(count, relay, tmp_path):
    model = relays(count, relay)
    code = compiled.Compiled(source(model, inverse=False), tmp_path, UNBOUNDED)
    assert code.state_bytes == source(model, inverse=False).state_bytes
    low, high = model.levels[[0, -1]]
    u = np.random.default_rng(0).uniform(low - 0.5, high + 0.5, 50_000)
    u[::7] = np.random.default_rng(1).choice(model.levels, u[::7].size)  # on the thresholds too
    expected = model.simulate(u)
    assert np.abs(code.walk(u)[0] - expected).max() <= 1e-12 * np.ptp(expected)


def test_relays_on_levels_in_the_last_digits_of_a_float_are_refused():
    model = RelayModel([1e6, 1e6 + 1, 1e6 + 2], np.tril(np.ones((3, 3))))
    with pytest.raises(ParameterError, match=r"of the range of the levels.* export doubles"):
        source(model, float32=True, inverse=False)
    assert source(model, inverse=False).files


def test_refuses_relays_that_cannot_be_exported():
    with pytest.raises(NotInvertibleError, match=r"come in steps.*--no-inverse"):
        source(relays(4))
    with pytest.raises(ParameterError, match="RelayModel has no linear part"):
        source(relays(4), linear=LAGS, inverse=False)
    close = RelayModel([1.0, 1.0 + 1e-9], np.tril(np.ones((2, 2))))
    with pytest.raises(ParameterError, match="export doubles"):
        source(close, float32=True, inverse=False)


@pytest.mark.parametrize("model", [PLAYS, PrandtlIshlinskii([0.0], [2.0], -1.0), BENT[0], BENT[3]])
def test_plays_give_the_outputs_of_python(model, tmp_path):
    code = compiled.Compiled(source(model), tmp_path, UNBOUNDED)
    assert code.state_bytes == source(model).state_bytes
    u = np.random.default_rng(0).uniform(-3, 3, 100_000)
    y, expected = code.walk(u)[0], model.simulate(u, "demagnetised")
    width = np.ptp(expected)
    assert np.abs(y - expected).max() <= 1e-12 * width
    targets = np.random.default_rng(1).uniform(expected.min(), expected.max(), 100_000)
    found = model.invert(targets, "demagnetised").u
    inputs, outputs = code.chase(targets)
    assert np.abs(outputs - targets).max() <= 1e-12 * width
    assert np.abs(inputs - found).max() <= 1e-9


def test_refuses_plays_that_cannot_be_exported():
    with pytest.raises(NotInvertibleError, match="--no-inverse"):
        source(PrandtlIshlinskii([0.1], [1.0]))
    with pytest.raises(ParameterError, match="no linear part"):
        source(PLAYS, linear=LAGS)
    with pytest.raises(ParameterError, match="are allowed"):
        source(PLAYS, largest=10)

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
from minorloop.export.python_control import bounded
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.generalised_prandtl_ishlinskii import (
    DeadZones,
    GeneralisedPrandtlIshlinskii,
)
from minorloop.operators.memory import Memory
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel

LAGS = Linear.from_poles([-20.0, -50.0], dc_gain=1.5, delay=0.03).discretise(0.01)
INTERVAL = 0.1
TIMELESS = compiled.HARNESS.replace("minorloop_error_bound(&state)", "0")
"""For models whose C has no bound of an error."""


def operator(bands=12, seed=0, signed=False, **options):
    rng = np.random.default_rng(seed)
    levels = np.sort(rng.uniform(-2, 3, bands + 1))
    weights = np.tril(rng.uniform(0, 1, (bands, bands)) - 0.3 * signed)
    weights[rng.random((bands, bands)) < 0.2] = 0.0
    return Preisach(levels, weights, 0.3, **options)


def relays(count=9, relay="bipolar"):
    rng = np.random.default_rng(count)
    levels = np.cumsum(rng.uniform(0.1, 1, count)) - 1
    return RelayModel(levels, np.tril(rng.normal(size=(count, count))), 0.3, relay)


def after_effect(diagonal="reversible", field=0.03, creeps=False):
    levels = np.array([-1.0, -0.75, -0.2, 0.0, 0.05, 0.6, 1.0])
    weights = np.tril(np.random.default_rng(1000).uniform(0.1, 1, (6, 6)))
    plane = Preisach(levels, weights, 0.4, "bipolar", diagonal, 0.2)
    options = {"times": [0.3, 4.0], "creep": [0.3 * weights, -0.4 * weights]} if creeps else {}
    return AfterEffect(plane, field, 3.0 if field else 0.0, **options)


PLAYS = PrandtlIshlinskii([0.0, 0.2, 0.5, 1.5], [1.0, 0.5, -0.3, 0.7], 0.1)
BENT = GeneralisedPrandtlIshlinskii(
    PLAYS, DeadZones([-0.5, 0.0, 0.5, 2.0], [0.2, 1.0, -0.3, 0.4]), 2.0
)
FIRMS = {
    "plain": (operator(), {}),
    "sloped": (operator(slope=0.5, diagonal="reversible", relay="unipolar"), {}),
    "signed": (operator(signed=True), {"inverse": False, "memory": 8}),
    "lags after it": (Cascade(operator(slope=0.1), LAGS), {}),
    "lags before it": (Cascade(operator(slope=0.1), LAGS, "linear"), {}),
    "a gain after it": (Cascade(operator(), Linear([2.0], [1.0], 0.01)), {}),
    "little memory": (operator(), {"memory": 6}),
    "one band": (operator(bands=1), {}),
    "many bands": (operator(bands=300), {}),
    "plays": (PLAYS, {}),
    "plays one way": (PLAYS, {"inverse": False}),
    "bent plays": (BENT, {}),
    "relays": (relays(), {"inverse": False}),
    "after-effect": (after_effect(), {"interval": INTERVAL}),
}
SHORT = ["lags after it", "lags before it", "little memory", "bent plays", "relays", "after-effect"]
"""What is compiled in each run of the tests; the others once in a while."""


@pytest.mark.parametrize(
    ("kind", "cc", "float32"),
    [("plain", "gcc", True), *((kind, "gcc", False) for kind in SHORT)]
    + [pytest.param(kind, "clang", True, marks=pytest.mark.whole) for kind in FIRMS]
    + [pytest.param(kind, "gcc", False, marks=pytest.mark.whole) for kind in FIRMS],
)
def test_compiles_without_a_warning_and_passes_its_own_test(kind, float32, cc, tmp_path):
    model, options = FIRMS[kind]
    code = source(model, float32=float32, **options)
    said = compiled.self_test(code, tmp_path, *compiled.SANITIZED, cc=cc)
    assert said.startswith("worst error")
    moves = kind != "one band"  # whose only weight is 0
    assert ("inverse" in said) == (moves and options.get("inverse", True))


def test_a_self_test_detects_a_wrong_inverse(tmp_path):
    model, options = FIRMS["lags after it"]
    code = source(model, **options)
    wrong = re.sub(r"(return u)(;| / GAIN;)", r"\1 * (real)1.001\2", code.files["minorloop.c"])
    assert wrong.count("1.001") == 2  # march gives what aim gives on
    dataclasses.replace(code, files={**code.files, "minorloop.c": wrong}).write(tmp_path)
    program = compiled.build(tmp_path, ["minorloop.c", "minorloop_selftest.c"])
    done = subprocess.run([program], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 1
    assert "forward" in done.stdout


@pytest.mark.parametrize("diagonal", ["uniform", "reversible"])
@pytest.mark.parametrize("relay", ["bipolar", "unipolar"])
def test_the_last_digit_of_no_input_changes_the_output_by_more_than_stated(relay, diagonal):
    for seed in range(6):
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


TOO_FAR = [(1, 1e-20, True), (1, 1e25, True), (1e38, 1, True), (1e-20, 1, True)]
TOO_FAR += [(1, 1e-300, False), (1, 1e160, False)]


@pytest.mark.parametrize(("u", "y", "float32"), TOO_FAR)
def test_refuses_ranges_beyond_the_type(u, y, float32):
    base = operator(bands=4)
    scaled = Preisach(base.levels * u, base.weights * y, 0.3 * y)
    plays = PrandtlIshlinskii([0.0, 0.2], [y, 0.5 * y])
    stepped = RelayModel(np.arange(3.0) * u, np.tril(np.ones((3, 3))))
    for model in (scaled, plays if u == 1 else stepped):
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


@pytest.mark.parametrize(("float32", "share"), [(False, 1e-12), (True, 5e-6)])
def test_inputs_and_targets_give_what_python_gives(float32, share, tmp_path):
    model = operator(bands=30, slope=0.5, diagonal="reversible", relay="unipolar")
    written = source(model, float32=float32, memory=200)
    code = compiled.Compiled(written, tmp_path)
    assert code.state_bytes == written.state_bytes
    u = random_inputs(model, 100_000, np.random.default_rng(1)).astype(code.type)
    (y, bound), width = code.walk(u), np.ptp(model.range)
    assert not bound.any()
    assert np.abs(y - model.simulate(u)).max() <= share * width
    targets = np.random.default_rng(2).uniform(*model.range, 100_000).astype(code.type)
    u, y = code.chase(targets)
    assert np.abs(y - targets).max() <= share * width
    if not float32:
        assert np.abs(model.simulate(u[:1000]) - targets[:1000]).max() <= share * width


@pytest.mark.parametrize("first", ["linear", pytest.param("operator", marks=pytest.mark.whole)])
def test_a_cascade_gives_what_python_gives_and_settles_at_a_target(first, tmp_path):
    model = operator(slope=0.1)
    cascade = Cascade(model, LAGS, first)
    written = source(cascade)
    code = compiled.Compiled(written, tmp_path)
    assert code.state_bytes == written.state_bytes
    u = np.random.default_rng(5).uniform(*model.levels[[0, -1]], 300)
    low = model.levels[0] if first == "operator" else model.levels[0] / LAGS.dc_gain
    state, expected = cascade.begin(float(low)), []
    for sample in u:
        y, state = cascade.step(state, float(sample))
        expected.append(y)
    np.testing.assert_allclose(code.walk(u)[0], expected, atol=1e-12 * np.ptp(expected))
    gain = LAGS.dc_gain if first == "operator" else 1.0
    target = gain * (0.7 * model.range[1] + 0.3 * model.range[0])
    assert abs(code.chase(np.full(400, target))[1][-1] - target) < 1e-6 * np.ptp(model.range)


@pytest.mark.parametrize(
    ("model", "start"),
    [
        (relays(30), "negative"),
        (BENT, "demagnetised"),
        (
            GeneralisedPrandtlIshlinskii(PLAYS, DeadZones([0.3, 1.0], [0.5, -0.2]), -1.0),
            "demagnetised",
        ),
    ],
)
def test_relays_and_plays_give_what_python_gives(model, start, tmp_path):
    invertible = getattr(model, "invertible", False)
    code = source(model, inverse=invertible)
    found = compiled.Compiled(code, tmp_path, TIMELESS)
    assert found.state_bytes == code.state_bytes
    u = np.random.default_rng(0).uniform(-3, 3, 100_000)
    if start == "negative":  # on the thresholds too
        u[::7] = np.random.default_rng(1).choice(model.levels, u[::7].size)
    expected = model.simulate(u, start)
    width = np.ptp(expected)
    assert np.abs(found.walk(u)[0] - expected).max() <= 1e-12 * width
    if invertible:
        targets = np.random.default_rng(1).uniform(expected.min(), expected.max(), 100_000)
        inputs, outputs = found.chase(targets)
        assert np.abs(outputs - targets).max() <= 1e-12 * width
        assert np.abs(inputs - model.invert(targets, start).u).max() <= 1e-9


@pytest.mark.parametrize("options", [{}, {"field": 0.0, "creeps": True, "diagonal": "uniform"}])
def test_an_after_effect_gives_what_python_gives(options, tmp_path):
    model = after_effect(**options)
    harness = TIMELESS.replace("bound[k] = 0", "bound[k] = minorloop_output(&state)")
    code = compiled.Compiled(source(model, interval=INTERVAL), tmp_path, harness)
    u = np.random.default_rng(1).uniform(-0.9, 0.9, 400)
    t, u = INTERVAL * np.arange(400), np.repeat(u[:134], 3)[:400]
    y = model.simulate(t, u)
    np.testing.assert_allclose(code.walk(u)[0], y, rtol=0, atol=1e-11)
    inputs, outputs = code.chase(y)
    np.testing.assert_allclose(outputs, y, rtol=0, atol=1e-10 * np.ptp(model.range))
    np.testing.assert_allclose(model.simulate(t, inputs), y, rtol=0, atol=1e-9)
    # An input that is not finite counts as the one before.
    held, lost = code.walk([0.5, 0.5, 0.5])[0], code.walk([0.5, np.nan, np.inf])[0]
    np.testing.assert_array_equal(held, lost)


def outputs_with_room(model, u, room):
    """Outputs when the pair with the least effect is dropped after ``room`` extrema."""
    low, high = model.levels[[0, -1]]
    memory, y = Memory.negative(low), []
    for sample in u:
        memory = Memory.after([*memory.extrema, sample], low=low, high=high)
        y.append(model.simulate([memory.u], memory)[0])
        memory = bounded(model, memory, room)
    return np.array(y)


def deep_inputs(model, count, rng):
    """Repeated alternations with decreasing amplitude, so that histories are long."""
    low, high = model.levels[[0, -1]]
    middle, half = rng.uniform(0.4, 0.6) * (low + high), (high - low) / 2
    k = np.arange(count)
    shrink = 1 - (k % 97) / 97 * rng.uniform(0.8, 1.0)
    return middle + half * shrink * np.where(k % 2, 1, -1) * rng.uniform(0.8, 1, count)


@pytest.mark.parametrize(("room", "signed"), [(6, False), (9, True)])
def test_the_smallest_loop_is_dropped_and_the_error_is_within_the_bound(room, signed, tmp_path):
    model = operator(bands=9, signed=signed)
    code = source(model, memory=room, inverse=not signed)
    found, width = compiled.Compiled(code, tmp_path), np.ptp(model.range)
    u = deep_inputs(model, 500, np.random.default_rng(room))
    y, bound = found.walk(u)
    assert (bound > 0).any()
    np.testing.assert_allclose(y, outputs_with_room(model, u, room), atol=1e-10 * np.ptp(y))
    u = deep_inputs(model, 20_000, np.random.default_rng(room))
    u[::701] = model.levels[-1]
    y, bound = found.walk(u)
    error, allowed = np.abs(y - model.simulate(u)), np.append(0.0, bound[:-1])
    assert (error[1:] > 1e-6 * width).any()
    assert (error <= np.maximum(allowed, bound) + 1e-11 * width).all()
    assert np.diff(bound).max() <= code.drop_error * (1 + 1e-9)
    assert (bound[701::701] == 0).all()  # saturation heals all


CLOSE = Preisach([1.0, 1.0 + 1e-9, 2.0], np.tril(np.ones((2, 2))))
FAR = Preisach(1e6 + np.linspace(0, 1, 11), np.tril(np.ones((10, 10))))
FAR_RELAYS = RelayModel([1e6, 1e6 + 1, 1e6 + 2], np.tril(np.ones((3, 3))))
FALLING = AfterEffect(operator(), times=[1.0], creep=[-2 * operator().weights])


@pytest.mark.parametrize(
    ("model", "options", "error", "message"),
    [
        (operator(), {"memory": 5}, ParameterError, "memory is 5; give a whole number from 6 to"),
        (operator(), {"name": "2fast"}, ParameterError, "cannot begin the names"),
        (operator(), {"interval": 1.0}, ParameterError, "an interval has no effect"),
        (operator(), {"largest": 10}, ParameterError, "10 are allowed"),
        (Cascade(operator(), Linear.lags(0.1)), {}, ParameterError, "continuous"),
        (Cascade(operator(), Linear([1.0], [1.0, -1.5], 0.1)), {}, ParameterError, "unstable"),
        (Cascade(operator(), LAGS, ahead=LAGS), {}, ParameterError, "on both sides"),
        (Cascade(PLAYS, LAGS), {}, ParameterError, "no linear part"),
        (Polynomial([1.0, 0.0], -1, 1), {}, ParameterError, "the model is a Polynomial"),
        (CLOSE, {"float32": True}, ParameterError, "export doubles"),
        (FAR, {"float32": True}, ParameterError, "last digit of a float near .* export doubles"),
        (
            FAR_RELAYS,
            {"float32": True, "inverse": False},
            ParameterError,
            "of the range of the levels.* export doubles",
        ),
        (operator(signed=True), {}, NotInvertibleError, "inverse=no"),
        (relays(), {}, NotInvertibleError, "change in steps.*inverse=no"),
        (PrandtlIshlinskii([0.1], [1.0]), {}, NotInvertibleError, "inverse=no"),
        (FALLING, {"interval": INTERVAL}, NotInvertibleError, "export it without"),
        (after_effect(), {}, ParameterError, "give the seconds between samples"),
    ],
)
def test_what_c_cannot_hold_is_refused(model, options, error, message):
    with pytest.raises(error, match=message):
        source(model, **options)


def test_what_only_a_float_or_only_the_inverse_cannot_hold_is_exported_otherwise():
    assert source(CLOSE).table_bytes > 0
    assert source(FAR).input_error < 1e-8
    assert source(FAR_RELAYS, inverse=False).files
    one_way = source(FALLING, interval=INTERVAL, inverse=False)
    assert "_aim" not in one_way.files["minorloop.h"]

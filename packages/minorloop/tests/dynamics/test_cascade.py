import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from later import Later
from minorloop import Cascade, Linear, Polynomial, PrandtlIshlinskii, Preisach, UnreachableError
from minorloop.dynamics.creep import Creep

signal = Later("scipy.signal")

LEVELS = np.linspace(-1, 1, 5)
PLANE = Preisach(LEVELS, np.tril(np.random.default_rng(0).uniform(0.3, 1, (4, 4))), slope=0.5)
LINE = Polynomial([0.0, 2.0], -50.0, 50.0)
G = Linear.from_poles([-2.0, -0.5], [-1.0], dc_gain=1.5)
ORDERS = pytest.mark.parametrize("first", ["operator", "linear"])
INPUTS = st.lists(st.floats(-1.5, 1.5), min_size=2, max_size=30)


@given(INPUTS, st.floats(-1, 1))
def test_operator_first_equals_both_parts_in_series(u, before):
    t = 0.4 * np.arange(1, len(u) + 1)
    w = PLANE.simulate([before, *u])
    b, a, _ = signal.cont2discrete(([1.5, 1.5], [1.0, 2.5, 1.0]), 0.4)
    # From rest at the settled value; the filter has the output when the next input is set.
    y = 1.5 * w[0] + signal.lfilter(b[0], a, np.append(w[1:], 0.0) - w[0])[1:]
    got = Cascade(PLANE, G).simulate(t, u, before=before)
    np.testing.assert_allclose(got, y, atol=1e-6)


@given(INPUTS, st.floats(-1, 1))
def test_linear_first_equals_both_parts_in_series(u, before):
    t = 0.4 * np.arange(1, len(u) + 1)
    filtered = G.simulate(t, u, before=before)
    wanted = PLANE.simulate([1.5 * before, *filtered])[1:]
    got = Cascade(PLANE, G, "linear").simulate(t, u, before=before)
    np.testing.assert_allclose(got, wanted, atol=1e-12)


def growing_sine(reach, centre=0.0, seconds=30.0, interval=0.02):
    t = np.arange(0, seconds, interval)
    return t, centre + reach * np.minimum(t / 10, 1) * np.sin(0.7 * t)


@ORDERS
@pytest.mark.parametrize(
    "operator",
    [PLANE, LINE, PrandtlIshlinskii([0.0, 0.2, 0.6], [1.0, 0.4, 0.3])],
    ids=["preisach", "line", "plays"],
)
def test_the_inverse_brings_the_output_to_the_filtered_target(first, operator):
    system = Linear.lags(2.0, 0.5)
    rest = float(operator.simulate([-1.0, 0.0])[-1])
    start = operator.step("negative", -1.0)[1]
    t, targets = growing_sine(0.4, rest)
    found = Cascade(operator, system, first).invert(t, targets, start, before=0.0)
    assert found.reachable.all()
    seconds = found.filter_time
    smooth = signal.butter(2, 1 / seconds, analog=True)[1] * seconds**2
    ahead = np.interp(t + np.sqrt(2) * seconds, t, targets - rest)
    filtered = rest + signal.lsim(([1.0], smooth), ahead, t)[1]
    if first == "operator":
        np.testing.assert_allclose(found.y, filtered, atol=2e-3)
    assert found.rms < 0.006
    np.testing.assert_allclose(found.residual, found.y - targets)


@ORDERS
@pytest.mark.parametrize("between", ["straight", "held"])
def test_the_input_is_early_by_the_dead_time(first, between):
    system = Linear.lags(1.0, delay=0.5)
    t, targets = growing_sine(1.0)
    targets = np.concatenate([np.zeros(40), targets[:-80], np.full(40, targets[-81])])
    found = Cascade(LINE, system, first).invert(
        t, targets, before=0.0, filter_time=0.02, between=between
    )
    np.testing.assert_allclose(found.y, targets, atol=3e-3)


def test_a_sampled_system_is_inverted_by_its_continuous_counterpart():
    t, targets = growing_sine(1.0)
    plain = Cascade(LINE, G).invert(t, targets, before=0.0)
    sampled = Cascade(LINE, G.discretise(0.1)).invert(t, targets, before=0.0)
    np.testing.assert_allclose(sampled.u, plain.u, atol=1e-6)


def test_targets_out_of_reach_are_refused_or_clipped():
    t, targets = growing_sine(1.5 * PLANE.range[1])
    cascade = Cascade(PLANE, G)
    for one in (cascade, Cascade(PLANE, G, "linear"), Cascade(PLANE, Linear([3.0], [1.0, 1.0]))):
        with pytest.raises(UnreachableError, match="beyond what the model can reach") as caught:
            one.invert(t, 4 * targets, before=0.0)
        assert "dynamics" not in str(caught.value)
    with pytest.raises(UnreachableError, match="because of the dynamics"):
        cascade.invert(t, 0.66 * targets, before=0.0)
    found = cascade.invert(t, targets, before=0.0, unreachable="clip")
    assert not found.reachable.all()
    assert np.abs(found.u).max() <= 1.0


def test_a_fast_zero_in_the_right_half_plane_counts_as_dead_time():
    system = Linear.from_poles([-1.0, -2.0], [60.0])
    t, targets = growing_sine(1.0)
    found = Cascade(LINE, system).invert(t, targets, before=0.0)
    assert found.filter_time > 1 / 60
    assert found.rms < 3e-3


CREEP = Creep([1.0, 30.0], [0.15, 0.25], 0.6)


@ORDERS
@given(u=INPUTS, before=st.floats(-1, 1))
@settings(max_examples=20)
def test_creep_acts_on_the_output(first, u, before):
    t = 0.4 * np.arange(1, len(u) + 1)
    plain, crept = Cascade(PLANE, G, first), Cascade(PLANE, G, first, CREEP)
    rest = float(plain.simulate([0, 1], [before, before], before=before)[0])
    wanted = CREEP.simulate(t, plain.simulate(t, u, before=before), before=rest)
    np.testing.assert_allclose(crept.simulate(t, u, before=before), wanted, atol=1e-9)


@ORDERS
def test_the_inverse_compensates_creep(first):
    t, targets = growing_sine(1.0)
    errors = [
        Cascade(LINE, Linear.lags(0.3), first, creep).invert(t, targets, before=0.0).rms
        for creep in (CREEP, None)
    ]
    assert errors[0] < 2e-3
    inputs = Cascade(LINE, Linear.lags(0.3), first).invert(t, targets, before=0.0).u
    crept = Cascade(LINE, Linear.lags(0.3), first, CREEP).simulate(
        t, inputs, before=0.0, between="straight"
    )
    assert np.sqrt(np.mean((crept - targets) ** 2)) > 20 * errors[0]


@pytest.mark.parametrize("between", ["straight", "held"])
def test_the_inverse_undoes_dynamics_on_both_sides(between):
    model = Cascade(PLANE, Linear.lags(0.05, 0.02), ahead=Linear.lags(0.04, delay=0.02))
    t = 0.005 * np.arange(2000)
    rest = model.operator.simulate([0.0])[0]
    wanted = rest + 0.6 * (1 - np.cos(t))
    found = model.invert(t, wanted, before=0.0, between=between)
    assert found.rms < 2e-3 * np.ptp(wanted)

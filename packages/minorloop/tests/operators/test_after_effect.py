import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate

from minorloop import AfterEffect, Memory, NotInvertibleError, Preisach, UnreachableError
from minorloop.operators.after_effect import intervals

LEVELS = np.array([-1.0, -0.75, -0.2, 0.0, 0.05, 0.6, 1.0])
BANDS = LEVELS.size - 1
DIAGONALS = ("uniform", "reversible")
FIELD = np.linspace(0.02, 0.05, BANDS)
LAWS = {
    "field": {"field": FIELD, "settling": 3.0},
    "creep": {"times": [0.2, 5.0]},
    "viscous": {"field": 20.0, "settling": 0.5},
}


def a_plane(seed=1000, diagonal="reversible", slope=0.2):
    rng = np.random.default_rng(seed)
    weights = np.tril(rng.uniform(0.1, 1, (BANDS, BANDS)))
    return Preisach(LEVELS, weights, rng.normal(), "bipolar", diagonal, slope)


def a_model(law="creep", seed=1000, diagonal="reversible", slope=0.2):
    """A monotone model: creep takes back at most a part of what the plane does."""
    plane, options = a_plane(seed, diagonal, slope), dict(LAWS[law])
    if "times" in options:
        shares = np.random.default_rng(seed + 1).uniform(-0.4, 0.4, (2, BANDS, BANDS))
        options["creep"] = shares * plane.weights
    return AfterEffect(plane, **options)


def a_walk(seed, size, reach=0.9):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice([0.01, 0.3, 20.0], size))
    return t, rng.uniform(-reach, reach, size)


def effective(model, u, seconds, start="negative"):
    tracker = model.track(start)
    tracker.push(u, seconds)
    return tracker.effective


@pytest.mark.parametrize("diagonal", DIAGONALS)
@given(seed=st.integers(0, 50), slope=st.sampled_from([0.0, 0.7]))
@settings(max_examples=10)
def test_without_field_and_creep_it_is_the_plane(diagonal, seed, slope):
    plane = a_plane(seed, diagonal, slope)
    t, u = a_walk(seed, 60, reach=1.3)
    y = AfterEffect(plane).simulate(t, u, "demagnetised")
    np.testing.assert_allclose(y, plane.simulate(u, "demagnetised"), rtol=0, atol=1e-12)


def test_the_effective_input_solves_the_law_of_thermal_activation():
    model = a_model("field")
    marks = model.marks
    got = effective(model, 0.9, 0.7, Memory((-1.0, 0.4)))
    field = np.diff(LEVELS) / np.diff(marks)

    def rate(_, v):
        band = min(np.searchsorted(LEVELS, v[0], side="right") - 1, BANDS - 1)
        s = field[band]
        # Within one band, x = v / S obeys dx/dt = sinh(g(u) - x) / T.
        apart = np.interp(0.9, LEVELS, marks) - np.interp(v[0], LEVELS, marks)
        return [s * np.sinh(min(apart, 50.0)) / model.settling]

    solved = integrate.solve_ivp(rate, (0, 0.7), [0.4], rtol=1e-10, atol=1e-12, max_step=1e-2)
    assert got == pytest.approx(solved.y[0, -1], abs=1e-6)


def test_the_effective_input_follows_the_logarithm_of_time():
    model = AfterEffect(a_plane(), 0.02, 1e6)
    t = np.array([1.0, 10.0, 100.0])
    lag = 0.5 - np.array([effective(model, 0.5, one) for one in t])
    np.testing.assert_allclose(np.diff(lag), -0.02 * np.log(10), rtol=1e-3)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("diagonal", DIAGONALS)
@given(seed=st.integers(0, 50), parts=st.sampled_from([2, 7, 300]))
@settings(max_examples=8)
def test_readings_while_an_input_is_held_change_nothing(law, diagonal, seed, parts):
    model = a_model(law, seed, diagonal)
    t, u = a_walk(seed, 40)
    begins = t - intervals(t)
    shares = np.arange(1, parts + 1) / parts
    often = (begins[:, None] + (t - begins)[:, None] * shares).ravel()
    y = model.simulate(often, np.repeat(u, parts))[parts - 1 :: parts]
    np.testing.assert_allclose(y, model.simulate(t, u), rtol=0, atol=1e-8 * np.ptp(model.range))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("diagonal", DIAGONALS)
@given(seed=st.integers(0, 30))
@settings(max_examples=8)
def test_the_inverse_meets_outputs_at_each_instant(law, diagonal, seed):
    model = a_model(law, seed, diagonal)
    t, u = a_walk(seed, 60)
    targets = model.simulate(t, u, "demagnetised")
    found = model.invert(t, targets, "demagnetised")
    assert found.reachable.all()
    assert found.worst <= 1e-10 * np.ptp(model.range)


def test_a_tracker_aims_and_its_copy_is_independent():
    tracker = a_model().track("demagnetised")
    other = tracker.copy()
    with pytest.raises(UnreachableError):
        tracker.aim(100.0, 0.1)
    assert tracker.aim(100.0, 0.1, "clip") == 1.0
    u = tracker.aim(0.5, 0.1)
    assert tracker.push(u, 0.1) == pytest.approx(0.5, abs=1e-12)
    assert other.state == a_model().track("demagnetised").state
    assert other.effective == pytest.approx(Memory.demagnetised(-1.0, 1.0).u)


def test_a_target_that_needs_more_time_is_out_of_reach():
    plane = a_plane(slope=0.0, diagonal="uniform")
    model = AfterEffect(plane, 1e3, 10.0)
    high = plane.range[1]
    with pytest.raises(UnreachableError, match=r"index 0 \(0.1 s\) is out of reach at its time"):
        model.invert([0.1, 0.2], [high, high])
    clipped = model.invert([0.1, 0.2], [high, high], unreachable="clip")
    assert clipped.u.tolist() == [1.0, 1.0]
    assert not clipped.reachable.any()


def test_creep_that_takes_back_more_than_the_plane_gives_is_not_inverted():
    plane = a_plane()
    model = AfterEffect(plane, times=[1.0], creep=[-1.2 * plane.weights])
    assert not model.monotone
    with pytest.raises(NotInvertibleError, match="negative weights"):
        model.invert([1.0, 2.0], [0.0, 0.0])

import numpy as np

from minorloop import Preisach, Smooth, excitation
from minorloop.identification.representability import representability

LEVELS = np.linspace(-1, 1, 9)
INPUTS = np.concatenate(
    [
        excitation.decaying_staircase(LEVELS),
        excitation.major_loop(LEVELS),
        excitation.reversal_curves(LEVELS),
        excitation.decaying_staircase(LEVELS),
        # One minor loop, from five pasts.
        *[[-1.0, 1.0, low, 0.5, 0.25, 0.0, -0.25] for low in (-0.75, -0.5, -1.0)],
        *[[-1.0, high, -0.5, 0.5, 0.25, 0.0, -0.25] for high in (0.75, 1.0)],
    ]
)


def a_plane():
    return Preisach(LEVELS, np.tril(np.random.default_rng(0).uniform(0, 1, (8, 8))))


def test_a_preisach_operator_violates_neither_law():
    found = representability(INPUTS, a_plane().simulate(INPUTS))
    assert max(found.wiping_out, found.congruency, found.floor) < 1e-12
    assert found.memories > 20
    assert found.branches >= 10


def test_drift_shows_as_wiping_out_that_fails():
    y = a_plane().simulate(INPUTS)
    drift = 0.1 * np.ptp(y) * np.arange(y.size) / y.size
    found = representability(INPUTS, y + drift)
    assert 0.05 < found.wiping_out < 0.11
    assert 0 < found.floor < 0.1


def test_a_loop_that_depends_on_its_past_shows_as_congruency_that_fails():
    plane = a_plane()
    y = plane.simulate(INPUTS)
    found = representability(INPUTS, y + 0.5 * y**2 / np.ptp(y))
    assert found.congruency > 0.01
    assert found.wiping_out < 1e-12


def test_the_floor_is_below_what_a_fit_leaves():
    from fixed_options import Plane, identify

    rng = np.random.default_rng(1)
    y = a_plane().simulate(INPUTS)
    y += rng.normal(0, 0.02 * np.ptp(y), y.size)
    fit = identify(INPUTS, y, Plane(LEVELS), prior=Smooth(0.0))
    found = representability(INPUTS, y)
    assert 0.3 * fit.nrmse < found.floor <= fit.nrmse


def test_a_record_that_never_repeats_has_no_floor():
    u = excitation.decaying_staircase(LEVELS)
    found = representability(u, a_plane().simulate(u))
    assert (found.memories, found.floor, found.wiping_out) == (0, 0.0, 0.0)
    assert "0 repeated memories" in str(found)


def test_holds_and_gaps_are_no_repetition():
    u = np.repeat(excitation.staircase(LEVELS), 3)
    y = a_plane().simulate(u) + np.linspace(0, 1, u.size)
    y[5] = np.nan
    assert representability(u, y).memories <= 1

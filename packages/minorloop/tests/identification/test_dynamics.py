from functools import cache

import numpy as np
import pytest

import minorloop as ml
from minorloop.dynamics.creep import Creep
from minorloop.dynamics.linear import Linear

RATE = 1000.0
RADII = np.linspace(0, 40, 81)
NOISE = 0.01
COARSE = {"levels": 15, "diagonal": "reversible"}


def plays(u):
    """Plays of many radii, after a sweep up and down, and a bend: 0 to 40 um for 0 to 100 V."""
    weights = np.exp(-RADII / 12)
    weights[0] = 6.0
    position, w = RADII.copy(), np.empty(u.size)
    for k, x in enumerate(u):
        position = np.maximum(x - RADII, np.minimum(x + RADII, position))
        w[k] = weights @ position
    low = weights @ RADII
    z = (w - low) / (weights @ np.maximum(100 - RADII, RADII) - low)
    return 40 * (z + 0.1 * z * (1 - z))


def sweeps(frequencies=(4.0, 20.0, 50.0)):
    """Rest, then sines of decreasing amplitude."""
    parts = [np.zeros(40)]
    for frequency in frequencies:
        t = np.arange(0, max(3 / frequency, 0.15), 1 / RATE)
        parts.append(50 - 50 * np.cos(2 * np.pi * frequency * t) * (1 - 0.8 * t / t[-1]))
    return np.concatenate(parts)


def time_of(u):
    return np.arange(u.size) / RATE


def measured(u, linear, first="operator", creep=None, noise=NOISE):
    t = time_of(u)
    if first == "operator":
        w = plays(u)
        y = linear.simulate(t, w, before=float(w[0]))
    else:
        y = plays(linear.simulate(t, u, before=float(u[0])))
    if creep is not None:
        y = creep.simulate(t, y, before=float(y[0]))
    return y + noise * np.random.default_rng(1000).normal(size=t.size)


LAGS = Linear.lags(6e-3, 2e-3)


@cache
def stage():
    u = sweeps()
    law = ml.Dynamics(ml.Plane(**COARSE), first="operator")
    return ml.identify(ml.Record(u, measured(u, LAGS), time_of(u)), law, holdout=0.1)


def test_finds_two_poles_after_the_operator():
    found = stage()
    assert found.model.creep is None
    assert found.model.linear.delay < 0.3e-3
    np.testing.assert_allclose(found.model.linear.time_constants, [6e-3, 2e-3], rtol=0.05)
    assert found.nrmse < 2e-3
    assert found.holdout_nrmse < 0.02
    chosen = [one for one in found.tried if one.chosen]
    assert [one.structure for one in chosen] == [(0, 2, False)]
    assert found.startup == 0


def test_predicts_frequencies_that_it_was_not_fitted_to():
    u = sweeps((10.0, 30.0))
    y = measured(u, LAGS, noise=0.0)
    error = stage().predict(time_of(u), u) - y
    assert np.sqrt(np.mean(error**2)) < 0.004 * 40


def test_its_inverse_brings_the_stage_along_a_trajectory():
    t = np.arange(0, 0.6, 1 / RATE)
    rest = float(stage().model.operator.simulate([0.0])[0])
    wanted = rest + 15 * (1 - np.cos(2 * np.pi * 10 * np.maximum(t - 0.05, 0)))
    found = stage().invert(t, wanted, before=0.0, unreachable="clip")
    achieved = measured(np.clip(found.u, 0, 100), LAGS, noise=0.0)
    assert np.sqrt(np.mean((achieved - wanted) ** 2)) < 0.3
    assert found.filter_time == pytest.approx(2 / RATE)


@cache
def amplifier_and_sensor():
    """Dynamics on both sides of the operator."""
    u = sweeps((4.0, 20.0, 50.0, 9.0))
    filtered = Linear.lags(6e-3).simulate(time_of(u), u, before=float(u[0]))
    y = measured(filtered, Linear.lags(2e-3), noise=4 * NOISE)
    return ml.identify(
        ml.Record(u, y, time_of(u)), ml.Dynamics(ml.Plane(**COARSE), poles=2, creep=False)
    )


@pytest.mark.whole
def test_finds_poles_on_both_sides_of_the_operator():
    model = amplifier_and_sensor().model
    np.testing.assert_allclose(model.ahead.time_constants, [6e-3], rtol=0.05)
    np.testing.assert_allclose(model.linear.time_constants, [2e-3], rtol=0.2)


def virgin(u):
    """Outputs of plays that begin at zero, with the lags of the stage."""
    weights = np.exp(-RADII / 12)
    weights[0] = 6.0
    position, w = np.zeros(RADII.size), np.empty(u.size)
    for k, x in enumerate(u):
        position = np.maximum(x - RADII, np.minimum(x + RADII, position))
        w[k] = weights @ position
    w *= 40 / (weights @ np.maximum(100 - RADII, RADII) - weights @ RADII)
    y = LAGS.simulate(time_of(u), w, before=float(w[0]))
    return y + NOISE * np.random.default_rng(1003).normal(size=u.size)


@pytest.mark.whole
def test_a_virgin_start_is_not_fitted():
    u = sweeps((4.0, 20.0, 9.0, 3.0))
    found = ml.identify(
        ml.Record(u, virgin(u), time_of(u)),
        ml.Dynamics(ml.Plane(**COARSE), first="operator", poles=2, creep=False),
    )
    assert found.startup > 100
    assert not found.fitted[: found.startup].any()
    assert any("rows are not fitted" in text for text in found.advice)
    np.testing.assert_allclose(found.model.linear.time_constants, [6e-3, 2e-3], rtol=0.05)
    given = ml.identify(
        ml.Record(u, virgin(u), time_of(u), start="demagnetised"),
        ml.Dynamics(ml.Plane(**COARSE), first="operator", poles=0, creep=False),
    )
    assert given.fitted.all()


def test_finds_dynamics_before_the_operator():
    u = np.repeat(np.random.default_rng(1001).uniform(0, 100, 50), 40)
    u[:40] = 0.0
    found = ml.identify(
        ml.Record(u, measured(u, Linear.lags(12e-3), "linear"), time_of(u)),
        ml.Dynamics(ml.Plane(**COARSE), poles=1, creep=False),
    )
    assert found.model.first == "linear"
    np.testing.assert_allclose(found.model.linear.time_constants[0], 12e-3, rtol=0.03)
    assert found.nrmse < 3e-3
    assert found.model.linear.delay == 0
    assert "dead time                none" in str(found)


@pytest.mark.whole
def test_finds_dead_time_and_a_resonance():
    omega, u = 2 * np.pi * 40, sweeps()
    system = Linear([omega**2], [1, 0.2 * omega, omega**2], delay=3 / RATE)
    found = ml.identify(
        ml.Record(u, measured(u, system), time_of(u)),
        ml.Dynamics(ml.Plane(**COARSE), poles=2, creep=False),
    )
    assert found.model.first == "operator"
    assert found.model.linear.delay == pytest.approx(3 / RATE, abs=0.2 / RATE)
    poles = found.model.linear.poles
    np.testing.assert_allclose(np.abs(poles), omega, rtol=0.01)
    np.testing.assert_allclose(-poles.real / np.abs(poles), 0.1, rtol=0.1)
    assert "resonance" in str(found)
    assert " Hz, damping ratio 0." in dict(found.summary())["resonance"]


@pytest.mark.whole
def test_the_structure_of_the_plane_is_chosen_by_the_error_of_the_whole_model():
    """The record without dynamics has ten times the noise, which hides the diagonal."""
    t = np.arange(0, 1, 1 / RATE)
    wave = 50 - 50 * np.cos(2 * np.pi * (2 + 8 * t) * t) * (1 - 0.8 * t)
    u = np.concatenate([np.zeros(40), wave])
    record = ml.Record(u, measured(u, LAGS, noise=4 * NOISE), time_of(u))
    found = ml.identify(
        record, ml.Dynamics(ml.Plane(levels=25), first="operator", poles=2, creep=False)
    )
    assert found.model.operator.diagonal == "reversible"
    assert [choice.name for choice in found.static.choices] == ["structure"]


def test_a_record_without_dynamics_has_none():
    u = sweeps((5.0,))
    record = ml.Record(u, measured(u, Linear.lags()), time_of(u))
    found = ml.identify(record, ml.Dynamics(ml.Plane(**COARSE), first="operator"))
    assert not found.dynamic
    assert "no better than with the operator alone" in found.advice[-1]


def test_finds_creep():
    u = np.repeat(np.random.default_rng(1002).uniform(0, 100, 20), 150)
    u[:150] = 0.0
    y = measured(u, Linear.lags(4e-3), creep=Creep([0.3], [0.2], 0.8))
    found = ml.identify(
        ml.Record(u, y, time_of(u)), ml.Dynamics(ml.Plane(**COARSE), first="operator", poles=1)
    )
    assert found.model.creep.strengths.sum() == pytest.approx(0.2, abs=0.04)
    assert found.model.creep.dc_gain == pytest.approx(1)
    assert found.nrmse < 5e-3
    assert "creep  " in str(found)

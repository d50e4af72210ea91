import numpy as np
import pytest
from scipy.integrate import solve_ivp

from minorloop.dynamics.oscillator import Oscillator, respond
from minorloop.dynamics.sampling import pulses
from minorloop.operators.differential import BoucWen, Duhem
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

LAW = BoucWen(5e4, 800.0, -1100.0)
FREE = Duhem([-60.0, -20.0, 15.0, 70.0], [9e4, 5e4, 6e4, 7e4], [7e4, 6e4, 5e4, 9e4])
PLAYS = PrandtlIshlinskii(np.linspace(0, 1e-3, 5), [6e4, -8e3, -8e3, -8e3, -8e3])
T = np.arange(300) / 750


def force(t):
    return 60 * np.sin(2 * np.pi * 33 * t) + 25 * np.sin(2 * np.pi * 81 * t)


@pytest.mark.parametrize("law", [LAW, FREE, BoucWen(5e4, 900.0, 300.0, 1.4)])
def test_displacements_are_those_of_a_general_integrator(law):
    def rates(t, x):
        y, v, z = x
        f = float(law.slopes([z])[0 if v > 0 else 1][0])
        return [v, (force(t) - 10 * v - 5e4 * y - 2e9 * y**3 - z) / 2, f * v]

    reach = T[:40]
    wanted = solve_ivp(rates, reach[[0, -1]], np.zeros(3), t_eval=reach, rtol=1e-9, atol=1e-13)
    model = Oscillator(2.0, 10.0, [5e4, 0.0, 2e9], law)
    found = model.simulate(T, force(T), substeps=10)[:40]
    assert np.abs(found - wanted.y[0]).max() < 1e-5 * np.abs(found).max()


def test_newmark_solves_its_equations_with_plays():
    mass, damping, stiffness, h = 2.0, 10.0, 5e4, 1 / 3000
    fine = pulses(force(T), 4, "straight", periodic=False)
    y, _ = respond(Oscillator(mass, damping, stiffness, PLAYS), fine, h)
    z = PLAYS.simulate(y, "demagnetised")
    # The same rule, solved for the acceleration from the displacements that were found.
    v, a = 0.0, (fine[0, 0] - z[0]) / mass
    for k, u in enumerate(fine[:, 2]):
        after = (y[k + 1] - y[k] - h * v) * 4 / h**2 - a
        v += h / 2 * (a + after)
        rest = mass * after + damping * v + stiffness * y[k + 1] + z[k + 1] - u
        assert abs(rest) < 1e-4  # of 85 N; rounding adds up
        a = after


@pytest.mark.parametrize("operator", [LAW, BoucWen(5e4, 900.0, 300.0, 1.4), FREE, PLAYS])
def test_derivatives_are_exact(operator):
    fine = pulses(force(T), 4, "band", periodic=False)

    def run(parameters, gradient=False):
        mass, damping, *rest = parameters
        spring, law = rest[:2], np.array(rest[2:])
        if isinstance(operator, BoucWen):
            changed = BoucWen(*law)
        elif isinstance(operator, Duhem):
            changed = Duhem(operator.levels, *np.split(law, 2))
        else:
            changed = PrandtlIshlinskii(operator.radii, law)
        model = Oscillator(mass, damping, spring, changed)
        return respond(model, fine, 1 / 3000, gradient=gradient)[int(gradient)]

    law = operator.weights if isinstance(operator, PrandtlIshlinskii) else operator.law[1]
    at = np.array([2.0, 10.0, 5e4, 3e6, *law])
    exact = run(at, gradient=True)
    for k in range(at.size):
        step = np.zeros(at.size)
        step[k] = 1e-6 * at[k]
        numeric = (run(at + step) - run(at - step)) / (2 * step[k])
        assert np.abs(exact[:, k] - numeric).max() < 5e-3 * np.abs(numeric).max()


def test_a_periodic_response_repeats_and_stages_filter_it():
    model = Oscillator(2.0, 10.0, 5e4, LAW)
    t = np.arange(250) / 750
    u = 50 * np.sin(2 * np.pi * 30 * t)
    settled = model.simulate(t, u, periodic=True)
    long = model.simulate(np.arange(2500) / 750, np.tile(u, 10), between="straight")
    straight = model.simulate(t, u, periodic=True, between="straight")
    assert long[-250:] == pytest.approx(straight, abs=1e-9 * 1e3 * np.abs(straight).max())
    taps = np.array([0.25, 0.5, 0.25])
    filtered = model.simulate(t, u, periodic=True, substeps=8, stages=((8, taps),))
    gain = 0.5 + 0.5 * np.cos(2 * np.pi * 30 / 6000)
    assert np.ptp(filtered) == pytest.approx(gain * np.ptp(settled), rel=1e-3)

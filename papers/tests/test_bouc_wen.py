import numpy as np
import pytest
from scipy.integrate import solve_ivp

from papers import bouc_wen
from papers._bouc_wen_kernels import newmark


def test_its_displacements_are_those_of_a_general_integrator():
    t = np.arange(1500) / 15000
    force = 100 * np.sin(2 * np.pi * 30 * t)
    law = bouc_wen.PARAMETERS

    def rates(time, x):
        y, v, z = x
        pull = law["gamma"] * abs(v) * z + law["delta"] * v * abs(z)
        a = (100 * np.sin(2 * np.pi * 30 * time) - 10 * v - 5e4 * y - z) / 2
        return [v, a, law["alpha"] * v - law["beta"] * pull]

    wanted = solve_ivp(rates, t[[0, -1]], np.zeros(3), t_eval=t, rtol=1e-9, atol=1e-13).y[0]
    found = newmark(force, 1 / 15000, *law.values())
    assert np.abs(found - wanted).max() < 1e-3 * np.abs(wanted).max()


def test_records_are_those_of_the_description():
    training, test = bouc_wen.training_record(1000), bouc_wen.multisine_test(1000)
    assert training.u.size == 5 * 8192
    assert np.std(training.u) == pytest.approx(50)
    lines = np.abs(np.fft.rfft(test.u)) > 1e-6
    excited = np.fft.rfftfreq(8192, 1 / 750)[lines]
    assert 5 <= excited[0] < 5.1
    assert 149.9 < excited[-1] <= 150
    periods = training.y.reshape(5, 8192)
    noise = np.sqrt(np.mean(np.var(periods, axis=0, ddof=1)))
    assert noise == pytest.approx(8e-6, rel=0.02)
    # The response is mostly below 150 Hz, and settled.
    assert 5e-4 < np.std(test.y) < 8e-4
    assert test.u.size == 8192
    again = bouc_wen.multisine_test(1000)
    assert (again.y == test.y).all()
    assert not (bouc_wen.multisine_test(1001).u == test.u).all()


def test_the_sweep_begins_at_rest_and_has_the_frequencies_of_its_description():
    sweep = bouc_wen.sweep_test()
    assert sweep.t[-1] == pytest.approx(204)
    assert sweep.u[0] == 0
    assert abs(sweep.y[0]) < 1e-12
    assert sweep.u.max() == pytest.approx(40, rel=1e-3)
    turns = np.count_nonzero(np.diff(np.sign(sweep.u[1:]))) / 2
    assert turns == pytest.approx((18 + 52) / 2 * 204, abs=1)


def test_filters_pass_what_records_have_and_stop_what_would_fold():
    taps = bouc_wen.filters()[-1][1]
    gain = np.abs(np.fft.rfft(taps, 3750))
    assert gain[:150] == pytest.approx(1, abs=3e-3)
    assert gain[600:].max() < 3e-3
    slow = np.sin(2 * np.pi * 20 * np.arange(15000) / 15000)
    assert bouc_wen.decimate(slow)[50:-50] == pytest.approx(slow[::20][50:-50], abs=2e-3)

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from minorloop import Cascade, Linear, Polynomial, PrandtlIshlinskii, Preisach, Record, RelayModel
from minorloop.identification.frequency import describing_function
from minorloop.identification.sine_response import Preamble, frequency_response

G = Linear.from_poles([-20.0, -1.5], [-1.0])
PLANE = Preisach(np.linspace(-1, 1, 9), np.tril(np.random.default_rng(0).uniform(0, 1, (8, 8))))
PREAMBLE = Preamble(-1.0, 10.0)
FREQUENCIES = [0.05, 0.3, 1.0]


def driving(operator, first="operator", system=G):
    """The door to a plant that is a cascade, negatively saturated at the beginning."""
    cascade = Cascade(operator, system, first)

    def drive(t, u):
        return Record(u, cascade.simulate(t, u, between="straight"), 5.0 + t)

    return drive


def measured(operator, model=None, frequencies=FREQUENCIES, amplitudes=(0.4, 0.8), **options):
    return frequency_response(
        driving(operator), frequencies, amplitudes,
        preamble=PREAMBLE, settling=8.0, operator=model, **options,
    )  # fmt: skip


@given(st.floats(0.3, 3.0), st.floats(0.05, 0.95))
def test_describing_function_of_a_play(amplitude, share):
    """Gelb and Vander Velde, Multiple-Input Describing Functions, 1968: backlash."""
    radius = share * amplitude
    b = 1 - 2 * share
    wanted = (np.pi / 2 + np.arcsin(b) + b * np.sqrt(1 - b**2)) / np.pi
    wanted = wanted - 1j * (1 - b**2) / np.pi
    got = describing_function(PrandtlIshlinskii([radius], [1.0]), amplitude)
    np.testing.assert_allclose(got, wanted, atol=1e-5)


@given(st.floats(0.2, 1.0), st.floats(1.05, 5.0))
def test_describing_function_of_a_relay(threshold, ratio):
    relay = RelayModel([-threshold, threshold], [[0.0, 0.0], [1.0, 0.0]])
    amplitude = ratio * threshold
    wanted = 4 / (np.pi * amplitude) * np.exp(-1j * np.arcsin(1 / ratio))
    got = describing_function(relay, amplitude)
    np.testing.assert_allclose(got, wanted, atol=5e-3 * np.abs(wanted))


def test_a_linear_plant_has_the_gains_of_its_transfer_function():
    found = measured(Polynomial([0.0, 2.0], -5, 5), frequencies=[0.05, 0.3, 1.0, 4.0])
    wanted = 2 * G.response(found.frequencies)
    np.testing.assert_allclose(found.plant, [wanted, wanted], rtol=1e-3)
    assert found.after is None
    assert found.distortion.max() < 1e-3
    assert found.unsettled.max() < 1e-3
    assert found.advice == ()


def test_behind_the_true_operator_the_gain_forgets_the_amplitude():
    found = measured(PLANE, PLANE)
    wanted = G.response(found.frequencies)
    np.testing.assert_allclose(found.after, [wanted, wanted], rtol=5e-3)
    spread = found.gain_spread()
    assert spread.before > 0.5
    assert spread.ratio < 0.1
    before, after = found.phase_spread()
    assert before > 10 * after
    fit = found.fit(order=2, zeros=1)
    np.testing.assert_allclose(fit.model.response(FREQUENCIES), wanted, rtol=5e-3)


def test_advice_names_a_plant_that_has_not_settled():
    slow = Linear.lags(30.0)
    found = frequency_response(
        driving(PLANE, system=slow), [0.5], [0.4], preamble=Preamble(-1.0, 10.0, 0.5), settling=0.0
    )
    assert "increase the settling time" in found.advice[0]
    assert "advice" in str(found)

import numpy as np
import pytest

from minorloop.dynamics.oscillator import Oscillator
from minorloop.errors import SignalError
from minorloop.identification import identify
from minorloop.identification.oscillator import Vibration
from minorloop.lab.records import Record
from minorloop.operators.differential import BoucWen, Duhem
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

TRUE = np.array([2.0, 10.0, 5e4, 5e4, 800.0, 900.0, 1.0])
PLANT = Oscillator(2.0, 10.0, 5e4, BoucWen(5e4, 800.0, 900.0))
NOISE, PERIOD, TURNS = 5e-6, 512, 4


def multisine(seed, size=PERIOD):
    rng = np.random.default_rng(seed)
    spectrum = np.zeros(size // 2 + 1, complex)
    lines = slice(5 * size // 750, 150 * size // 750)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(size // 2 + 1))[lines]
    u = np.fft.irfft(spectrum, size)
    return 50 * u / u.std()


def record(plant=PLANT, seed=1000, substeps=16):
    """Times, forces and noisy displacements of four settled periods."""
    u = multisine(seed)
    t = np.arange(TURNS * PERIOD) / 750
    y = plant.simulate(t[:PERIOD], u, periodic=True, substeps=substeps)
    noise = NOISE * np.random.default_rng(seed + 1).normal(size=t.size)
    return Record(np.tile(u, TURNS), np.tile(y, TURNS) + noise, t)


def start(factors):
    mass, damping, stiffness, *law = TRUE * factors
    return Oscillator(mass, damping, stiffness, BoucWen(*law))


@pytest.fixture(scope="module")
def settled():
    return record()


@pytest.fixture(scope="module")
def found(settled):
    factors = np.array([0.5, 1.5, 0.5, 1.5, 0.5, 1.5, 1.5])
    return identify(settled, Vibration(start(factors), PERIOD))


def test_parameters_are_found_from_a_start_that_is_half_off(found):
    assert found.converged
    assert (np.abs(found.parameters - TRUE) < 4 * found.sd).all()
    assert (found.sd < 0.1 * np.abs(TRUE)).all()
    assert found.error == pytest.approx(found.noise, rel=0.15)
    assert found.noise == pytest.approx(NOISE / np.sqrt(TURNS), rel=0.1)
    assert not found.advice


def test_an_unknown_law_is_found_from_the_record_alone(settled):
    found = identify(settled, Vibration(period=PERIOD))
    assert isinstance(found.model.operator, Duhem)
    assert found.free.sum() <= 35
    assert found.error < 1.5 * found.noise
    assert found.model.mass == pytest.approx(2, rel=0.02)
    u, t = multisine(1007), np.arange(PERIOD) / 750
    wanted = PLANT.simulate(t, u, periodic=True)
    error = found.model.simulate(t, u, periodic=True) - wanted
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.std(wanted)
    assert "levels" in str(found)


def test_plays_in_feedback_are_found():
    radii = np.array([2e-4, 6e-4, 1.2e-3])
    plant = Oscillator(2.0, 20.0, 8e4, PrandtlIshlinskii(radii, [1e4, 8e3, 6e3]))
    begin = Oscillator(1.5, 30.0, 9e4, PrandtlIshlinskii(radii, np.zeros(3)))
    found = identify(record(plant, substeps=6), Vibration(begin, PERIOD, substeps=6))
    wanted = np.array([2.0, 20.0, 8e4, 1e4, 8e3, 6e3])
    assert (np.abs(found.parameters - wanted) < 4 * found.sd).all()
    assert found.names[-1] == "weight 2"


def test_a_record_from_rest_with_gaps_is_enough():
    t = np.arange(2 * PERIOD) / 750
    u = np.interp(t, [0, 0.1], [0, 1]) * np.tile(multisine(1002), 2)
    y = PLANT.simulate(t, u, substeps=16)
    y = y + NOISE * np.random.default_rng(1003).normal(size=t.size)
    y[300:320] = np.nan
    found = identify(Record(u, y, t, skip=10), Vibration(start(np.full(7, 1.3))))
    assert found.motion.scored.sum() == t.size - 30
    assert found.noise is None
    assert (np.abs(found.parameters - TRUE) < 4 * found.sd).all()
    assert found.error == pytest.approx(NOISE, rel=0.1)


def test_a_model_that_lacks_something_says_so(settled):
    begin = Oscillator(2.0, 10.0, 1e5, BoucWen(1e-3, 0.0, 0.0))
    fixed = ("alpha", "gamma", "delta", "exponent")
    found = identify(settled, Vibration(begin, PERIOD, fixed=fixed))
    assert any("times the noise of the record" in text for text in found.advice)


def test_a_force_of_the_wrong_sign_is_refused(settled):
    with pytest.raises(SignalError, match="which both must be positive"):
        identify(settled.replace(y=-settled.y), Vibration(period=PERIOD))

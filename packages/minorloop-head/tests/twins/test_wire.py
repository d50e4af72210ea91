import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop_head.twins.wire import DIAMETER, WIRE, Wire

VOLT = 0.4 / 1.2
"""Current in A for each volt of the command in the paper."""


def hot(current=0.4, **options):
    """Truth after a long hold."""
    twin = Wire(log_truth=True, **options)
    twin.apply(current, 120.0, 120.0)
    return {name: float(values[-1, 0]) for name, values in twin._truth().items() if name != "t"}


def resistance(xi, wire=WIRE):
    """Resistance in ohm per metre at fraction xi."""
    mixed = wire["resistivity_austenite"] * (1 - xi) + wire["resistivity_martensite"] * xi
    return mixed / (np.pi / 4 * DIAMETER**2)


def by_hand(z, xi, wire=WIRE):
    """Stress, temperature and angle in degrees at effective temperature z, fraction xi."""
    area = np.pi / 4 * DIAMETER**2
    rest = wire["preload"] / area / wire["modulus_martensite"]
    slack = wire["recoverable_strain"] * (1 - xi) + rest
    modulus = wire["modulus_austenite"] * (1 - xi) + wire["modulus_martensite"] * xi
    pull = wire["preload"] + wire["spring"] * wire["length"] * slack
    stress = pull / (area + wire["spring"] * wire["length"] / modulus)
    angle = np.degrees(wire["length"] * (slack - stress / modulus) / wire["pulley"])
    return stress, z + stress / wire["stress_influence"], angle


def heating(z):
    """Fraction on the way up from the cold, and its slope (Liang and Rogers, 1990)."""
    start, finish = WIRE["austenite_start"], WIRE["austenite_finish"]
    a = np.pi / (finish - start)
    inside = start < z < finish
    xi = 0.5 * (np.cos(a * (np.clip(z, start, finish) - start)) + 1)
    return xi, -0.5 * a * np.sin(a * (z - start)) if inside else 0.0


@pytest.mark.parametrize("volts", [0.75, 0.95, 1.15])
def test_settles_on_the_cosine_of_liang_and_rogers(volts):
    truth = hot(volts * VOLT)
    z = truth["temperature"] - truth["stress"] / WIRE["stress_influence"]
    xi = heating(z)[0]
    assert truth["martensite"] == pytest.approx(xi, abs=1e-9)
    stress, _, angle = by_hand(z, xi)
    assert truth["stress"] == pytest.approx(stress, rel=1e-9)
    assert truth["angle"] == pytest.approx(angle, abs=1e-6)


def test_cools_along_the_cosine_of_liang_and_rogers():
    twin = Wire(log_truth=True)
    twin.apply(0.4, 60.0, 60.0)
    b = np.pi / (WIRE["martensite_start"] - WIRE["martensite_finish"])
    for volts in (1.0, 0.9, 0.8, 0.7, 0.6):
        twin.apply(volts * VOLT, 80.0, 80.0)
        truth = {name: values[-1, 0] for name, values in twin._truth().items() if name != "t"}
        z = truth["temperature"] - truth["stress"] / WIRE["stress_influence"]
        z = min(z, WIRE["martensite_start"])
        cosine = 0.5 * (np.cos(b * (z - WIRE["martensite_finish"])) + 1)
        assert truth["martensite"] == pytest.approx(cosine, abs=1e-9)


def test_keeps_the_balance_of_heat():
    twin = Wire(log_truth=True, substeps=10)
    area = np.pi / 4 * DIAMETER**2
    mass = WIRE["density"] * area
    gained = 0.0
    step = 0.01
    before = np.array([20.0, 1.0])
    for current in np.repeat([0.4, 0.1, 0.3, 0.0], 500):
        twin.apply(float(current), step, step)
        truth = twin._truth()
        temperature, xi = truth["temperature"][-1, 0], truth["martensite"][-1, 0]
        lost = 75.0 * np.pi * DIAMETER * (temperature - 20.0)
        gained += step * (current**2 * resistance(xi) - lost)
        now = np.array([temperature, xi])
    stored = mass * np.dot([WIRE["heat_capacity"], -WIRE["latent_heat"]], now - before)
    assert gained == pytest.approx(stored, abs=0.05)


@given(st.lists(st.floats(0.0, 0.4), min_size=2, max_size=8))
@settings(max_examples=30)
def test_more_current_never_means_less_angle(currents):
    low, high = Wire(tick=2.0), Wire(tick=2.0)
    for current in currents:
        assert low.exchange(current) <= high.exchange(min(current + 0.02, 0.4)) + 1e-9

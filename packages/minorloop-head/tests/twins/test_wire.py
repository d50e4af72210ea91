import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop_head.twins.surroundings import Cooling, Course, Surroundings
from minorloop_head.twins.wire import DIAMETER, WIRE, Wire

VOLT = 0.4 / 1.2
"""Current in A for each volt of the command in the paper."""


def settled(commands, *, hold=80.0, **options):
    """Angle at the end of each hold, from the cold wire."""
    twin = Wire(**options)
    return np.array([twin.apply(v * VOLT, hold, hold).y[-1] for v in commands])


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


def test_reaches_the_published_angle_and_the_figures_of_the_design():
    truth = hot()
    assert truth["angle"] == pytest.approx(60.0, abs=0.5)
    assert truth["temperature"] == pytest.approx(128.0, abs=0.5)
    assert truth["stress"] == pytest.approx(310e6, abs=2e6)
    assert truth["martensite"] == 0.0


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


def test_is_no_preisach_operator_loops_are_not_congruent():
    heights = []
    for past in ([0.0], [0.0, 1.2], [0.0, 1.2, 0.7, 1.05]):
        y = settled([*past, 0.85, 0.95, 0.85, 0.95])
        heights.append(y[-1] - y[-2])
    assert np.ptp(heights) / np.mean(heights) > 0.05


@given(st.lists(st.floats(0.0, 0.4), min_size=2, max_size=8))
@settings(max_examples=30)
def test_more_current_never_means_less_angle(currents):
    low, high = Wire(tick=2.0), Wire(tick=2.0)
    for current in currents:
        assert low.exchange(current) <= high.exchange(min(current + 0.02, 0.4)) + 1e-9


def test_the_hottest_and_most_stressed_moment_is_kept_until_reset():
    twin = Wire()
    twin.apply(0.4, 60.0, 60.0)
    twin.apply(0.0, 60.0, 60.0)
    temperature, stress = twin._peaks()
    assert temperature[0] == pytest.approx(128.0, abs=0.5)
    assert stress[0] == pytest.approx(310e6, abs=2e6)
    twin.reset()
    assert twin._peaks()[0] == [20.0]


@pytest.mark.parametrize("film", [1000.0, 3000.0])
def test_a_flooded_wire_warms_by_a_few_kelvin_and_cannot_turn(film):
    truth = hot(surroundings=Surroundings(convection=film))
    assert 2.0 < truth["temperature"] - 20.0 < 7.0
    assert truth["martensite"] == 1.0
    assert abs(truth["angle"]) < 1e-9


def test_a_load_stretches_the_wire_and_a_swinging_one_shakes_it():
    plain = hot(0.33)
    loaded = hot(0.33, surroundings=Surroundings(load=2e-3))
    assert loaded["angle"] < plain["angle"]
    sway = Surroundings(load=Course(0.0, amplitude=2e-3, period=4.0))
    y = Wire(surroundings=sway).apply(0.33, 80.0, 0.1).y[-80:]
    assert 0.5 < np.ptp(y) < 20
    np.testing.assert_allclose(y[:40], y[40:], atol=0.2)


def test_convection_grows_with_temperature_and_bending():
    """At full current the film is (rise / 50)^0.148 times 1 + bend x angle of the given one."""
    cooling = Cooling(share=0.0)
    plain, varying = hot(), hot(surroundings=Surroundings(cooling=cooling))
    rise = varying["temperature"] - 20.0
    film = 75.0 * (rise / 50.0) ** 0.148 * (1.0 + 0.1 * np.radians(varying["angle"]))
    gained = 0.4**2 * resistance(varying["martensite"])
    assert film * np.pi * DIAMETER * rise == pytest.approx(gained, rel=1e-6)
    assert 10.0 < plain["temperature"] - varying["temperature"] < 25.0


def test_a_wire_warms_the_body_of_the_head_and_the_body_the_wire():
    cooling = Cooling(exponent=0.0, bend=0.0)
    twin = Wire(surroundings=Surroundings(cooling=cooling), log_truth=True)
    minutes = twin.apply(0.31, 3600.0, 60.0).y
    truth = {name: values[-1, 0] for name, values in twin._truth().items() if name != "t"}
    # What the body gets from the wire leaves it to the ambient; so does the rest of the heat.
    flow = 75.0 * np.pi * DIAMETER * WIRE["length"]
    own = cooling.share * flow * (truth["temperature"] - truth["body"])
    assert own == pytest.approx(cooling.conductance * (truth["body"] - 20.0), rel=1e-3)
    rest = (1.0 - cooling.share) * flow * (truth["temperature"] - 20.0)
    gained = 0.31**2 * resistance(truth["martensite"]) * WIRE["length"]
    assert own + rest == pytest.approx(gained, rel=1e-3)
    assert 2.0 < truth["body"] - 20.0 < 10.0
    assert minutes[-1] - minutes[0] > 4.0  # it goes on turning for minutes


def test_an_old_wire_has_less_stroke_and_needs_more_heat():
    young, old = hot(), hot(ageing=1.0)
    assert old["angle"] / young["angle"] == pytest.approx(0.9, abs=0.01)
    assert settled([0.9], ageing=1.0)[0] < 0.7 * settled([0.9])[0]
    assert abs(settled([0.0], ageing=1.0)[0]) < 1e-9

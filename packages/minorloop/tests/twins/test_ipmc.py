import numpy as np
import pytest

from minorloop.lab.records import Record
from minorloop.twins.ipmc import Ipmc

LEVELS = np.linspace(-1.2, 1.2, 11)
HOLD = 200.0


def settled(inputs, *, hold=HOLD, **options):
    """Curvature at the end of each hold, from the state at rest."""
    twin = Ipmc(**options)
    return np.array([twin.apply(u, hold, hold).y[-1] for u in inputs])


def decaying_staircase():
    """Ten bands up, nine down, eight up, ...: 56 inputs."""
    level, inputs = 0, [LEVELS[0]]
    for turn, length in enumerate(range(10, 0, -1)):
        for _ in range(length):
            level += 1 if turn % 2 == 0 else -1
            inputs.append(LEVELS[level])
    return np.array(inputs)


def replay(reference, substeps=1):
    """Follow the input of the reference file; the output at its times."""
    t, u, _ = reference.T
    twin, began, first, pieces = Ipmc(substeps=substeps), 0.0, 0, []
    sine = int(np.searchsorted(t, 5720.05))
    while first < sine:
        interval = round(t[first] - began, 6)
        last = first
        while (
            last + 1 < sine
            and u[last + 1] == u[first]
            and interval == round(t[last + 1] - t[last], 6)
        ):
            last += 1
        pieces.append(twin.apply(u[first], t[last] - began, interval).y)
        began, first = t[last], last + 1
    fine = np.linspace(0.0, 40.0, 4 * 240 + 1)
    wave = twin.drive(fine, 0.7 * np.sin(2 * np.pi * 0.1 * fine))
    return np.concatenate([*pieces, np.interp(t[sine:], wave.t, wave.y)])


@pytest.fixture(scope="module")
def reference(shared_data):
    file = shared_data / "twins" / "ipmc_reference.csv"
    if not file.is_file():
        pytest.skip(f"needs {file.name}, which is not in ../shared/data/twins")
    return np.loadtxt(file, delimiter=",", skiprows=1)


def ends_of_holds(u, upto):
    return np.flatnonzero(np.diff(u[:upto]) != 0)


def test_follows_the_reference(reference):
    _, u, y = reference.T
    error = np.abs(replay(reference) - y) / np.ptp(y)
    assert error.max() < 0.01
    assert error[ends_of_holds(u, 1280)].max() < 0.001


def test_the_decaying_staircase_has_the_published_trend():
    u = decaying_staircase()
    y = settled(u)
    assert u.size == 56
    np.testing.assert_allclose(np.polyfit(u, y, 2), [-0.36, 8.20, 0.34], atol=0.006)
    np.testing.assert_allclose([y.min(), y.max()], [-9.5, 9.4], atol=0.05)


def test_gain_grows_with_the_amplitude():
    t = np.arange(8 * 240 + 1) / 240 / 0.1
    carrier = np.exp(-2j * np.pi * 0.1 * t)
    gains = []
    for amplitude in (0.7, 1.0):
        y = Ipmc().drive(t, -amplitude * carrier.imag).y
        gains.append(abs(np.mean(y[-960:] * carrier[-960:])) / amplitude)
    assert 20 * np.log10(gains[1] / gains[0]) == pytest.approx(0.75, abs=0.1)


def test_excursions_are_not_wiped_out():
    straight = settled([-1.2, 0.24])[-1]
    around = settled([-1.2, 0.24, -0.24, 0.24])[-1]
    later = settled([-1.2, 0.24, 0.96])[-1] - settled([-1.2, 0.24, -0.24, 0.24, 0.96])[-1]
    assert 0.01 < abs(around - straight) / 19 < 0.05
    assert abs(later) / 19 > 0.002


def test_safe_takes_the_voltage_off():
    twin, other = Ipmc(), Ipmc()
    for each in (twin, other):
        each.apply(1.0, 10.0, 10.0)
    twin.safe()
    assert twin.clock == other.clock
    assert twin.apply(0.0, 5.0, 5.0).y[-1] == other.apply(0.0, 5.0, 5.0).y[-1]


def test_sensed_bending_fades():
    t = np.linspace(0, 40, 401)
    record = Ipmc().sense(t, np.minimum(t / 0.5, 1.0) * 10.0)
    assert (str(record.input), str(record.output)) == ("curvature [1/m]", "voltage [mV]")
    assert 2.0 < record.y.max() < 2.5
    assert abs(record.y[-1]) < 1e-3
    tau = -1 / np.polyfit(t[20:200], np.log(record.y[20:200]), 1)[0]
    assert tau == pytest.approx(4.0, rel=1e-6)
    assert isinstance(record, Record)


def test_sensing_is_linear_and_needs_no_fine_samples():
    t = np.linspace(0, 10, 11)
    bend = np.abs(t - 5.0)
    coarse = Ipmc().sense(t, bend)
    fine = Ipmc().sense(np.linspace(0, 10, 1001), np.interp(np.linspace(0, 10, 1001), t, bend))
    np.testing.assert_allclose(fine.y[::100], coarse.y, atol=1e-12)
    np.testing.assert_allclose(Ipmc().sense(t, -2 * bend).y, -2 * coarse.y, atol=1e-12)

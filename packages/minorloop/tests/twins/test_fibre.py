import numpy as np
import pytest

from minorloop.twins.fibre import Fibre

HOLD = 300.0
REST = [0.2] * 3


def settled(inputs, **options):
    """Length change at the end of each hold, from 900 s at the lowest voltage."""
    twin = Fibre(**options)
    return np.array([twin.apply(u, HOLD, HOLD).y[-1] for u in (*REST, *inputs)])[len(REST) :]


def replay(reference, substeps=1):
    t, u, _ = reference.T
    twin, began, first, pieces = Fibre(substeps=substeps), 0.0, 0, []
    for last in [*np.flatnonzero(np.diff(u)), u.size - 1]:
        pieces.append(twin.apply(u[first], t[last] - began, 5.0).y)
        began, first = t[last], last + 1
    return np.concatenate(pieces)


@pytest.fixture(scope="module")
def reference(shared_data):
    file = shared_data / "twins" / "fibre_reference.csv"
    if not file.is_file():
        pytest.skip(f"needs {file.name}, which is not in ../shared/data/twins")
    return np.loadtxt(file, delimiter=",", skiprows=1)


def test_follows_the_reference(reference):
    _, u, y = reference.T
    error = np.abs(replay(reference) - y) / np.ptp(y)
    assert error.max() < 0.01
    assert error[np.flatnonzero(np.diff(u))].max() < 0.001


@pytest.mark.parametrize(("start", "t63", "t95"), [(0.40, 27, 72), (0.50, 37, 102)])
def test_steps_to_045_have_the_expected_rise_times(start, t63, t95):
    twin = Fibre()
    for u in [*REST, *np.arange(0.25, start + 0.01, 0.05)]:
        before = twin.apply(u, HOLD, HOLD).y[-1]
    record = twin.apply(0.45, 600.0, 0.25)
    share = (record.y - before) / (record.y[-1] - before)
    elapsed = 0.25 * np.arange(1, share.size + 1)
    assert elapsed[np.argmax(share >= 0.63)] == pytest.approx(t63, rel=0.06)
    assert elapsed[np.argmax(share >= 0.95)] == pytest.approx(t95, rel=0.06)
    assert share[int(HOLD / 0.25)] == pytest.approx(1, abs=0.005)


def test_excursions_are_not_wiped_out():
    straight, around = settled([0.4]), settled([0.4, 0.3, 0.4])
    later = settled([0.5, 0.55])[-1] - settled([0.5, 0.25, 0.5, 0.55])[-1]
    assert abs(around[-1] - straight[-1]) / 180 > 0.01
    assert abs(later) / 180 > 0.003

import numpy as np
import pytest

from minorloop.twins.fibre import Fibre


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

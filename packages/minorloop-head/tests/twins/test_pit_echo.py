import numpy as np
import pytest

from minorloop_head.twins.pipe import Bore
from minorloop_head.twins.pit_echo import basis_of

K = np.array([30e3, 42e3, 55e3])
FLAT = 1e9  # m, a pipe so wide that its wall is flat


def test_the_echo_of_a_plane_wave_is_delayed_by_twice_the_depth():
    basis = basis_of(Bore(0.0, 0.0, 1e-3, depth=0.4e-3), FLAT, K[-1])
    heard = basis.echo(np.ones((3, len(basis.places)), dtype=complex), K)
    expected = 2j * K * np.pi * 0.25e-6 * np.exp(2j * K * 0.4e-3)
    assert heard == pytest.approx(expected, rel=1e-4)


def test_the_modes_are_orthonormal():
    basis = basis_of(Bore(0.0, 0.0, 1.2e-3, depth=0.4e-3), 10e-3, K[-1])
    gram = basis.modes.T.astype(float) @ (basis.weights[:, None] * basis.modes)
    assert gram == pytest.approx(np.eye(len(gram)), abs=1e-4)


def test_a_tilted_or_dished_floor_answers_more_softly():
    wave = np.ones((3, 1), dtype=complex)

    def loud(**floor):
        basis = basis_of(Bore(0.0, 0.0, 1e-3, depth=0.4e-3, **floor), FLAT, K[-1])
        return np.abs(basis.echo(wave * np.ones(len(basis.places)), K))

    flat = loud()
    assert (loud(floor_tilt=(0.07, 0.0)) < 0.9 * flat).all()
    assert (loud(dish=0.1e-3) < 0.7 * flat).all()

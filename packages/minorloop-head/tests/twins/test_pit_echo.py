import numpy as np
import pytest

from minorloop_head.twins.pipe import Bore, Crack
from minorloop_head.twins.pit_echo import basis_of, basis_of_crack

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


WAVES = 2 * np.pi * np.array([8e6, 12e6]) / 1482.0
COURSE = basis_of_crack(Crack(((0.0, 0.0), (0.0, 3e-3)), (0.3e-3, 0.3e-3)), 10e-3)
PART = COURSE.near(0.0, 1.5e-3, 10e-3, 1.2e-3)


def beam(width=0.25e-3):
    """A smooth beam on the mouth (F, P, Q)."""
    y, z = COURSE.points[PART][..., 1], COURSE.points[PART][..., 2]
    square = (y**2 + (z - 1.5e-3) ** 2) / width**2
    return np.exp(-0.5 * square)[None] * np.ones((2, 1, 1), dtype=complex)


def test_a_broad_beam_goes_down_and_up_as_a_plane_wave():
    mouth = np.ones_like(beam()) * np.hanning(len(PART))[None, :, None]
    echo = np.divide(*COURSE.echo(mouth, PART, WAVES, 0.5e-3, 0.0))
    assert np.abs(echo / np.exp(2j * WAVES * 0.5e-3) - 1).max() < 0.05


def test_without_depth_it_is_the_wall_over_its_mouth():
    area = 0.04e-3 * (beam() ** 2 @ COURSE.weights * COURSE.widths[PART]).sum(axis=1)
    assert COURSE.echo(beam(), PART, WAVES, 0.0)[0] == pytest.approx(2j * WAVES * area, rel=0.02)


def test_the_echo_of_a_narrow_beam_is_earlier_and_weaker_than_of_a_plane_wave():
    echo = COURSE.echo(beam(0.06e-3), PART, WAVES, 0.5e-3)[0]
    plain = COURSE.echo(beam(0.06e-3), PART, WAVES, 0.0)[0]
    assert (np.abs(echo / plain) < 0.97).all()
    assert (np.angle(echo / plain / np.exp(2j * WAVES * 0.5e-3)) < 0).all()

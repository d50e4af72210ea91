"""A scan of a pit on the flank of a dent."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.ultrasound.joint_fit import JointFit, bent_fit, is_bent, moves, renewed
from minorloop_head.ultrasound.pit_model import PitModel
from minorloop_head.ultrasound.pits import measure_pit
from minorloop_head.ultrasound.spectra import spectra_of
from papers.catheter.scan_trials import draw_trial, scan

PITCHED = 1005


@pytest.fixture(scope="module")
def dented():
    return draw_trial(PITCHED, kind="dented", pose="gyroscope")


@pytest.fixture(scope="module")
def scanned(dented):
    return scan(dented)


@pytest.fixture(scope="module")
def spectra(dented, scanned):
    return spectra_of(scanned[1], scanned[0], dented.centre)


@pytest.fixture(scope="module")
def plain(dented, scanned, spectra):
    return fit_of(dented.diameter / 2, dented, scanned, spectra)


def fit_of(radius, dented, scanned, spectra):
    """A fit about a mouth of this radius in a wall that is not bent."""
    return JointFit(PitModel(scanned[0], spectra.angles, dented.centre, radius), spectra)


@pytest.mark.whole
def test_a_pit_in_a_dent_is_measured_below_the_wall_about_it(dented, scanned):
    probe, bursts = scanned
    found = measure_pit(bursts, probe, dented.centre, dented.diameter)
    assert found.verdict == "measured"
    assert found.depth == pytest.approx(dented.depth, abs=3 * found.depth_sd)
    assert found.depth == pytest.approx(dented.depth, abs=20e-6)


def test_the_shape_explains_the_distances(dented, scanned, plain):
    assert is_bent(plain, 6e-6)
    fit = bent_fit(scanned[1], plain)
    assert fit.range_error < 2e-6
    assert 0 < fit.unknown < 10e-6
    again = renewed(fit, np.array([0.0, 0.0, 0.0, dented.depth, 1.0, 0.0, 0.0, 0.0]))
    assert again.unknown < 10e-6


def test_too_few_bursts_beside_a_mouth_give_no_shape(dented, scanned, spectra):
    wide = fit_of(0.95e-3, dented, scanned, spectra)
    assert bent_fit(scanned[1], wide) is None


def test_a_head_that_does_not_move_shows_no_wall(scanned):
    _, bursts = scanned
    rng, one = np.random.default_rng(1), bursts[0]
    still = [
        replace(one, trace=one.trace + rng.normal(0, one.noise, one.trace.size)) for _ in bursts
    ]
    assert moves(bursts)
    assert not moves(still)
    assert not moves([*bursts[:9], *still[9:]])

import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop import RelayModel, Smooth
from minorloop.identification.curves import Curves
from minorloop.identification.jumps import find_jumps
from plane_records import a_plane

LEVELS = np.linspace(-1.2, 1.2, 26)
WHOLE = Curves.whole("negative")
RELAYS = RelayModel([-0.6, -0.217, 0.313, 0.52], np.diag([0.3, 0.4], -2))
"""Up at 0.313 and down at -0.6, up at 0.52 and down at -0.217."""


def a_record(seed=1000, turns=60, each=60, noise=0.0):
    rng = np.random.default_rng(seed)
    ends = np.concatenate([[-1.2, 1.2, -1.2], rng.uniform(-1.2, 1.2, turns)])
    u = np.interp(np.arange((turns + 2) * each) / each, np.arange(ends.size), ends)
    y = 0.04 * a_plane().simulate(u) + RELAYS.simulate(u)
    return u, y + noise * np.ptp(y) * rng.normal(size=u.size)


def jumps_of(u, y, levels=LEVELS, curves=WHOLE):
    return find_jumps(u, y, np.isfinite(y), curves, levels)


@pytest.mark.parametrize("noise", [0.0, 3e-3])
def test_jumps_are_found_between_the_samples_around_their_thresholds(noise):
    found = jumps_of(*a_record(noise=noise))
    for threshold, rising in ((0.313, True), (0.52, True), (-0.217, False), (-0.6, False)):
        (one,) = [jump for jump in found if jump.low <= threshold <= jump.high]
        assert one.rising == rising
        assert one.seen >= 3
        assert one.high - one.low < 0.02
    assert len(found) == 4


def test_a_fit_with_narrow_bands_predicts_other_inputs():
    u, y = a_record()
    other, wanted = a_record(1001)
    found = identify(u, y, prior=Smooth(0.0))
    smeared = identify(u, y, Plane(LEVELS), prior=Smooth(0.0))
    errors = [np.sqrt(np.mean((one.predict(other) - wanted) ** 2)) for one in (found, smeared)]
    assert errors[0] < 0.2 * errors[1]
    assert smeared.jumps == ()
    assert dict(found.summary())["jumps at"] == ", ".join(map(str, found.jumps))
    assert found.posterior is None


def test_jumps_within_given_narrow_bands_count_and_these_thresholds_stay():
    u, y = a_record()
    other, wanted = a_record(1001)
    thresholds = np.array([-0.6, -0.217, 0.313, 0.52])
    levels = np.union1d(LEVELS, [thresholds - 1e-3, thresholds + 1e-3])
    found = identify(u, y, Plane(levels))
    np.testing.assert_array_equal(found.model.levels, levels)
    assert len(found.jumps) == 4
    assert found.posterior is None
    assert np.sqrt(np.mean((found.predict(other) - wanted) ** 2)) < 0.01 * np.ptp(wanted)


def test_held_inputs_of_a_smooth_plant_have_no_jumps_and_those_of_relays_have_theirs():
    up = np.concatenate([np.linspace(-1, 1, 61), np.linspace(1, -1, 61)])
    steep = np.tile(np.tanh(2 * up), 4)
    held, each = np.repeat(np.tile(up, 4), 10), np.repeat(steep, 10)
    assert jumps_of(held, each) == ()
    jumping = each + np.repeat(RELAYS.simulate(np.tile(up, 4)), 10)
    found = jumps_of(held, jumping)
    assert [jump.rising for jump in found] == [True, True, False, False]


def test_jumps_that_are_rare_or_between_coarse_inputs_or_curves_do_not_count():
    up = np.linspace(-1, 1, 101)
    y = np.where(up > 0.1, 1.0, 0.0) + up
    assert jumps_of(np.tile(up, 2), np.tile(y, 2)) == ()
    assert len(jumps_of(np.tile(up, 3), np.tile(y, 3))) == 1
    coarse = slice(None, None, 5)
    assert jumps_of(np.tile(up[coarse], 3), np.tile(y[coarse], 3)) == ()
    flat = np.concatenate([np.linspace(0.1, 0.2, 20)] * 4)
    reset = np.concatenate([np.full(20, 1.0 * (k % 2)) for k in range(4)])
    begins = np.arange(0, 80, 20)
    assert jumps_of(flat, reset, curves=Curves(begins, "negative")) == ()

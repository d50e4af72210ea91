"""Maps of sweeps whose echoes are made here: pulses at the distance of a surface."""

import math
from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.geometry import Mount, Probe, wrapped
from minorloop_head.reconstruction.depth_map import Patch
from minorloop_head.ultrasound.c_scan import CRACK, NO_ECHO, PIT, c_scan
from minorloop_head.ultrasound.echoes import Burst, Pulse
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.wall_echoes import SweptBurst, beam_width
from minorloop_head.ultrasound.wall_shape import speed_error

PROBE = CalibratedProbe(Probe(), Mount())
BOTTOM, Z, STEP, NOISE = math.pi / 2, 20e-3, 10e-9, 0.02
PATCH = Patch.around(BOTTOM, Z, size=4e-3)
COSINE = 1 - 0.25 * math.atan(2.5 / 8) ** 2
"""Of the way of the waves of a focused beam to the axis, in the mean."""
_PULSE = Pulse().samples(STEP)


def trace(depth, share, rng):
    """An echo of the wall with a share, and of a floor with the rest."""
    samples = NOISE * rng.standard_normal(2048)
    for beyond, part in ((0.0, share), (depth, 1 - share)):
        at = round(2 * (8e-3 + COSINE * beyond) / PROBE.speed / STEP)
        samples[at - len(_PULSE) // 2 : at + len(_PULSE) // 2 + 1] += part * _PULSE
    return samples


def swept(depth_of=None, share_of=None, *, size=4e-3, step=0.24e-3, off=None, middle=BOTTOM):
    """Bursts on a square about the bottom, of what lies at x and y metres from its middle."""
    rng, found = np.random.default_rng(5), []
    steps = np.arange(-size / 2, size / 2, step)
    for y in steps:
        for x in steps + rng.uniform(-0.05e-3, 0.05e-3):
            depth = 0.0 if depth_of is None else depth_of(x, y)
            share = (0.0 if depth else 1.0) if share_of is None else share_of(x, y)
            far = 8e-3 + (0.0 if off is None else off(middle + x / 10e-3))
            burst = Burst(trace(depth, share, rng), STEP, np.zeros(2), 4, 4, NOISE)
            spot = np.array([float(wrapped(middle + x / 10e-3)), Z + y, far])
            found.append(SweptBurst(0.04 * len(found), np.zeros(2), spot, burst))
    return found


def at(one):
    """x and y of a burst, in metres from the middle."""
    return 10e-3 * (one.spot[0] - BOTTOM), one.spot[1] - Z


def dimmed(bursts, factor):
    """Bursts of which the traces are multiplied by a factor of x and y."""
    for one in bursts:
        one.burst.trace[:] *= factor(*at(one))
    return bursts


def round_pit(depth, diameter=1e-3):
    return lambda x, y: depth if math.hypot(x, y) < diameter / 2 else 0.0


def test_faulty_bursts_count_as_gaps():
    bursts = [
        replace(one, burst=replace(one.burst, verdict="clipped")) if one.spot[1] > Z else one
        for one in swept()
    ]
    found = c_scan(bursts, PROBE, PATCH)
    assert found.gap[PATCH.places[..., 1] > Z + 0.4e-3].all()
    assert found.gap[PATCH.places[..., 1] < Z - 0.4e-3].mean() < 0.05
    assert c_scan([replace(one, burst=bursts[-1].burst) for one in bursts], PROBE, PATCH).gap.all()


@pytest.mark.parametrize("depth", [0.3e-3, 0.8e-3])
def test_a_pit_is_found_with_depth_and_size(depth):
    (find,) = c_scan(swept(round_pit(depth)), PROBE, PATCH).finds
    assert find.kind == PIT
    assert find.depth == pytest.approx(depth, abs=3 * find.depth_sd)
    assert find.diameter == pytest.approx(1e-3, abs=0.15e-3)
    assert math.hypot(10e-3 * (find.phi - BOTTOM), find.z - Z) < 0.1e-3
    row = find.finding(10e-3)
    assert (row.kind, row.depth, row.width) == (PIT, find.depth, find.diameter)


def test_a_pit_that_a_gap_cuts_in_two_is_one_find():
    lines = [
        one for one in swept(round_pit(0.5e-3, 1.4e-3)) if not -0.3e-3 < one.spot[1] - Z < 0.2e-3
    ]
    (find,) = c_scan(lines, PROBE, PATCH).finds
    assert find.depth == pytest.approx(0.5e-3, abs=20e-6)
    assert math.hypot(10e-3 * (find.phi - BOTTOM), find.z - Z) < 0.2e-3


def test_a_smooth_dent_is_no_pit():
    dent = swept(lambda x, y: 0.2e-3 * math.exp(-0.5 * (x * x + y * y) / 0.5e-3**2))
    found = c_scan(dent, PROBE, PATCH)
    assert found.finds == ()
    assert np.nanmax(found.wall.depth) == pytest.approx(0.2e-3, abs=20e-6)
    assert found.noise[0] < 3e-6  # the dent is no noise


def lossy(share):
    """Bursts that lose a share of the echo on a line along x."""
    on_it = lambda x, y: abs(y) < 0.12e-3 and abs(x) < 1.4e-3  # noqa: E731
    return dimmed(swept(), lambda x, y: 1 - share * on_it(x, y))


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_a_slender_loss_of_the_echo_is_a_crack(share):
    (find,) = c_scan(lossy(share), PROBE, PATCH).finds
    assert find.kind == CRACK
    assert np.isnan(find.depth)
    assert find.length == pytest.approx(2.8e-3, rel=0.2)


def test_the_place_of_a_bent_crack_is_on_it():
    arch = lambda x: 0.8e-3 - 1.4e-3 * (x / 1.4e-3) ** 2  # noqa: E731
    on_it = lambda x, y: abs(y - arch(x)) < 0.25e-3 and abs(x) < 1.4e-3  # noqa: E731
    (find,) = c_scan(dimmed(swept(), lambda x, y: 1 - 0.5 * on_it(x, y)), PROBE, PATCH).finds
    assert find.kind == CRACK
    x, y = 10e-3 * (find.phi - BOTTOM), find.z - Z
    assert abs(y - arch(x)) < 0.3e-3


def test_the_band_of_a_depth_has_that_of_the_speed_of_sound():
    (shallow,), (deep,) = (
        c_scan(swept(round_pit(depth)), PROBE, PATCH).finds for depth in (0.2e-3, 1e-3)
    )
    _, share = speed_error(0.0, 10e-3 - PROBE.transducer.face)
    assert share > 1e-3
    for find in (shallow, deep):
        assert find.depth_sd >= np.hypot(4e-6, share * find.depth)
    assert deep.depth_sd > 1.1 * shallow.depth_sd


def test_a_slender_loss_between_walls_of_different_depth_is_the_flank_of_a_dent():
    step = dimmed(swept(), lambda x, y: 0.5 if abs(y) < 0.12e-3 else 1.0)
    for one in step:
        one.spot[2] -= np.interp(at(one)[1], [-0.2e-3, 0.2e-3], [0.0, 0.03e-3])
    assert c_scan(step, PROBE, PATCH).finds == ()


def test_losses_at_the_foot_of_a_bead_are_no_crack_where_sway_leaves_a_gap():
    bursts = []
    for one in swept(step=0.2e-3):
        x, y = np.abs(at(one)[0]), at(one)[1]
        if x > 0.5e-3 or not 0.1e-3 < y < 0.5e-3:
            on_it, foot = x < 0.5e-3 and -0.9e-3 < y < 0.1e-3, x < 0.9e-3 and 0.5e-3 < y < 0.7e-3
            one.burst.trace[:] *= 0.05 if on_it else 0.6 if foot else 1.0
            bursts.append(one)
    assert [find.kind for find in c_scan(bursts, PROBE, PATCH).finds] == [NO_ECHO]  # the bead


def test_floors_in_a_slender_loss_are_the_depth_of_a_crack():
    def gap(x, y):
        return 0.5e-3 if abs(y) < 0.15e-3 and abs(x) < 1.4e-3 else 0.0

    (find,) = c_scan(swept(gap), PROBE, PATCH).finds
    assert find.kind == CRACK
    assert find.depth == pytest.approx(0.5e-3, abs=20e-6)


def silenced(bursts, where):
    """Bursts of which those at some x and y metres from the middle have noise only."""
    rng = np.random.default_rng(7)
    for one in bursts:
        if where(*at(one)):
            one.burst.trace[:] = NOISE * rng.standard_normal(2048)
    return bursts


def test_a_place_without_an_echo_amid_wall_that_answers_is_a_find_without_a_depth():
    holed = silenced(swept(), lambda x, y: math.hypot(x - 0.3e-3, y) < 0.5e-3)
    (find,) = c_scan(holed, PROBE, PATCH).finds
    assert find.kind == NO_ECHO
    assert np.isnan(find.depth)
    assert find.diameter == find.length == pytest.approx(1e-3, abs=0.2e-3)
    assert math.hypot(10e-3 * (find.phi - BOTTOM) - 0.3e-3, find.z - Z) < 0.1e-3


@pytest.mark.parametrize(("height", "kinds"), [(0.0, [NO_ECHO]), (0.03e-3, [])])
def test_a_place_without_an_echo_whose_edge_rises_is_a_bead(height, kinds):
    bursts = swept(lambda x, y: -height if math.hypot(x, y) < 0.7e-3 else 0.0)
    bursts = dimmed(bursts, lambda x, y: 0.4 if 0.45e-3 <= math.hypot(x, y) < 0.7e-3 else 1.0)
    bursts = silenced(bursts, lambda x, y: math.hypot(x, y) < 0.45e-3)
    assert [find.kind for find in c_scan(bursts, PROBE, PATCH).finds] == kinds


def test_there_is_no_map_above_the_water():
    def wet(x, y):
        return 0.0

    bursts = swept(wet, middle=0.0)
    rng = np.random.default_rng(6)
    for one in bursts:
        if one.spot[0] < 0:
            one.burst.trace[:] = NOISE * rng.standard_normal(2048)
    patch = Patch.around(0.0, Z, size=4e-3)
    found = c_scan(bursts, PROBE, patch)
    assert found.water.height == pytest.approx(0.0, abs=0.2e-3)
    assert found.finds == ()
    width = beam_width(PROBE)
    high = 10e-3 * np.sin(patch.places[..., 0]) < found.water.height - width
    assert np.isnan(found.amplitude[high]).all()
    assert not found.gap[high].any()


def test_nothing_is_mapped_where_echoes_are_noise():
    bursts = silenced(swept(), lambda x, y: True)
    for one in bursts[7::12]:  # so loud that noise counts as an echo
        at = round(2 * 8e-3 / PROBE.speed / STEP)
        one.burst.trace[at - len(_PULSE) // 2 : at + len(_PULSE) // 2 + 1] += 0.04 * _PULSE
    found = c_scan(bursts, PROBE, PATCH)
    assert found.wall.unseen == 1.0
    assert np.isnan(found.amplitude).all()
    assert found.finds == ()


def test_without_a_lens_there_is_a_map_but_no_finds():
    disc = replace(PROBE, transducer=Probe(focus=math.inf))
    assert beam_width(disc) == disc.transducer.aperture
    found = c_scan(swept(round_pit(0.5e-3)), disc, PATCH)
    assert found.finds == ()
    assert np.nanmax(found.wall.depth) == pytest.approx(0.5e-3 * COSINE, abs=20e-6)

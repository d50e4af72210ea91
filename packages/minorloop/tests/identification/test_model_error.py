import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop import Gaussian, excitation
from minorloop.identification import _prior_kernels as kernels
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.model_error import Reach, contiguous_parts
from minorloop.identification.prior import prior_of
from minorloop.operators.preisach import Preisach

CELLS = PlaneSpec(np.linspace(0, 1, 26))


def travel(u):
    out = np.zeros(len(u))
    kernels.closed_travel(np.array(u, dtype=float), 0.25, 3.0, out)
    return out


def reach(u):
    inputs = np.array(u, dtype=float)
    matrix = DesignMatrix(CELLS, inputs, np.ones(inputs.size, dtype=bool), "negative")
    return Reach.of(matrix.spec, matrix.corner)


def squared_distance(known, u):
    inputs = np.array(u, dtype=float)
    wanted = np.ones(inputs.size, dtype=bool)
    return known.covariates(inputs, wanted, "negative")[:, 1]


def triangle(periods, samples):
    phase = np.linspace(0, periods, samples) % 1
    return 1 - np.abs(2 * phase - 1)


def walk(rng, samples, step):
    steps = np.cumsum(step * rng.normal(size=samples))
    return np.append(0.0, np.abs((steps + 1) % 2 - 1))


def bouc_wen(u, stiff=6.0, share=0.4):
    """Piezo stage after Bouc and Wen, whose small loops do not close."""
    z, last, out = -1.0, u[0], np.empty(u.size)
    for k, value in enumerate(u):
        steps = max(int(np.ceil(abs(value - last) / 0.01)), 1)
        for step in np.full(steps, (value - last) / steps):
            z += stiff * step * (1 - abs(z) * (0.6 * np.sign(step * z) + 0.4))
        last, out[k] = value, value - share * z / stiff
    return out


def test_each_closed_loop_adds_its_length_up_to_a_bound():
    loops = np.tile([0.1, 0.2], 20)
    found = travel(np.append(0.1, loops))
    np.testing.assert_allclose(np.diff(found[3:30:2]), 0.2, atol=1e-12)
    assert travel(np.tile([0.1, 0.2], 200)).max() == 3.0


def test_distance_counts_from_the_cells_that_were_reached():
    known = reach(triangle(3, 300))
    minor = [0.0, 1.0, 0.3, 0.7]  # a turn within the major loop
    assert squared_distance(known, triangle(2, 300)).max() == 0
    assert squared_distance(known, minor)[-1] == pytest.approx(0.3**2, abs=0.02)
    assert squared_distance(reach([*triangle(3, 300), *minor]), minor)[-1] == 0


def test_parts_are_contiguous():
    part = contiguous_parts(1500)
    assert set(np.diff(part)) == {0, 1, -4}
    np.testing.assert_array_equal(np.bincount(part), 300)


@pytest.mark.parametrize("prior", ["auto", "none"])
def test_bands_of_a_major_loop_are_wide_on_minor_loops(prior):
    rng = np.random.default_rng(1008)
    u, fresh = triangle(8, 800), walk(rng, 400, 0.1)
    y = bouc_wen(u) + 1e-3 * rng.normal(size=u.size)
    found = identify(u, y, prior=prior_of(prior), holdout=0.3)
    band = found.predict(fresh, bands=0.9)
    assert band.covers(bouc_wen(fresh)) > 0.6
    assert band.half_width.max() < 0.1 * np.ptp(y)
    assert band.beyond > 0.5
    assert "their bands are assumed, not measured" in str(band)
    assert found.predict(u, bands=0.9).beyond == 0
    assert found.predict([5.0, -5.0], bands=0.9).beyond == 1


def test_loops_that_close_make_bands_as_narrow_as_those_of_the_posterior():
    rng = np.random.default_rng(1080)
    levels = np.linspace(0, 1, 81)
    width = (levels[1:, None] + levels[:-1, None] - levels[1:] - levels[:-1]) / 2
    plant = Preisach(levels, np.tril(np.exp(-30 * (width - 0.2) ** 2)) / 500)
    u, fresh = walk(rng, 900, 0.08), walk(rng, 400, 0.1)
    y = plant.simulate(u)
    noise = 1e-3 * np.ptp(y) * rng.normal(size=u.size + fresh.size)
    found = identify(u, y + noise[: u.size], holdout=0.3)
    band = found.predict(fresh, bands=0.9)
    assert 0.85 < band.covers(plant.simulate(fresh) + noise[u.size :]) < 0.97
    sd = np.hypot(found.uncertainty.deviation(u, found.start), band.noise)[found.held_out]
    assert found.predict(u, bands=0.9).sd[found.held_out].mean() < 1.2 * sd.mean()


def test_few_parts_do_not_make_bands_narrower_than_those_of_the_posterior():
    levels = np.linspace(-1, 1, 11)
    plant = Preisach(levels, np.tril(np.ones((10, 10))) / 55)
    u = excitation.decaying_staircase(levels)
    y = plant.simulate(u) + 1e-3 * np.random.default_rng(1000).normal(size=u.size)
    found = identify(u, y, Plane(levels), prior=Gaussian())
    known = found.uncertainty.deviation(u, found.start)
    assert (found.predict(u, bands=0.9).sd > 0.9 * known).all()

import numpy as np
import pytest

from minorloop import modelfile
from minorloop.errors import ParameterError
from minorloop.identification.data_sheet import from_loop
from minorloop.identification.ridge import KINDS, Ridge
from minorloop.operators.preisach import Preisach

LOOP = (12.8, 0.58, 1.5, 217.0)


@pytest.fixture(scope="module")
def found():
    return from_loop(*LOOP)


def test_the_model_and_each_ridge_have_the_given_loop(found):
    for weights in (found.model.weights, *found.ridges[::8]):
        plane = Preisach(found.model.levels, weights, diagonal="reversible")
        y = plane.simulate([217.0, 0.0, -12.8, -217.0, 0.0, 12.8, 217.0])
        np.testing.assert_allclose(y, [1.5, 0.58, 0, -1.5, -0.58, 0, 1.5], atol=1e-5)
        assert weights.min() >= 0


def test_minor_loops_of_other_planes_with_the_loop_lie_in_the_bands():
    levels, rng = np.linspace(-1, 1, 41), np.random.default_rng(1000)
    down, inside, wide = np.linspace(1, -1, 401), [], []
    for kind in KINDS:
        ridge = Ridge(kind, *rng.uniform([0.1, 0.05, 0.05, 0, 0.2], [0.3, 0.3, 0.3, 0, 1.0]))
        share = rng.uniform(0.1, 0.4)
        weights = (1 - share) * ridge.irreversible(levels)
        plane = Preisach(levels, weights + share * np.diag(ridge.reversible(levels)))
        major = plane.simulate(down, "positive")
        sheet = from_loop(-np.interp(0.0, major[::-1], down[::-1]), major[200], 1.0, 1.0)
        for amplitude in (0.2, 0.4, 0.7):
            loop = sheet.predict(sheet.loop(amplitude), bands=0.9)
            inside.append(loop.covers(plane.simulate(loop.u, "demagnetised")))
            wide.append(loop.half_width.mean())
    assert np.mean(inside) > 0.85
    assert np.mean(wide) < 0.25


def test_it_does_not_depend_on_units(found):
    other = from_loop(12.8e3, 0.58e-6, 1.5e-6, 217e3)
    np.testing.assert_allclose(other.model.levels, 1e3 * found.model.levels, rtol=1e-12)
    np.testing.assert_allclose(other.model.weights, 1e-6 * found.model.weights, rtol=1e-9)
    assert from_loop(1.0, 0.5, 1.0).field == 5.0


def test_predictions_and_inverses_have_bands_and_files_have_a_warning(found, tmp_path):
    loop = found.loop(100.0)
    np.testing.assert_array_equal(found.predict(loop), found.predict(loop, bands=0.5).y)
    assert loop[0] == loop[-1] == -loop.min() == 100.0
    inverse = found.invert([0.5, -0.2])
    np.testing.assert_allclose(inverse.y, [0.5, -0.2], atol=1e-9)
    assert (inverse.sd > 0.02 * 1.5 * 0.99).all()
    assert inverse.warnings == found.warnings
    modelfile.save(found, tmp_path / "sheet.json", input="H [A/m]", output="B [T]")
    kept = modelfile.read(tmp_path / "sheet.json")
    assert kept.model == found.model
    assert "minor loops may be off by" in kept.warnings[0]
    assert kept.provenance.scores["remanence"] == 0.58
    assert "ridges with this loop" in str(found)


def test_loops_are_drawn_with_bands(found):
    left, right = found.plot(input_label="H [A/m]", output_label="B [T]").axes[:2]
    assert [line.get_xdata().max() for line in left.lines] == [217 / 4, 217 / 2, 217]
    assert len(left.collections) == 6
    assert left.get_ylabel() == "B [T]"
    assert right.get_title()


@pytest.mark.parametrize(
    ("loop", "says"),
    [
        ((0, 0.5, 1), "coercivity is 0; give a positive number"),
        ((1, -0.5, 1), "remanence is -0.5; give a positive number"),
        ((1, 0.5, float("nan")), "saturation is nan; give a finite number"),
        ((1, 1.5, 1), "remanence is 1.5 and saturation 1; give a remanence below"),
        ((1, 0.5, 1, 0.9), "field is 0.9 and coercivity 1; give the largest input"),
        ((1, 0.01, 1, 3), "no ridge has a loop of coercivity 1, remanence 0.01"),
    ],
)
def test_refuses(loop, says):
    with pytest.raises(ParameterError, match=says):
        from_loop(*loop)


def test_scales_near_the_ends_of_the_numbers_have_bands():
    found = from_loop(1e-200, 5e199, 1e200, field=5e-200)
    half = found.predict(found.loop(5e-200), bands=0.9).half_width
    assert np.isfinite(half).all()

import numpy as np
import pytest

from minorloop import ParameterError, Polynomial
from minorloop.positioning import ExperimentProtocol, run_positioning
from minorloop.twins.ipmc_laser import NOISE


def test_hysteresis_known_is_several_times_better_than_ignored():
    ratios = [run_positioning(seed).summary["rms_ratio"] for seed in range(10)]
    assert np.median(ratios) >= 5
    assert min(ratios) >= 3.3


def test_is_the_papers_experiment():
    result = run_positioning(3)
    assert result.summary["measurements"] == result.summary["unknowns"] == 56
    assert np.abs(result.targets).max() <= 7.5
    assert np.abs(result.quadratic.voltages).max() <= 1.2
    np.testing.assert_allclose(
        result.preisach.errors, result.preisach.achieved - result.targets, atol=1e-12
    )


@pytest.mark.parametrize("diagonal", ["uniform", "reversible"])
def test_targets_lie_in_their_bands(diagonal):
    setup = ExperimentProtocol(laser=True, diagonal=diagonal)
    shares = [run_positioning(seed, NOISE, setup).coverage for seed in range(1000, 1004)]
    assert 0.85 <= np.mean(shares) <= 0.98


def test_bands_are_as_wide_as_the_model_was_off_in_the_other_run():
    result = run_positioning(1000)
    other = result.identification.model.simulate([-1.2, *result.quadratic.voltages])[1:]
    off = np.sqrt(np.mean((result.quadratic.achieved - other) ** 2))
    np.testing.assert_allclose(result.bands.half_width, 1.6449 * off, rtol=1e-4)
    reached = np.abs(result.preisach.achieved - result.bands.y) <= result.bands.half_width
    assert result.coverage == reached.mean()


def test_a_quadratic_that_noise_has_bent_is_said_to_be_so(monkeypatch):
    bent = Polynomial([0.0, 0.0, 1.0], -1.2, 1.2)
    monkeypatch.setattr(Polynomial, "fit", lambda *_, **__: bent)
    with pytest.raises(ParameterError, match=r"noise is 3\.0 1/m, .* non-monotone .*; give less"):
        run_positioning(0, 3.0)

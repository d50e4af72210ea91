import numpy as np
import pytest

from papers.fibre import fibre_at_rest, run_steady


def test_seven_voltages_are_predicted_and_targets_reached():
    figures = run_steady(0).figures()
    assert figures["steady"]["curves_nrmse"] <= 0.015
    assert figures["steady"]["curves_max"] <= 0.03
    assert figures["inverse"]["rms_ratio"] >= 4


def test_its_sensor_has_noise_of_its_own_in_every_experiment():
    first, second = (
        np.asarray(fibre_at_rest(1000, experiment).apply(0.2, 400.0, 1.0).y)
        for experiment in (0, 1)
    )
    assert np.std(first[-200:]) == pytest.approx(1.0, rel=0.2)  # um
    assert np.std((first - second)[-200:]) == pytest.approx(np.sqrt(2), rel=0.2)

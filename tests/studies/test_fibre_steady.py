from minorloop.studies.fibre_steady import run_steady


def test_seven_voltages_are_predicted_and_targets_reached():
    figures = run_steady(0).figures()
    assert figures["steady"]["curves_nrmse"] <= 0.015
    assert figures["steady"]["curves_max"] <= 0.03
    assert figures["inverse"]["rms_ratio"] >= 4

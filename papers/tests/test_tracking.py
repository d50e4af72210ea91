from papers.tracking import run_tracking, synthetic_figures


def test_the_recursion_is_as_good_as_a_moving_batch_and_better_than_a_fixed_model():
    figures = run_tracking(0).figures()
    assert figures["twin_over_batch"] <= 1.25
    assert figures["twin_over_fixed"] < 0.6


def test_synthetic_planes_are_followed():
    found = synthetic_figures(0)
    assert found["synthetic_nrmse_fixed"] <= 0.005
    assert found["synthetic_nrmse_drift"] <= 0.01
    assert not found["diverged"]

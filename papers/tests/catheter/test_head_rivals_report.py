"""The controllers beside each other, and where the default is not the best."""

import math

from papers.catheter.head_report import STEP, rivals_table, where_better

OBSERVER = {"settle_s": 7.0, "overshoot_pct": 0.6, "steady_rms_deg": 0.08}
PI = {"settle_s": math.inf, "overshoot_pct": 0.64, "steady_rms_deg": 0.031}


def test_a_rival_that_is_better_is_named_with_both_numbers():
    said = where_better(STEP, {"observer": OBSERVER, "pi": PI}, "observer")
    assert said == (
        "On these figures others are better than the observer: "
        "Steady rms in deg: observer 0.08, PI alone 0.03."
    )


def test_a_difference_that_is_not_shown_does_not_count():
    rival = {**OBSERVER, "settle_s": 6.99, "steady_rms_deg": 0.078}
    said = where_better(STEP, {"observer": OBSERVER, "adaptive": rival}, "observer")
    assert said == "No other controller is better than the observer on any of these figures."


def test_a_tick_of_a_time_and_the_noise_of_a_reading_are_no_difference():
    rival = {**OBSERVER, "settle_s": 6.92, "overshoot_pct": 0.4}
    observer = {**OBSERVER, "settle_s": 6.96}
    said = where_better(STEP, {"observer": observer, "adaptive": rival}, "observer")
    assert said.startswith("No other")
    rival |= {"settle_s": 6.88, "overshoot_pct": 0.3}
    said = where_better(STEP, {"observer": observer, "adaptive": rival}, "observer")
    assert "Settling in s: observer 7.0, adaptive 6.9." in said
    assert "Overshoot in %: observer 0.6, adaptive 0.3." in said


def test_a_default_that_does_not_settle_is_worse_than_any_that_does():
    said = where_better(STEP[:1], {"observer": PI, "adaptive": OBSERVER}, "observer")
    assert "Settling in s: observer not reached, adaptive 7.0." in said


def test_the_table_has_words_where_there_is_no_number():
    table = rivals_table(STEP, {"observer": OBSERVER, "pi": {**PI, "overshoot_pct": math.nan}})
    assert table.columns == ("controller", "settling, s", "overshoot, %", "steady rms, deg")
    assert table.rows[1] == ("PI alone", "not reached", "none", "0.03")

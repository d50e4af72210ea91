from minorloop.lab.plan import Plan


def test_a_plan_of_minutes_says_minutes():
    assert str(Plan([0.0, 1.0], 600.0, input="u [V]")) == "2 levels of u [V], 20 min at most"

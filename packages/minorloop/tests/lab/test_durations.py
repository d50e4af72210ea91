import pytest

from minorloop.lab.durations import as_duration
from minorloop.lab.plan import Plan


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.25, "0.25 s"),
        (89.0, "89 s"),
        (90.0, "1.5 min"),
        (2000.0, "33.3 min"),
        (3600.0, "1 h"),
        (40_000.0, "11.1 h"),
    ],
)
def test_a_duration_has_a_suitable_unit(seconds, text):
    assert as_duration(seconds) == text


def test_a_plan_of_minutes_says_minutes():
    assert str(Plan([0.0, 1.0], 600.0, input="u [V]")) == "2 levels of u [V], 20 min at most"

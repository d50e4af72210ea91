import re
from pathlib import Path

import pytest

from minorloop.page.lab_words import ELSEWHERE, FIELDS, on_page

ROOT = Path(__file__).parents[4]


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("it, skip=30 (--record skip=30), or", "it, “Rows not fitted at the start”: 30, or"),
        ("pass holdout=0.3 (--holdout 0.3)", "pass “Held-out rows at the end”: 30%"),
        ('lag="auto" or lag=3 (--law lag=auto) takes it', "“Lag”: automatic takes it"),
        ('slope="auto" (--law slope=auto) may', "“Linear part (slope)”: automatic may"),
        ("leave --time out; name a column of curves (--record curves=COLUMN)",
         "leave “Time” out; name a column of curves “Curves, each with a new memory”"),
        ("rows apart (--record rows=A:B), or", "rows apart “First row” and “Rows up to”, or"),
        ("Dynamics() (--time COLUMN --law dynamics) shows whether",
         "“Dead time, poles and creep (dynamics)”: automatic shows whether"),
        ("it (reduce --flip output)", "it (reduce --flip output of the command minorloop)"),
        ("first (minorloop reduce)", "first with the command minorloop reduce LOG"),
        ("check the sensor", "check the sensor"),
    ],
)  # fmt: skip
def test_options_become_fields_of_the_page(said, shown):
    assert on_page(said) == shown


def test_the_fields_are_those_of_the_page():
    page = (ROOT / "web/lab.html").read_text()
    for label in FIELDS.values():
        for part in label.split("” and “"):
            assert f">{part}<" in page


def test_every_option_that_advice_names_is_known():
    """An option in brackets in the sentences of identification has a field or is elsewhere."""
    named = set()
    for file in (ROOT / "packages/minorloop/src/minorloop/identification").glob("*.py"):
        named |= set(re.findall(r"\((?:\w+ )?--(?:(?:law|record) )?([a-z_-]+)", file.read_text()))
    assert {name.replace("_", "-") for name in named} <= FIELDS.keys() | ELSEWHERE
    assert named

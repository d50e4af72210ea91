"""A few cases of each kind; `make fuzz` runs 100,000."""

import pytest

from fuzz.__main__ import run_cases
from fuzz.readers import Reader, WrongAcceptance, readers


@pytest.mark.parametrize("number", range(5))
def test_what_is_damaged_is_refused_or_right(number, tmp_path):
    accepted, failures = run_cases(readers(tmp_path)[number], 150)
    assert not failures, "\n".join(failures)
    assert 0 < accepted < 150


def test_a_reader_that_accepts_too_much_is_noticed():
    def accept(case):
        raise WrongAcceptance("it says another thing")

    assert len(run_cases(Reader("d", lambda random: b"x", accept), 3)[1]) == 3

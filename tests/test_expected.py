"""Cases of seconds give the figures that are expected of them; ``make compare`` has them all."""

import pytest

from expected.__main__ import compared
from expected.cases import CASES


@pytest.mark.parametrize("case", [case for case in CASES if case.quick], ids=lambda case: case.name)
def test_figures_are_those_expected(case):
    if case.missing:
        pytest.skip(f"{', '.join(case.missing)} is not there")
    assert compared(case) == []

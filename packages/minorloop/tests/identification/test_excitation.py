import numpy as np
import pytest

from minorloop.identification import excitation


@pytest.mark.parametrize(("bands", "condition"), [(4, None), (10, 73), (12, 106), (20, 300)])
def test_decaying_staircases_determine_everything(bands, condition):
    grid = np.linspace(0, 1, bands + 1)
    found = excitation.report(excitation.decaying_staircase(grid), grid)
    assert found.rank == found.unknowns == found.samples == 1 + bands * (bands + 1) // 2
    assert found.sufficient
    assert found.excited.sum() == found.unknowns - 1
    if condition:
        assert found.condition == pytest.approx(condition, rel=0.02)

from types import SimpleNamespace

import numpy as np
import pytest

from minorloop_head.ultrasound import deep_pit
from minorloop_head.ultrasound.spectra import LEAD, WINDOW

from .synthetic import fit_of, pit


@pytest.mark.parametrize(("thickness", "after"), [(1.2e-3, 0.0), (2e-3, 1.6e-6), (3e-3, 3.2e-6)])
def test_a_thicker_wall_needs_a_later_window(thickness, after):
    assert deep_pit.last_window_end(thickness) == pytest.approx(after + WINDOW - LEAD)


def test_traces_that_end_too_early_decide_nothing():
    short = SimpleNamespace(trace=np.zeros(1500), sample_interval=10e-9)
    found = deep_pit.detect_deep_floor(fit_of(pit(gain=0.0)), pit(gain=0.0), [short] * 36)
    assert found == deep_pit.UNDECIDED

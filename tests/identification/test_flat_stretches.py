import numpy as np
import pytest

from fault_records import INPUTS, kinds, record
from minorloop.identification.curves import Curves
from minorloop.identification.screening import record_faults


@pytest.mark.parametrize("shape", INPUTS)
def test_a_stuck_output_is_named_with_its_stretch(shape):
    u, y = record(shape)
    first, count = u.size // 3, u.size // 5
    y[first : first + count] = y[first]
    (finding,) = record_faults(u, y, Curves.whole("negative"), 0)
    assert finding.kind == "stuck"
    assert finding.samples == tuple(range(first, first + count))


def test_an_output_stuck_under_noise_is_found():
    u, y = record(noise=0.0)
    y[130:210] = y[130]
    y += 0.005 * np.ptp(y) * np.random.default_rng(0).normal(size=y.size)
    (finding,) = record_faults(u, y, Curves.whole("negative"), 0)
    assert finding.kind == "stuck"
    assert set(finding.samples) > set(range(145, 195))


@pytest.mark.parametrize("shape", INPUTS)
@pytest.mark.parametrize("side", ["highest", "lowest"])
def test_a_clipped_output_is_named(shape, side):
    u, y = record(shape)
    cut = 0.25 * np.ptp(y)
    clipped = np.minimum(y, y.max() - cut) if side == "highest" else np.maximum(y, y.min() + cut)
    found = record_faults(u, clipped, Curves.whole("negative"), 0)
    assert "clipped" in [finding.kind for finding in found]
    assert f"equal the {side}" in found[0].text


def test_an_output_clipped_most_of_the_time_is_found():
    u, y = record("levels")
    assert "clipped" in kinds(u, np.minimum(y, np.median(y)))

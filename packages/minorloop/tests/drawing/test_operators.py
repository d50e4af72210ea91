import numpy as np

from minorloop.operators.preisach import Preisach

MODEL = Preisach([-1.0, 0.0, 1.0], [[1.0, 0.0], [0.5, 2.0]])


def test_the_major_loop_spans_the_range_and_minor_loops_lie_within():
    loops = [line.get_xydata() for line in MODEL.plot().axes[1].lines]
    assert (loops[0][:, 1].min(), loops[0][:, 1].max()) == MODEL.range
    inputs = [np.ptp(loop[:, 0]) for loop in loops]
    np.testing.assert_allclose(inputs, [2.0, 1.5, 1.0, 0.5])
    for loop in loops[1:]:
        np.testing.assert_allclose(loop[:200], loop[-200:])  # falls again along the same branch


def test_targets_out_of_reach_are_marked():
    found = MODEL.invert([0.0, 99.0], unreachable="clip")
    marked = {line.get_label(): line.get_xydata() for line in found.plot().axes[0].lines}
    np.testing.assert_array_equal(marked["out of reach"], [[1.0, 99.0]])

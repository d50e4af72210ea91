import numpy as np

from minorloop.connect import connect
from minorloop.lab.settled_holds import hold_each


def test_the_settled_value_is_the_last_sample_of_each_hold():
    record, settled = hold_each(connect("twin:ipmc"), [0.5, -0.5], 10.0, 2.5)
    np.testing.assert_array_equal(record.u, [0.5] * 4 + [-0.5] * 4)
    np.testing.assert_array_equal(settled, record.y[[3, 7]])

import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop.lab.actuator import Actuator, Channel
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.single_channel import single_channel
from minorloop.twins.ipmc import Ipmc

INPUTS = [Channel(name, "V", 0.0, 1.0) for name in ("left", "right")]
OUTPUTS = [Channel(name, "mm") for name in ("a", "b", "c")]


class Both:
    """Sources and sensors: a is of right, b and c are of left."""

    def __init__(self):
        self.sent = []

    def set(self, values):
        self.sent.append(values.tolist())

    def read(self):
        return np.array([1.0, 2.0, 3.0])

    def safe(self):
        self.sent.append("safe")


def bench():
    both = Both()
    return Bench(both, both, INPUTS, OUTPUTS, rest=[0.1, 0.2], tick=1e-4, measures=(1, 0, 0)), both


def test_an_input_is_applied_with_the_others_at_rest_and_its_own_output_read():
    plant, both = bench()
    right = single_channel(plant, "right")
    assert isinstance(right, Actuator)
    assert (right.inputs[0].name, right.outputs[0].name) == ("right", "a")
    assert right.exchange(0.5) == 1.0
    assert right.apply(0.7, 1e-3, 1e-3).y[-1] == 1.0
    right.safe()
    assert both.sent == [[0.1, 0.5], [0.1, 0.7], "safe"]


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ((), r"has the inputs 'left \[V\]', 'right \[V\]'; choose one with --input"),
        (("left",), "has the outputs .*; choose one with --output"),
        (("middle",), "has no input 'middle'; it has"),
        (("left [V]", "d"), "has no output 'd'"),
    ],
)
def test_a_channel_has_to_be_named_where_there_are_several(names, sentence):
    with pytest.raises(ParameterError, match=sentence):
        single_channel(bench()[0], *names)


def test_one_channel_of_each_stays_as_it_is():
    strip = Ipmc()
    assert single_channel(strip) is strip

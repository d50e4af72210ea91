import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop.twins.ipmc import Ipmc


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"twin": "fibre"}, "has twin 'fibre' and this twin 'ipmc'"),
        ({"specimen": 4}, "has specimen 4"),
        ({"seed": 4}, "has seed 4"),
        ({"state": [0.0]}, "damaged"),
        ({"state": "x"}, "damaged"),
        ({"clock": -1.0}, "damaged"),
        ({"held": None}, "damaged"),
        ({"samples": np.inf}, "damaged: samples is inf"),
        ({"input": 10**400}, "damaged: input is not made of numbers"),
        ({"input": 3.0}, "damaged: voltage is 3"),
        ({"state": [2.4, 0, 0, 0, 0, 0]}, r"damaged: state \[0\] is 2\.4"),
    ],
)
def test_refuses_a_checkpoint_of_another_or_a_damaged_one(change, complaint):
    twin = Ipmc()
    with pytest.raises(ParameterError, match=complaint):
        twin.restore(twin.checkpoint() | change)

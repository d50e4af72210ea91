import numpy as np
import pytest

from minorloop_head.control.flooded_reach import SLEEVED, flooded_reach
from minorloop_head.control.head import head_control
from minorloop_head.twins.head import Head
from papers.catheter import scoring
from papers.catheter.flooded import water
from wires import identified


@pytest.fixture(scope="module")
def control():
    return head_control("observer", (identified().model,) * 2)


@pytest.mark.parametrize("temperature", [10.0, 20.0, 30.0, 40.0])
def test_what_is_predicted_in_water_from_air_is_what_the_twin_reaches(control, temperature):
    found = flooded_reach(control, (20.0, 20.0), temperature)
    truth = scoring.ends(Head(), water(temperature))
    assert found == pytest.approx(truth, abs=4.0)


def test_warmer_water_and_less_convection_reach_farther(control):
    largest = [flooded_reach(control, (20.0, 20.0), t)[0, 1] for t in (5.0, 10.0, 15.0, 20.0)]
    assert (np.diff(largest) > 3.0).all()
    less = flooded_reach(control, (20.0, 20.0), 10.0, cooling=0.8 * SLEEVED)
    assert less[0, 1] > largest[1] + 3.0


def test_a_bare_wire_in_water_does_not_move(control):
    bare = flooded_reach(control, (20.0, 20.0), 20.0, cooling=20 * SLEEVED)
    assert bare == pytest.approx(0.0, abs=0.5)

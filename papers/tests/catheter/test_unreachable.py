import pytest

from minorloop_head.control.reach import Unreachable
from papers.catheter.head_loop import Alarm
from papers.catheter.unreachable import BOTH, gather
from papers.harness import Results

COLD, COOLED = "ambient too cold", "convection too high"


def case(cause, target, said=None, *, at=8.0, reach=40.0, others=0):
    verdict = None if said is None else Unreachable(said, target, reach, at, reach - 5, reach + 5)
    alarm = None if verdict is None else Alarm(at, 0, verdict)
    return Results(cause=cause, short=target - 40.0, reach=40.0, alarm=alarm, others=others)


def test_shares_are_over_the_cases_of_all_specimens():
    runs = [
        {"cases": (case(COLD, 47.0, COLD), case(COLD, 42.0, COOLED, at=20.0)), "seconds": 1.0},
        {"cases": (case(COOLED, 46.0, BOTH, reach=50.0), case(COLD, 46.0)), "seconds": 3.0},
        {"cases": (case(COLD, 39.0, COLD), case(COLD, 38.0, others=2)), "seconds": 4.0},
    ]
    found = gather(runs)["unreachable"]
    assert (found["cases"], found["near_cases"], found["reachable_cases"]) == (3, 1, 2)
    assert found["detected"] == pytest.approx(2 / 3)
    assert found["near_detected"] == 1.0
    assert found["false_alarms"] == 3
    assert (found["cause_right"], found["cause_open"]) == (0.5, pytest.approx(1 / 3))
    assert found["within_band"] == pytest.approx(2 / 3)
    assert found["given_up"] == 3
    assert found["after_max_s"] == 8.0

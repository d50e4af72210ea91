import numpy as np

from console_rig import view
from minorloop_head.console.finder import Finder
from minorloop_head.console.units import to_si
from minorloop_head.vision.reflectance_map import LitFrame


def searches(finder, shown, ticks):
    found = []
    for _ in range(ticks):
        finder.note(to_si(shown))
        found.append(finder.at_rest and not finder.has_searched(to_si(shown)))
    return found


def test_a_view_is_searched_once_the_head_rests_and_again_when_it_has_moved_on():
    finder = Finder(view())
    assert searches(finder, (0.0, 0.0, 0.0, 0.0), 12) == [False] * 11 + [True]
    finder.searched(to_si((0.0, 0.0, 0.0, 0.0)))
    assert not any(searches(finder, (4.0, 0.0, 1.0, 5.0), 30))
    assert searches(finder, (6.0, 0.0, 0.0, 0.0), 12) == [False] * 11 + [True]


def test_a_pick_has_the_frames_that_were_taken_from_the_same_place():
    finder, taken = Finder(view()), [LitFrame(np.zeros((2, 2), np.uint8), 0.0, 0.0)] * 5
    here, away = to_si((0.0, 0.0, 0.0, 0.0)), to_si((0.0, 0.0, 1.0, 0.0))
    now = LitFrame(np.ones((2, 2), np.uint8), 0.0, 0.0)
    assert finder.frames_with(now, here) == (now,)
    finder.searched(here)
    assert finder.frames_with(now, here) == (now,)
    finder.keep(tuple(taken))
    assert finder.frames_with(now, here) == (*taken[:4], now)
    assert finder.frames_with(now, away) == (now,)

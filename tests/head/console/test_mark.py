from dataclasses import replace

import numpy as np
import pytest

from console_rig import PIT, request, tip, towards, view
from minorloop.head.console.mark import PATIENCE, begin_mark, marked, servoed
from minorloop.head.console.perception import Perception
from minorloop.head.console.plant import reading_at
from minorloop.head.procedures.mark import tool_pixel

HERE = towards(PIT)
TICK = 0.04


def now(n=0):
    return reading_at(HERE, t=TICK * n)


def pixel():
    """Where the tool would meet the wall."""
    u, v = tool_pixel(view(), view().tool, now().place, now().angles).tolist()
    return u, v


def commands(seen, ticks=100):
    """The last state and the commands of a touch whose point is seen where a function says."""
    mark, every = begin_mark(view(), pixel(), now()), []
    for n in range(ticks):
        mark, more = marked(mark, view(), seen(n), now(n))
        every += more
        if mark.ended:
            break
    return mark, every


def test_the_tool_extends_once_the_point_has_rested_at_it():
    mark, ((name, (length,)),) = commands(lambda n: pixel())
    assert (name, mark.stage, mark.ended) == ("extend", "touch", "")
    assert length > 8e-3
    assert servoed(view(), pixel(), now()) == pytest.approx(view().lens.centre)
    mark, none = commands(lambda n: np.add(pixel(), (3.0, 0.0)))
    assert (mark.stage, none) == ("aim", [])


def test_pictures_that_do_not_show_the_point_let_the_tool_wait_and_do_not_withdraw_it():
    """Where a wall has little texture, one picture of ten does not: it went to and fro for long."""
    mark, every = commands(lambda n: None if n % 10 == 5 else pixel())
    assert mark.stage == "touch"
    assert [name for name, _ in every[:4]] == ["extend", "hold_tool", "extend", "hold_tool"]
    assert all(numbers != [0.0] for _, numbers in every)
    mark, every = commands(lambda n: None if n > 3 else pixel())
    assert (mark.stage, every) == ("aim", [])


def test_a_touch_that_lasts_too_long_ends_with_a_sentence():
    mark, every = commands(lambda n: None, ticks=2000)
    assert "did not come to rest" in mark.ended
    assert f"{PATIENCE:g} s" in mark.ended
    assert every == []


def test_a_touch_beyond_the_tool_or_beside_the_wall_is_not_begun():
    short = replace(view(), tool=replace(view().tool, longest=5e-3))
    assert begin_mark(short, pixel(), now()) is None
    assert begin_mark(view(), (0.0, 0.0), reading_at((0.5, 0.0, 0.0, 0.0))) is None
    assert begin_mark(view(), (np.nan, 0.0), now()) is None


def test_a_tool_that_waits_is_where_it_was_and_touches_later():
    camera = Perception(tip()[0], view())
    tool = camera._tip.tool

    def events(ticks, *first):
        many = (first if n == 0 else () for n in range(ticks))
        reports = [camera.tick(request(HERE, *each)) for each in many]
        return [event["what"] for report in reports for event in report.events]

    assert events(15, ("extend", [0.025])) == []
    events(1, ("hold_tool", []))
    there = tool.extension
    assert 4e-3 < there < 8e-3
    assert "no contact" not in events(15)
    assert tool.extension == pytest.approx(there, abs=1e-9)
    assert "touched" in events(60, ("extend", [0.025]))
    events(60, ("extend", [0.0]))
    assert tool.extension == 0.0
    assert "not extended" in events(1, ("extend", [1.0]))

"""A few cases of each kind; `make fuzz` goes through 100,000."""

import pytest

from fuzz.__main__ import SHARES
from fuzz.counts import knock, table
from fuzz.doors import WrongAcceptance, cells_of, doors

CASES = {"model files": 500, "records": 500, "plans": 200, "manifests": 200, "floods": 60}


@pytest.mark.parametrize("number", range(len(SHARES)))
def test_what_is_damaged_is_refused_or_right(number, tmp_path):
    door = doors(tmp_path)[number]
    counts = knock(door, range(CASES.get(door.name, 300)))
    assert counts.sound, "\n".join([*counts.told, table([counts])])
    assert 0 < counts.accepted < counts.cases


def test_cases_follow_from_their_numbers(tmp_path):
    from random import Random

    for door in doors(tmp_path):
        assert door.name in SHARES
        assert door.make(Random("7")) == door.make(Random("7"))


def test_a_door_that_lets_in_too_much_is_noticed(tmp_path):
    from fuzz.doors import Door

    def let_in(case):
        raise WrongAcceptance("it says another thing")

    def crash(case):
        raise KeyError("x")

    found = [knock(Door("d", lambda random: b"x", enter), range(3)) for enter in (let_in, crash)]
    assert (found[0].wrong, found[1].crashes) == (3, 3)
    assert not any(one.sound for one in found)


def test_the_own_reader_of_tables_reads_tables():
    assert cells_of(b'\xef\xbb\xbfa,"b ""c"""\r\n\r\n1,"2\n3"\r') == [["a", 'b "c"'], ["1", "2\n3"]]
    assert cells_of(b'a,b\n "1 , 2", 3\n', indented=True) == [["a", "b"], ["1 , 2", "3"]]

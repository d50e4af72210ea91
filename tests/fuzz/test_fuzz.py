"""A few cases of each kind; `make fuzz` runs 100,000."""

import pytest

from fuzz.__main__ import SHARES
from fuzz.counts import run_cases, table
from fuzz.readers import WrongAcceptance, cells_of, readers

CASES = {"model files": 250, "records": 250, "floods": 40}


@pytest.mark.parametrize("number", range(len(SHARES)))
def test_what_is_damaged_is_refused_or_right(number, tmp_path):
    reader = readers(tmp_path)[number]
    counts = run_cases(reader, range(CASES.get(reader.name, 150)))
    assert counts.sound, "\n".join([*counts.notes, table([counts])])
    assert 0 < counts.accepted < counts.cases


def test_cases_follow_from_their_numbers(tmp_path):
    from random import Random

    for reader in readers(tmp_path):
        assert reader.name in SHARES
        assert reader.make(Random("7")) == reader.make(Random("7"))


def test_a_reader_that_accepts_too_much_is_noticed(tmp_path):
    from fuzz.readers import Reader

    def accept(case):
        raise WrongAcceptance("it says another thing")

    def crash(case):
        raise KeyError("x")

    kinds = [Reader("d", lambda random: b"x", accepts) for accepts in (accept, crash)]
    found = [run_cases(kind, range(3)) for kind in kinds]
    assert (found[0].wrong, found[1].crashes) == (3, 3)
    assert not any(one.sound for one in found)


def test_the_own_reader_of_tables_reads_tables():
    assert cells_of(b'\xef\xbb\xbfa,"b ""c"""\r\n\r\n1,"2\n3"\r') == [["a", 'b "c"'], ["1", "2\n3"]]
    assert cells_of(b'a,b\n "1 , 2", 3\n', indented=True) == [["a", "b"], ["1 , 2", "3"]]

"""A few cases of each kind; `make torture` goes through all lines and 500 instants."""

import pytest

from faults.instruments import KINDS, SIGNALS, Fault, build_firmware, use_firmware
from faults.runs import FAILURES, Case, at_random, carry_out

pytest.importorskip("pyvisa_py", reason="needs pyvisa and pyvisa-py: minorloop[instruments]")

# What is asked, set, switched on, read and made safe stands at these lines of a run.
LINES = {"tcp": (4, 5, 9, 23), "serial": (9, 10, 13, 31), "firmware": (3, 6, 20)}
FAULTS = ("double", "reset", "half", "silence", "SIGTERM")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run of each kind that nothing comes in the way of."""
    use_firmware(build_firmware(tmp_path_factory.mktemp("firmware")))
    return {kind: carry_out(Case(kind)) for kind in KINDS}


def _sound(found):
    assert not any(getattr(found, name) for name in FAILURES), found.said


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_that_is_not_disturbed_leaves_its_source_off(kind, whole):
    _sound(whole[kind])
    assert [point[1] for point in whole[kind].points] == [0.5, -0.25]
    assert whole[kind].lines > max(LINES[kind])


@pytest.mark.parametrize("kind", KINDS)
def test_whatever_comes_at_a_line_leaves_the_source_off_and_the_store_whole(kind, whole):
    for number, at in enumerate(LINES[kind]):
        _sound(carry_out(Case(kind, Fault(FAULTS[number % len(FAULTS)], at)), whole[kind]))


@pytest.mark.parametrize("kind", KINDS)
def test_signals_at_any_instant_leave_the_source_off(kind, whole):
    for case in at_random(kind, 2, whole[kind].seconds):
        _sound(carry_out(case, whole[kind]))


@pytest.mark.parametrize("kind", KINDS)
def test_an_instrument_that_falls_silent_is_said_to_be_on_perhaps(kind, whole):
    found = carry_out(Case(kind, Fault("mute", 12)), whole[kind])
    _sound(found)
    assert found.status == 3
    assert "the source may still be on, switch it off by hand" in found.log[-1]


def test_what_leaves_a_source_on_is_noticed(whole, monkeypatch):
    monkeypatch.setattr(KINDS["tcp"], "energised", True)
    assert carry_out(Case("tcp", Fault(SIGNALS[0], 9)), whole["tcp"]).left_on == 2

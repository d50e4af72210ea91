"""A few cases of each kind; `make torture` goes through all lines and 500 instants."""

import pytest

from faults.instruments import KINDS, Fault, build_firmware, use_firmware
from faults.runs import FAILURES, Case, at_random, carry_out

pytest.importorskip("pyvisa_py", reason="needs pyvisa and pyvisa-py: minorloop[instruments]")

# At these lines of a run the source is switched on, the output is read, or the source made safe;
# how many readings come before the end depends on the load.
CASES = [
    ("tcp", "SIGTERM", 9),
    ("tcp", "reset", 5),
    ("tcp", "double", -2),
    ("two ports", "SIGINT", 10),
    ("two ports", "half", 6),
    ("serial", "SIGHUP", 16),
    ("serial", "silence", 32),
    ("firmware", "reset", 20),
    ("firmware", "double", 9),
]


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
    assert whole[kind].lines > max(at for name, _, at in CASES if name == kind)


@pytest.mark.parametrize(("kind", "fault", "at"), CASES)
def test_whatever_comes_at_a_line_leaves_the_source_off_and_the_store_whole(kind, fault, at, whole):
    at %= whole[kind].lines
    _sound(carry_out(Case(kind, Fault(fault, at)), whole[kind]))


@pytest.mark.parametrize("kind", ["tcp", "serial"])
def test_signals_at_any_instant_leave_the_source_off(kind, whole):
    for case in at_random(kind, 1, 0.3):
        _sound(carry_out(case, whole[kind]))


@pytest.mark.parametrize("kind", ["tcp", "serial"])
def test_an_instrument_that_falls_silent_is_said_to_be_on_perhaps(kind, whole):
    found = carry_out(Case(kind, Fault("mute", 14)), whole[kind])
    _sound(found)
    assert found.status == 3
    assert "the source may still be on, switch it off by hand" in found.log[-1]


def test_what_leaves_a_source_on_is_noticed(whole, monkeypatch):
    monkeypatch.setattr(KINDS["tcp"], "energised", True)
    assert carry_out(Case("tcp", Fault("SIGINT", 9)), whole["tcp"]).left_on == 2

import os
import signal
import threading

import pytest

from minorloop.lab.signals import Allowed, Deferred, Stopped, ended_by_signals

NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")


def send(name):
    os.kill(os.getpid(), getattr(signal, name))


@pytest.mark.parametrize("name", NAMES)
def test_a_signal_ends_what_it_may_and_leaves_the_handlers_as_they_were(name):
    before = signal.getsignal(getattr(signal, name))
    done = []

    def act():
        with ended_by_signals():
            send(name)
            done.append("more")

    with pytest.raises(Stopped, match=name):
        act()
    assert done == []
    assert signal.getsignal(getattr(signal, name)) is before


def test_a_deferred_signal_waits_for_the_end():
    done = []

    def act():
        with ended_by_signals():
            with Deferred():
                send("SIGTERM")
                done.append("the exchange")
            done.append("more")

    with pytest.raises(Stopped, match="SIGTERM"):
        act()
    assert done == ["the exchange"]


def test_what_is_deferred_at_the_end_is_raised_there():
    with pytest.raises(Stopped), ended_by_signals(), Deferred():
        send("SIGHUP")


def test_within_what_is_deferred_a_signal_may_be_allowed():
    with ended_by_signals(), Deferred():
        with pytest.raises(Stopped), Allowed():
            send("SIGTERM")
        send("SIGTERM")  # only the first is raised
        with Allowed():
            send("SIGINT")


def test_where_the_process_exits_a_second_signal_does_not_end_it():
    before = {name: signal.getsignal(getattr(signal, name)) for name in NAMES}
    try:
        with pytest.raises(Stopped), ended_by_signals(exiting=True):
            send("SIGTERM")
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
        send("SIGTERM")  # the default handler would end the process
    finally:
        for name, handler in before.items():
            signal.signal(getattr(signal, name), handler)
    with ended_by_signals(exiting=True):
        pass
    assert signal.getsignal(signal.SIGTERM) is before["SIGTERM"]


def test_an_error_says_more_than_a_signal():
    def act():
        with ended_by_signals(), Deferred():
            send("SIGTERM")
            raise ValueError("the error")

    with pytest.raises(ValueError, match="the error"):
        act()


def test_a_signal_that_is_ignored_stays_so():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals():
            send("SIGHUP")
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_thread_changes_nothing_for_the_main_thread():
    def work():
        with ended_by_signals(), Deferred():
            there.set()
            over.wait(20)

    there, over = threading.Event(), threading.Event()
    thread = threading.Thread(target=work)
    thread.start()
    try:
        assert there.wait(20)
        with pytest.raises(Stopped), ended_by_signals():
            send("SIGTERM")
    finally:
        over.set()
        thread.join(20)
    assert not thread.is_alive()

from multiprocessing import Pipe

from minorloop_head.console.channel import NewestPipe, Outbox


def test_the_newest_pipe_is_used_and_without_one_nothing_is_sent():
    channel = NewestPipe()
    assert not channel.send(b"lost")
    assert channel.next(None, 0.0) is None
    (ours, first), (other, second) = Pipe(), Pipe()
    channel.renew(first)
    channel.renew(second)
    assert channel.next(first, 0.0) is second
    assert channel.next(second, 0.0) is None
    assert channel.send(b"sent")
    assert other.recv_bytes() == b"sent"
    assert not ours.poll()
    second.close()
    assert not channel.send(b"lost")


def test_all_events_and_the_newest_state_are_sent():
    outbox = Outbox()
    for k in range(3):
        outbox.event(b"event %d" % k)
        outbox.newest(b"state %d" % k)
    assert outbox.wait() == ([b"event 0", b"event 1", b"event 2"], b"state 2")
    outbox.newest(b"state 3")
    assert outbox.wait() == ([], b"state 3")

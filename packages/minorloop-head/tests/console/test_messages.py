import json

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import SignalError
from minorloop_head.console import messages
from minorloop_head.console.reports import camera_finding

DRIVE = {
    "type": "drive",
    "seq": 1,
    "t": 2.0,
    "grant": 1,
    "pose": [0, 0, 0, 1],
    "age": 0,
    "stick": [0, 0],
    "clutch": False,
}
anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner),
    max_leaves=8,
)


def refused(text):
    with pytest.raises(SignalError) as caught:
        messages.decode(text)
    assert len(str(caught.value)) < 400


def test_a_message_of_a_page_is_decoded():
    message = messages.decode(json.dumps(DRIVE))
    assert isinstance(message, messages.Drive)
    assert message.pose == (0.0, 0.0, 0.0, 1.0)
    lost = messages.decode(json.dumps({**DRIVE, "pose": None}))
    assert lost.pose is None
    for nothing in ([0, 0, 0, 0], [0, 1e-200, 0, 1e-200]):
        with pytest.raises(SignalError, match="length 1"):
            messages.decode(json.dumps({**DRIVE, "pose": nothing}))


@given(st.sampled_from(sorted(DRIVE)), anything)
def test_a_field_of_another_kind_is_refused_or_means_what_it_should(name, value):
    try:
        message = messages.decode(json.dumps({**DRIVE, name: value}))
    except SignalError:
        return
    told = msgspec.to_builtins(message)
    numbers = [*(told["pose"] or ()), *told["stick"], told["age"], told["t"]]
    assert np.isfinite(numbers).all()
    assert max(map(abs, told["stick"])) <= 1


@given(st.binary(max_size=300))
def test_junk_is_refused(junk):
    refused(junk)


@pytest.mark.parametrize(
    "text", ["", "null", "[]", '{"type":"ping","seq":1,"t":1}' + " " * messages.LONGEST]
)
def test_an_invalid_message_is_refused(text):
    refused(text)


def test_findings_are_decoded_as_they_were_encoded_and_infinite_evidence_is_null():
    hole = {"phi": 0.05, "z": 0.03, "diameter": 1e-3, "evidence": np.inf}
    finding = camera_finding(1, 2.0, hole, 10e-3)
    text = messages.encode(messages.FindingList(findings=[finding]))
    assert json.loads(text)["findings"][0]["evidence"] is None
    assert messages.decode_findings(text) == [msgspec.structs.replace(finding, evidence=None)]


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (messages.RecordingStatus(name=None), b'{"type":"recording","name":null}'),
        (messages.Failed(text="no"), b'{"type":"failed","text":"no"}'),
        (messages.Failed(text="no", again=True), b'{"type":"failed","text":"no","again":true}'),
        (messages.Pong(seq=1, t=2.5), b'{"type":"pong","seq":1,"t":2.5}'),
        (messages.ScanEnded(finding=3), b'{"type":"scanned","finding":3}'),
        (messages.ReplayEnded(), b'{"type":"ended"}'),
        (
            messages.Controls(you=2, pilot=None, viewers=3, grant=0),
            b'{"type":"controls","you":2,"pilot":null,"viewers":3,"grant":0}',
        ),
        (
            messages.DepthProgress(finding=1, stage="x", seconds=0.5),
            b'{"type":"depth","finding":1,"stage":"x","seconds":0.5}',
        ),
    ],
)
def test_messages_to_the_pages_have_their_fields_on_the_wire(message, text):
    assert messages.encode(message) == text


def test_orders_to_the_loop_are_unchanged():
    order = messages.decode(json.dumps(DRIVE))
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(order), type=messages.Order) == order

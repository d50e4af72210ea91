"""What is said between the pages, the server and the loop.

A page sends JSON texts, each with a number that rises and the time on its own clock in seconds.
It gets JSON texts (`type` says which) and pictures: a header as ``HEADER`` packs it, then a JPEG.
"""

from __future__ import annotations

import struct
from typing import Annotated, Any, Literal, TypeAlias

import msgspec

from minorloop.errors import SignalError

LONGEST = 2048
"""Bytes of a message from a page."""
HEADER = struct.Struct("<B3xIdffff")
"""Kind, number, time in s, pan, tilt, advance and roll in degrees and mm."""
IMAGE, MAP, JOB = 1, 2, 3
"""Kinds of pictures; a job is one byte of kind and then what the workers are to do, pickled."""

_Number: TypeAlias = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
_Time: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0, le=1e12)]
_Unit: TypeAlias = Annotated[float, msgspec.Meta(ge=-1.001, le=1.001)]
_Share: TypeAlias = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
_Pixel: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0, le=10_000.0)]
_LEAST_POSE = 0.5
"""Square of the length below which four numbers turn nothing."""
_Distance: TypeAlias = Annotated[float, msgspec.Meta(ge=4e-3, le=60e-3)]


class _Sent(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="type",
    tag=str.lower,
):
    """What every message from a page carries."""

    seq: _Number
    t: _Time


class _Order(_Sent, frozen=True, kw_only=True):
    """What only who holds the controls may send; ``grant`` is the number got with them."""

    grant: _Number


class Drive(_Order, frozen=True, kw_only=True):
    """The operator's head, stick and clutch now; ``age`` of the pose in seconds."""

    pose: tuple[_Unit, _Unit, _Unit, _Unit] | None
    age: Annotated[float, msgspec.Meta(ge=0.0, le=1e9)]
    stick: tuple[_Share, _Share]
    clutch: bool

    def __post_init__(self) -> None:
        if self.pose is not None and sum(part * part for part in self.pose) < _LEAST_POSE:
            raise ValueError("a pose is a quaternion of length 1")


class Mode(_Order, frozen=True, kw_only=True):
    """Ask for a mode."""

    mode: Literal["HEAD", "TRACK", "HOLD"]


class Pick(_Order, frozen=True, kw_only=True):
    """Take the point at a pixel as the target."""

    u: _Pixel
    v: _Pixel


class Measure(_Order, frozen=True, kw_only=True):
    """Measure what is tracked."""


class Focus(_Order, frozen=True, kw_only=True):
    """Send the focus to a distance in metres."""

    distance: _Distance


class Find(_Order, frozen=True, kw_only=True):
    """Look for defects in what is in view, with the lights one after the other."""


class Sharpen(_Order, frozen=True, kw_only=True):
    """Focus on what is tracked."""


class Scan(_Order, frozen=True, kw_only=True):
    """Measure the depth of a finding with the probe; of the newest one without a number."""

    finding: _Number | None = None


class RecordSession(_Order, frozen=True, kw_only=True, tag="record"):
    """Begin or end a recording."""

    on: bool


class Forget(_Order, frozen=True, kw_only=True):
    """Drop a finding."""

    finding: _Number


class Release(_Order, frozen=True, kw_only=True):
    """Give the controls back."""


class Take(_Sent, frozen=True, kw_only=True):
    """Ask for the controls."""


class Ping(_Sent, frozen=True, kw_only=True):
    """Ask for an answer, to see how long it takes."""


class Taken(msgspec.Struct, frozen=True, tag_field="type", tag="taken"):
    """Somebody has taken the controls; the server says it."""


class Sounded(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="sounded"):
    """What the echoes told of a finding, from the process that fitted them; no page sends it."""

    finding: int
    told: dict[str, Any]


class Known(msgspec.Struct, frozen=True, tag_field="type", tag="known"):
    """The findings so far, for a control loop that was started anew; the server says it."""

    findings: list[dict[str, Any]]


Order: TypeAlias = (
    Drive | Mode | Pick | Measure | Focus | Find | Sharpen | Scan | RecordSession | Forget | Release
)
Inner: TypeAlias = Order | Sounded | Taken | Known
"""What the server says to the control loop."""
Message: TypeAlias = Order | Take | Ping

_messages: msgspec.json.Decoder[Message] = msgspec.json.Decoder(Message)


def decode(text: str | bytes) -> Message:
    """A message from a page.

    Raises
    ------
    SignalError
        If it is none, in a sentence that says what is wrong with it.
    """
    if len(text) > LONGEST:
        raise SignalError(f"the message has {len(text)} characters; at most {LONGEST} are allowed")
    try:
        return _messages.decode(text)
    except (ValueError, RecursionError) as error:  # what msgspec raises are ValueErrors
        raise SignalError(f"the message cannot be read: {error}") from None


def encode(kind: str, **content: Any) -> bytes:
    """A text for the pages."""
    return msgspec.json.encode({"type": kind, **content})


def picture(kind: int, number: int, t: float, where: tuple[float, ...], jpeg: bytes) -> bytes:
    """A picture for the pages."""
    return HEADER.pack(kind, number & 0xFFFFFFFF, t, *where) + jpeg

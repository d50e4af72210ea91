"""Messages between the pages, the server and the control loop.

A page sends JSON texts, each with a rising number and the time in seconds on the clock of the page.
It gets JSON texts and pictures. A picture is a header, packed by ``HEADER``, and a JPEG. The types
of the pages (``web/src/messages.ts``) are generated from this module by
`minorloop_head.console.typescript`.
"""

from __future__ import annotations

import struct
from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import UNSET, UnsetType

from minorloop.errors import SignalError

LONGEST = 2048
"""Largest size of a message from a page in bytes; the longest valid one has about 300."""
HEADER = struct.Struct("<B3xIdffff")
"""Kind, number, time in s, pan and tilt in degrees, advance in mm and roll in degrees."""
IMAGE, MAP, JOB = 1, 2, 3
"""First byte of a binary message: a picture of the camera, one of the map, or a pickled job."""

Mode: TypeAlias = Literal["HEAD", "TRACK", "SCAN", "HOLD"]
Pair: TypeAlias = tuple[float, float]
Spot: TypeAlias = tuple[float, float, float, float]
"""Pixel, diameter in pixels and evidence of a candidate."""

_Number: TypeAlias = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
_Time: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0, le=1e12)]
_Unit: TypeAlias = Annotated[float, msgspec.Meta(ge=-1.001, le=1.001)]
_Deflection: TypeAlias = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
_Pixel: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0, le=10_000.0)]
_LEAST_POSE = 0.5
"""Smallest squared length of a quaternion that is accepted as a pose."""
_Distance: TypeAlias = Annotated[float, msgspec.Meta(ge=4e-3, le=60e-3)]


# --- from a page


class _FromPage(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="type",
    tag=str.lower,
):
    """Fields of every message from a page."""

    seq: _Number
    t: _Time


class _Order(_FromPage, frozen=True, kw_only=True):
    """A message that only the pilot may send; ``grant`` counts how often controls were taken."""

    grant: _Number


class Drive(_Order, frozen=True, kw_only=True):
    """Pose of the operator's head, its age in seconds, stick and clutch."""

    pose: tuple[_Unit, _Unit, _Unit, _Unit] | None
    age: Annotated[float, msgspec.Meta(ge=0.0, le=1e9)]
    stick: tuple[_Deflection, _Deflection]
    clutch: bool

    def __post_init__(self) -> None:
        if self.pose is not None and sum(part * part for part in self.pose) < _LEAST_POSE:
            raise ValueError("a pose is a quaternion of length 1")


class SetMode(_Order, frozen=True, kw_only=True, tag="mode"):
    """Enter a mode."""

    mode: Literal["HEAD", "TRACK", "HOLD"]


class Pick(_Order, frozen=True, kw_only=True):
    """Take the point at a pixel as the target."""

    u: _Pixel
    v: _Pixel


class Measure(_Order, frozen=True, kw_only=True):
    """Measure the tracked target by its outline."""


class Focus(_Order, frozen=True, kw_only=True):
    """Set the focus to a distance in metres."""

    distance: _Distance


class Find(_Order, frozen=True, kw_only=True):
    """Search the view for defects under switched lights."""


class Sharpen(_Order, frozen=True, kw_only=True):
    """Focus on the tracked target."""


class Mark(_Order, frozen=True, kw_only=True):
    """Touch the tracked target with the micro-tool."""


class Scan(_Order, frozen=True, kw_only=True):
    """Measure the depth of a finding with the probe; of the newest finding without a number."""

    finding: _Number | None = None


class Sweep(_Order, frozen=True, kw_only=True):
    """Map the flooded wall about the place in the middle of the picture with the probe."""


class RecordSession(_Order, frozen=True, kw_only=True, tag="record"):
    """Start or end a recording."""

    on: bool


class Forget(_Order, frozen=True, kw_only=True):
    """Delete a finding."""

    finding: _Number


class Release(_Order, frozen=True, kw_only=True):
    """Give the controls back."""


class Take(_FromPage, frozen=True, kw_only=True):
    """Ask for the controls."""


class Ping(_FromPage, frozen=True, kw_only=True):
    """Ask for a `Pong`, to measure the delay."""


# --- to the pages


class DepthPatch(msgspec.Struct, frozen=True, kw_only=True):
    """Depths in mm about a finding, rows along the pipe and columns around it.

    The first one is at phi in degrees and z in mm; ``step`` is their distance in mm. A depth is
    null where it is not known and where there is no floor; ``through`` lists the latter.
    """

    phi: float
    z: float
    step: float
    depth: list[list[float | None]]
    through: list[tuple[int, int]] | UnsetType = UNSET


class ReportedFinding(msgspec.Struct, frozen=True, kw_only=True):
    """A measured defect; in mm and degrees, None where not known.

    ``number``: from 1.
    ``t``: time of the measurement, in seconds since the session began.
    ``kind``: ``pit``, ``hole`` or ``mark``; ``hole or pit`` where echoes have not decided; of a
    sweep also ``crack``, ``cut by the edge`` or ``no echo`` with its reason.
    ``verdict``: of the echoes; ``no echoes yet`` before there are any.
    ``phi``, ``z``: place on the wall.
    ``phi_sd``, ``z_sd``, ``diameter_sd``, ``depth_sd``: standard deviations.
    ``evidence``: logarithm of the odds, by the camera, that it is a hole or a pit; None if
    infinite, and of a sweep.
    """

    number: int
    t: float
    kind: str
    verdict: str
    phi: float
    phi_sd: float
    z: float
    z_sd: float
    diameter: float
    diameter_sd: float
    depth: float | None
    depth_sd: float | None
    evidence: float | None
    patch: DepthPatch | None = None


class _ToPage(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag=str.lower):
    """A message to the pages."""


class CameraView(msgspec.Struct, frozen=True, kw_only=True):
    """Camera for the pages: numbers of pixels, and lever and radius in metres."""

    width: int
    height: int
    focal: float
    centre: Pair
    lever: float
    radius: float


class PlaneWeights(msgspec.Struct, frozen=True, kw_only=True):
    """Preisach plane of a wire."""

    levels: list[float]
    weights: list[list[float]]


class Hello(_ToPage, frozen=True, kw_only=True):
    """First message of a control loop: camera, cone in degrees, planes of the wires.

    ``no_probe`` says why there is no depth; empty with a probe.
    """

    interval: float
    view: CameraView
    known: dict[str, Any]
    cone: float
    stick: Pair
    planes: list[PlaneWeights]
    no_probe: str = ""


class DriveReceipt(msgspec.Struct, frozen=True, kw_only=True):
    """Number and time of the `Drive` that a tick used."""

    seq: int
    t: float


class ScanProgress(msgspec.Struct, frozen=True, kw_only=True):
    """Stage of a scan of a finding, 0 of a sweep, and the share of it that was measured."""

    finding: int
    stage: str
    progress: float


class LoopState(_ToPage, frozen=True, kw_only=True, tag="state"):
    """State of the control loop after a tick; angles in degrees, lengths in mm, time in s.

    ``safe_at`` is when the plant was last made safe, on the clock of the loop, 0 if never;
    ``target`` is pixel, score and 1 if it is visible; ``late`` is in ms.
    """

    seq: int
    t: float
    mode: Mode
    reason: str
    command: Pair
    angle: tuple[float | None, float | None]
    place: Pair
    rates: Pair
    current: Pair
    temperature: Pair
    memory: tuple[list[float], list[float]]
    wire: Pair
    trouble: str
    clutch: bool
    received: DriveReceipt | None
    late: float
    safe_at: float
    target: tuple[float, float, float, float] | None
    centred: bool
    focus: str
    scan: ScanProgress | None
    spots: list[Spot]


class Controls(_ToPage, frozen=True, kw_only=True, tag="controls"):
    """Holder of the controls; ``grant`` is 0 for everybody except the pilot."""

    you: int
    pilot: int | None
    viewers: int
    grant: int


class FindingList(_ToPage, frozen=True, kw_only=True, tag="findings"):
    """All findings."""

    findings: list[ReportedFinding]


class RecordingStatus(_ToPage, frozen=True, kw_only=True, tag="recording"):
    """Recording that is being written, its length in seconds and its size in bytes."""

    name: str | None
    seconds: float | UnsetType = UNSET
    size: int | UnsetType = UNSET


class Notice(_ToPage, frozen=True, kw_only=True):
    """A sentence for the operator."""

    text: str


class Failed(_ToPage, frozen=True, kw_only=True):
    """The loop does not run; ``again`` if it is restarting."""

    text: str
    again: bool | UnsetType = UNSET


class Pong(_ToPage, frozen=True, kw_only=True):
    """Answer to a `Ping`, with its number and time."""

    seq: int
    t: float


class SearchResult(_ToPage, frozen=True, kw_only=True, tag="found"):
    """Number of candidates that a search found, and whether its frames were usable."""

    what: str = "found"
    count: int
    verdict: str


class FocusResult(_ToPage, frozen=True, kw_only=True, tag="focused"):
    """Distance in metres at which the target is sharpest."""

    what: str = "focused"
    distance: float
    verdict: str


class ScanEnded(_ToPage, frozen=True, kw_only=True, tag="scanned"):
    """The scan of a finding has ended."""

    finding: int


class SweepMapped(_ToPage, frozen=True, kw_only=True, tag="swept"):
    """The map of a sweep is available, with a number that rises from sweep to sweep.

    ``mapped`` is the mapped share of its area, ``whole`` whether the sweep was complete.
    """

    number: int
    finds: int
    mapped: float
    whole: bool


class DepthProgress(_ToPage, frozen=True, kw_only=True, tag="depth"):
    """Stage of the fit of a finding, and seconds since it began; empty when it has ended."""

    finding: int
    stage: str
    seconds: float


class ReplayEnded(_ToPage, frozen=True, kw_only=True, tag="ended"):
    """The recording has been replayed."""


# --- from the server to the control loop only


class ControlsTaken(msgspec.Struct, frozen=True, tag_field="type", tag="taken"):
    """A page has taken the controls."""


class DepthFitted(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="sounded"):
    """Result of the fit of a finding's echoes, as `minorloop_head.console.depth_work` gives it."""

    finding: int
    result: dict[str, Any]


class SweepFitted(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="mapped"):
    """Finds of a sweep, as `minorloop_head.console.depth_work` gives them."""

    finds: list[dict[str, Any]]


class KnownFindings(msgspec.Struct, frozen=True, tag_field="type", tag="known"):
    """The findings so far, for a control loop that was restarted."""

    findings: list[ReportedFinding]


Order: TypeAlias = (
    Drive
    | SetMode
    | Pick
    | Measure
    | Focus
    | Find
    | Sharpen
    | Mark
    | Scan
    | Sweep
    | RecordSession
    | Forget
    | Release
)
Message: TypeAlias = Order | Take | Ping
"""Messages of a page."""
ToLoop: TypeAlias = Order | DepthFitted | SweepFitted | ControlsTaken | KnownFindings
"""Messages of the server to the control loop."""
ToPage: TypeAlias = (
    Hello
    | LoopState
    | Controls
    | FindingList
    | RecordingStatus
    | Notice
    | Failed
    | Pong
    | SearchResult
    | FocusResult
    | ScanEnded
    | SweepMapped
    | DepthProgress
    | ReplayEnded
)
"""Messages to a page."""

# msgspec inspects a class when a decoder for it is first made, and crashes where two threads do so
# at once. All decoders of the console are therefore made while modules are imported.
_from_page: msgspec.json.Decoder[Message] = msgspec.json.Decoder(Message)
loop_decoder: msgspec.msgpack.Decoder[ToLoop] = msgspec.msgpack.Decoder(ToLoop)
_findings: msgspec.json.Decoder[FindingList] = msgspec.json.Decoder(FindingList)
_encoder = msgspec.json.Encoder()


def decode(text: str | bytes) -> Message:
    """Return the message in a text from a page.

    Raises a `SignalError` that says what is wrong if it is not a valid message.
    """
    if len(text) > LONGEST:
        raise SignalError(f"the message has {len(text)} characters; at most {LONGEST} are allowed")
    try:
        return _from_page.decode(text)
    except (ValueError, RecursionError) as error:  # errors of msgspec are ValueErrors
        raise SignalError(f"the message cannot be read: {error}") from None


def encode(message: ToPage) -> bytes:
    """Return the text of a message to the pages."""
    return _encoder.encode(message)


def decode_findings(text: bytes) -> list[ReportedFinding]:
    """Return the findings in the text of a `FindingList`."""
    return _findings.decode(text).findings


def picture(kind: int, number: int, t: float, where: tuple[float, ...], jpeg: bytes) -> bytes:
    """Return a picture for the pages; ``where`` is in degrees and mm, see ``HEADER``."""
    return HEADER.pack(kind, number & 0xFFFFFFFF, t, *where) + jpeg

"""Pose of the operator's head from a tracker that speaks the UDP protocol of OpenTrack.

A packet is six little-endian doubles: x, y and z in cm, then yaw, pitch and roll in degrees. Yaw to
the right and pitch upward are positive; a tracker that counts otherwise has a setting to invert an
axis. Only the angles are used. The packets have no name of the sender and no checksum: any program
that reaches the port can turn the head within its cone while it follows the tracker.
"""

from __future__ import annotations

import contextlib
import math
import socket
import struct

from minorloop.errors import ParameterError
from minorloop_head.console.head_pose import Quaternion, jumped, pose_of

_PACKET = struct.Struct("<6d")
"""x, y, z in cm; yaw, pitch, roll in degrees."""
_FARTHEST, _WIDEST = 1e4, 360.0
"""Largest position in cm and angle in degrees that is accepted."""
_MOST = 1000
"""Most packets read in a tick; a flood must not delay it."""


class UdpTracker:
    """A tracker that sends packets to a socket.

    ``receiving``: bound, as `listening_for` makes it.
    """

    def __init__(self, receiving: socket.socket) -> None:
        self._socket = receiving
        self._socket.setblocking(False)
        self._pose: Quaternion | None = None
        self._at = -math.inf
        self.spacing = math.nan
        """Seconds between the newest packets."""

    def read(self, now: float) -> tuple[Quaternion | None, float, str]:
        """Read the packets since the last call, without waiting.

        ``now``: time in seconds.

        Returns
        -------
        pose : quaternion or None
            Newest pose; None if a packet since the last call was damaged or jumped.
        age : float
            Seconds since it was read; infinite if there was none.
        problem : str
            Reason why there is no pose, or why it may become too old.
        """
        packets: list[bytes] = []
        problem = ""
        with contextlib.suppress(OSError):  # there is no other
            while len(packets) < _MOST:
                packets.append(self._socket.recv(_PACKET.size + 1))
        # Their times are unknown: assume that they are evenly spaced since the last one.
        passed = (now - self._at) / max(len(packets), 1)
        for packet in packets:
            problem = self._take(packet, now, passed) or problem
        if self._at == now and math.isfinite(passed):
            self.spacing = passed
        if problem:
            return None, math.inf, problem
        return self._pose, now - self._at, "the tracker sends nothing"

    def _take(self, packet: bytes, now: float, passed: float) -> str:
        """Read a packet; return its fault, empty without one."""
        pose, before = decoded(packet), self._pose
        if pose is None:
            return "the tracker sent a damaged packet"
        self._pose, self._at = pose, now
        if before is not None and jumped(before, pose, passed):
            return "the pose of the tracker jumped"
        return ""


def decoded(packet: bytes) -> Quaternion | None:
    """Return the pose in a packet; None if the packet is damaged."""
    if len(packet) != _PACKET.size:
        return None
    numbers = _PACKET.unpack(packet)
    place, angles = numbers[:3], numbers[3:]
    # Written so that NaN is refused.
    if not (all(abs(x) <= _FARTHEST for x in place) and all(abs(x) <= _WIDEST for x in angles)):
        return None
    return pose_of(*(math.radians(angle) for angle in angles))


def listening_for(address: str) -> socket.socket:
    """Return a socket that receives the packets of a tracker.

    Raises a `ParameterError` if the address is not of a tracker, or its port cannot be used.

    ``address``: ``udp:PORT`` receives from this machine only, ``udp:HOST:PORT`` at the address HOST
    of this machine, ``udp:0.0.0.0:PORT`` at all its addresses.
    """
    kind, _, place = address.partition(":")
    host, _, port = place.rpartition(":")
    if kind != "udp" or not (port.isascii() and port.isdigit() and 0 <= int(port) <= 65535):
        raise ParameterError(f"there is no tracker at {address!r}; give udp:PORT or udp:HOST:PORT")
    host = host.strip("[]") or "127.0.0.1"
    receiving = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
    try:
        receiving.bind((host, int(port)))
    except OSError as error:
        receiving.close()
        raise ParameterError(
            f"cannot listen for a tracker on {host} port {port}: {error.strerror or error}; give "
            "another port to --tracker"
        ) from None
    return receiving

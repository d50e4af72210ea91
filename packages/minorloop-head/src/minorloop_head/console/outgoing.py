"""What the ticks of the console send: messages to the pages, commands to the camera process."""

from __future__ import annotations

from collections import deque

from minorloop_head.console import messages
from minorloop_head.console.camera_protocol import CameraCommand


class Outgoing:
    """Messages and commands, in their order.

    Attributes
    ----------
    events : collections.deque
        Encoded messages to the pages, as bytes; whoever sends them takes them out. Any thread adds
        to them.
    commands : list of CameraCommand
        Of this tick.
    """

    def __init__(self) -> None:
        self.events: deque[bytes] = deque()
        self.commands: list[CameraCommand] = []

    def send(self, message: messages.ToPage) -> None:
        """Send a message to the pages."""
        self.events.append(messages.encode(message))

    def notice(self, text: str) -> None:
        """Send a sentence to the pages."""
        self.send(messages.Notice(text=text))

    def command(self, name: str, *numbers: float) -> None:
        """Send a command to the camera process."""
        self.commands.append((name, [float(number) for number in numbers]))

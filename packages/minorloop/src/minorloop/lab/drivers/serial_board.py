"""A board with several inputs, sensors and digital lines, on a serial line.

The lines are those of `minorloop.lab.drivers.serial_line`; the questions are

=============  =======================  ====================================================
``HELLO``      ``minorloop 3 I O D P``  protocol, inputs, outputs, lines, patience in ms
``INPUT k``    ``unit low high rest``   unit, limits and safe value of input k, from 0
``OUTPUT k``   ``unit``                 unit of output k
``SET u ...``  ``u ...``                apply all inputs; ERR if one is beyond its limits
``GET``        ``y ...``                read all outputs
``FOLLOW y``   ``y ...``                targets of all outputs, for firmware with an inverse
``LINE k s``   ``s``                    switch digital line k on, 1, or off, 0
``SAFE``       ``u ...``                go to the safe inputs; the answer has those that are on
=============  =======================  ====================================================

The unit ``1`` means a pure number. Patience, ``ERR safe`` and late answers are as in protocol 2.
Boards of protocol 2 are accepted too: they have one input, one output and no lines.

Keys of the device: ``resource``, ``library``, ``timeout``, ``baud``. Sources, sensors and lines
have ``channel``, their number on the board, by default in their order.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, ParameterError, all_done
from minorloop.lab.actuator import ROUNDING
from minorloop.lab.drivers.device import DeviceChannel, DevicePlan, Section, parsed
from minorloop.lab.drivers.link import Link, LinkSettings, number, opened
from minorloop.lab.drivers.serial_line import BoardLine

NEEDS = "pyvisa", "instruments"
"""Library of the driver, and the extra that installs it."""

_GREETINGS = (["2"], 5), (["3"], 6)
"""Protocols, and words of their answers to HELLO."""
_SAME = 1e-6
"""Largest difference between equal safe values, as a share of the range."""


class _SerialSettings(LinkSettings, kw_only=True):
    timeout: float = 0.5
    baud: int | None = 115200


class _BoardChannel(Section, kw_only=True):
    channel: int | None = None


class SerialBoard(BoardLine):
    """A board as a device with several channels.

    Raises a `ParameterError` if a channel, unit, limit or rest of the plan does not match the
    board; an `InstrumentError` if the answers are not those of such a board.
    """

    def __init__(self, link: Link, plan: DevicePlan) -> None:
        super().__init__(link)
        inputs, outputs, lines = self._counts()
        # A limit of protocol 2 may have more than nine digits, but a line of many inputs is short.
        self._written = repr if self.hello[1] == "2" else "{:.9g}".format
        self._sources = _places(plan.sources, inputs, "input")
        self._sensors = _places(plan.sensors, outputs, "output")
        self._lines = _places(plan.lines, lines, "line")
        self._outputs, self._resting_lines = outputs, plan.resting_lines
        self._rest, self._narrower = np.zeros(inputs), list[str]()
        self._slow = [wire.name for wire in plan.sources if np.isfinite(wire.rate)]
        self._check(plan)

    def set(self, values: FloatArray) -> None:
        """Apply inputs; inputs that the bench does not use stay at rest."""
        every = self._rest.copy()
        every[self._sources] = values
        self._apply(every.tolist(), *map(self._written, every.tolist()))

    def follow(self, targets: FloatArray) -> None:
        """Give targets (N,) of all outputs, which the exact inverses in the board follow.

        Until the next ``set`` or ``safe`` the board sets its inputs by itself, within its own
        limits.

        Raises a `ParameterError` if the bench has narrower limits than the board, or rate limits,
        which the board does not know; an `InstrumentError` if a target is out of reach, or the
        firmware has no inverse.
        """
        if self._narrower:
            raise ParameterError(
                f"{self._narrower[0]} has narrower limits in the bench than on {self._link.name}, "
                "which follows targets within its own limits; export the firmware with those of "
                "the bench"
            )
        if self._slow:
            raise ParameterError(
                f"{self._slow[0]} has a rate limit, which {self._link.name} does not know: it sets "
                "its inputs by itself; omit the rate, or command currents instead of targets"
            )
        wanted = targets.tolist()
        self._apply(wanted, *map(self._written, wanted), command="FOLLOW")

    def read(self) -> FloatArray:
        """Return the readings of the sensors."""
        return np.array(self._numbers(self._outputs, "GET"))[self._sensors]

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch lines on or off."""
        for line, on in values.items():
            wanted = str(int(on))
            answer = self._ask("LINE", str(self._lines[line]), wanted)
            if answer != [wanted]:
                raise InstrumentError(
                    f"{self._link.name} was asked to switch line {self._lines[line]} to {wanted} "
                    f"and answers {' '.join(answer)!r}"
                )

    def safe(self) -> None:
        """Go to the safe inputs, and set the lines to rest.

        Raises an `InstrumentError` if the board does not confirm. Without questions it goes to the
        safe inputs after its patience.
        """
        self._on = False
        all_done([self._rested, lambda: self.switch(self._resting_lines)])

    def close(self) -> None:
        """Close the connection."""
        self._link.close()

    def _rested(self) -> None:
        answer = self._ask("SAFE")
        if self.hello[1] == "2":
            return
        found = np.array([number(word, self._link.name) for word in answer])
        near = _SAME * np.maximum(1.0, np.abs(self._rest))
        if found.shape != self._rest.shape or not (np.abs(found - self._rest) <= near).all():
            raise InstrumentError(
                f"{self._link.name} was made safe and answers {' '.join(answer)!r}, not its safe "
                f"inputs {self._rest.tolist()}"
            )

    def _counts(self) -> tuple[int, int, int]:
        """Return the numbers of inputs, outputs and lines of the board, and note its patience."""
        words = self.hello
        if words[:1] != ["minorloop"] or (words[1:2], len(words)) not in _GREETINGS:
            raise InstrumentError(
                f"{self._link.name} answers {' '.join(words)!r}; its firmware has another protocol "
                "than minorloop 2 or 3: export it again"
            )
        self._wait_at_most(words[-1])
        if words[1] == "2":
            return 1, 1, 0
        if not all(word.isdigit() for word in words[2:5]):
            raise InstrumentError(f"{self._link.name} answers HELLO with {' '.join(words)!r}")
        return int(words[2]), int(words[3]), int(words[4])

    def _check(self, plan: DevicePlan) -> None:
        """Compare units, limits and rest of the plan with those of the board."""
        for k in range(len(self._rest)):
            unit, low, high, self._rest[k] = self._input(k)
            wires = [w for w, c in zip(plan.sources, self._sources, strict=True) if c == k]
            for wire in wires:
                self._check_unit(wire, unit)
                slack = ROUNDING * (high - low)
                if wire.low > low + slack or wire.high < high - slack:
                    self._narrower.append(wire.name)
                if not low - slack <= wire.low < wire.high <= high + slack:
                    raise ParameterError(
                        f"{wire.name} may be [{wire.low:g}, {wire.high:g}], and {self._link.name} "
                        f"allows [{low:g}, {high:g}]; give limits inside those of the board"
                    )
                if abs(wire.rest - self._rest[k]) > _SAME * (high - low):
                    raise ParameterError(
                        f"{wire.name} rests at {wire.rest:g}, and {self._link.name} goes to "
                        f"{self._rest[k]:g} by itself; give both the same rest"
                    )
        for wire, k in zip(plan.sensors, self._sensors, strict=True):
            if self.hello[1] != "2":
                self._check_unit(wire, " ".join(self._ask("OUTPUT", str(k))))

    def _input(self, k: int) -> tuple[str | None, float, float, float]:
        """Return unit, limits and rest of an input; the unit is None if not known."""
        if self.hello[1] == "2":
            low, high = (number(word, self._link.name) for word in self.hello[2:4])
            return None, low, high, min(max(0.0, low), high)
        unit, *words = self._ask("INPUT", str(k)) or [""]
        if len(words) != 3:
            raise InstrumentError(f"{self._link.name} answers INPUT with {unit} {words}")
        low, high, rest = (number(word, self._link.name) for word in words)
        return unit, low, high, rest

    def _check_unit(self, wire: DeviceChannel, unit: str | None) -> None:
        if unit is not None and wire.unit is not None and unit != (wire.unit or "1"):
            raise ParameterError(
                f"{wire.name} is in {wire.unit or '1'}, and {self._link.name} has {unit}; correct "
                "the unit, or give a conversion"
            )


def open_device(plan: DevicePlan) -> SerialBoard:
    """Return a board on a serial line, which is kept alive.

    Raises a `ParameterError` if a key is missing, unknown, or of another type, or the plan does not
    match the board; a `MissingExtraError` if PyVISA is not installed; an `InstrumentError` if there
    is no board, or it does not answer.
    """
    how = parsed(_SerialSettings, plan.keys, f"device {plan.name!r}", "device")
    for wire in (*plan.sources, *plan.sensors, *plan.lines):  # before anything is opened
        wire.parsed(_BoardChannel)
    link = opened(how, plan.folder)
    try:
        board = SerialBoard(link, plan)
    except BaseException:
        link.close()
        raise
    board.keep_alive()
    return board


def found() -> list[str]:
    """Return the serial ports of this machine."""
    try:
        from serial.tools.list_ports import comports  # type: ignore[import-untyped]
    except ImportError:
        return []
    return sorted(f"ASRL{port.device}::INSTR" for port in comports())


def _places(wires: Sequence[DeviceChannel], count: int, what: str) -> list[int]:
    """Return the number on the board of each channel."""
    places = []
    for number_, wire in enumerate(wires):
        given = wire.parsed(_BoardChannel).channel
        place = number_ if given is None else given
        if not 0 <= place < count:
            raise ParameterError(
                f"{wire.name} is {what} {place} of the board, which has {count}, numbered from 0"
            )
        places.append(place)
    if len(set(places)) < len(places):
        raise ParameterError(f"two channels are the same {what} of the board: {places}")
    return places

"""A driver to copy: an amplifier that takes millivolts, and a laser with answers in words.

To write one:

1. Write a class with ``set`` and ``safe`` (a `Source`) or ``read`` (a `Meter`) that talks to the
   instrument. Take a `Link`, so that it can be tested without the instrument.
2. Set exactly the given input, or refuse it: the record contains the given input.
3. ``safe`` must work after any failure: it is called after any error, again and again for ten
   seconds, with the instrument in any state. It sends all commands that make it safe, needs no
   answer to an earlier question, asks whether it is safe, and raises an error unless confirmed.
4. Check every answer: raise `InstrumentError` unless it is exactly as in the manual. A number that
   only looks right is worse than an error.
5. Write the conversation of the manual as a `Script`, and test the driver against it, also with
   late, wrong and missing answers; see ``tests/lab/drivers/test_template.py``.
6. Make an actuator of the two with `Bench`, which checks limits and makes the source safe after any
   error::

       laser = Laser(VisaLink("ASRL/dev/ttyUSB0::INSTR", baud=115200))
       amplifier = Amplifier(VisaLink("GPIB0::9::INSTR"))
       bench = Bench(
           amplifier,
           laser,
           Channel("voltage", "V", low=-1.2, high=1.2, rate=10.0),
           Channel("displacement", "m", low=0.0, high=0.03),
       )
"""

import re

from minorloop.errors import InstrumentError
from minorloop.lab.drivers.link import Link

_READING = re.compile(r"DIST=(\d+\.\d{3})mm STATUS=(\d)")


class Amplifier:
    """Sets an input in volts, sent as whole millivolts; the instrument answers ``OK``."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def set(self, value: float) -> None:
        """Apply a voltage, in V.

        Raises an `InstrumentError` if the amplifier cannot give exactly this voltage.
        """
        millivolts = round(1000 * value)
        if abs(1000 * value - millivolts) > 1e-6:
            raise InstrumentError(f"the amplifier takes whole millivolts, not {1000 * value:g}")
        self._command(f"MV={millivolts}")

    def safe(self) -> None:
        """Set 0 V and open the output; the second command is sent even if the first fails."""
        try:
            self._command("MV=0")
        finally:
            self._command("OPEN")

    def _command(self, line: str) -> None:
        answer = self._link.ask(line)
        if answer != "OK":
            raise InstrumentError(f"the amplifier answers {answer[:60]!r} to {line!r}, not OK")


class Laser:
    """Measures a distance in metres, if it sees the target."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def read(self) -> float:
        """Return the distance now, in m."""
        answer = self._link.ask("MEASURE")
        found = _READING.fullmatch(answer)
        if found is None:
            raise InstrumentError(f"the laser answers {answer[:60]!r}, which is not a distance")
        if found[2] != "0":
            raise InstrumentError(f"the laser does not see its target (status {found[2]})")
        return 1e-3 * float(found[1])

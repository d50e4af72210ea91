"""A driver to copy: an amplifier that takes millivolts, and a laser that answers in words.

To write one:

1. Write what the instrument says and hears as a class with ``set`` and ``safe`` (a `Source`) or
   ``read`` (a `Meter`). Take a `Link`, so that it can be tested without the instrument.
2. Set exactly what is asked for, or refuse: the record says what was asked for.
3. Let ``safe`` survive whatever failed before it: it is called after any error, again and again
   for ten seconds, with the instrument in any state. Let it send all that makes safe, need no
   answer to an earlier question, ask whether it is safe, and raise where nothing says so.
4. Let every answer be checked: raise `InstrumentError` for what is not exactly what the manual
   says. A number that only looks right is worse than an error.
5. Write the conversation of the manual down as a `Script`, and test the driver against it, with
   answers that are late, wrong or missing too; ``tests/lab/drivers/test_template.py`` does.
6. Make an actuator of the two with `Bench`, which keeps limits and goes to safety on any error::

       laser = Laser(VisaLink("ASRL/dev/ttyUSB0::INSTR", baud=115200))
       amplifier = Amplifier(VisaLink("GPIB0::9::INSTR"))
       bench = Bench(
           amplifier,
           laser,
           Channel("voltage", "V", low=-1.2, high=1.2, rate=10.0),
           Channel("displacement", "m", low=0.0, high=0.03),
       )
"""

from __future__ import annotations

import re

from minorloop.errors import InstrumentError
from minorloop.lab.drivers.link import Link

_READING = re.compile(r"DIST=(\d+\.\d{3})mm STATUS=(\d)")


class Amplifier:
    """Takes an input in volts and sends whole millivolts; says ``OK`` to everything it took."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def set(self, value: float) -> None:
        """Put a voltage on, in V.

        Raises
        ------
        InstrumentError
            If it is none that the amplifier can give: what is recorded has to be what is on.
        """
        millivolts = round(1000 * value)
        if abs(1000 * value - millivolts) > 1e-6:
            raise InstrumentError(f"the amplifier takes whole millivolts, not {1000 * value:g}")
        self._say(f"MV={millivolts}")

    def safe(self) -> None:
        """No voltage, output open; the second is said whatever becomes of the first."""
        try:
            self._say("MV=0")
        finally:
            self._say("OPEN")

    def _say(self, line: str) -> None:
        answer = self._link.ask(line)
        if answer != "OK":
            raise InstrumentError(f"the amplifier answers {answer[:60]!r} to {line!r}, not OK")


class Laser:
    """Gives a distance in metres, if it sees the target."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def read(self) -> float:
        """The distance now, in m."""
        answer = self._link.ask("MEASURE")
        found = _READING.fullmatch(answer)
        if found is None:
            raise InstrumentError(f"the laser answers {answer[:60]!r}, which is no distance")
        if found[2] != "0":
            raise InstrumentError(f"the laser does not see its target (status {found[2]})")
        return 1e-3 * float(found[1])

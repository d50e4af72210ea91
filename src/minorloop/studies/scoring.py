"""The truth about a twin of the head, for judging a run once it is over.

No estimator and no controller may know any of this; only a study reads it, after a run.
"""

from __future__ import annotations

from dataclasses import dataclass

from minorloop.arrays import FloatArray
from minorloop.twins.wire import HeatedWires


@dataclass(frozen=True, eq=False)
class Truth:
    """What really happened.

    Parameters
    ----------
    angle : (T, axes) array
        Angles without noise and delay, in degrees, at the end of every tick.
    hottest : (axes,) array
        Highest temperature of each wire, in degrees Celsius.
    stress : (axes,) array
        Highest stress of each wire, in Pa.
    """

    angle: FloatArray
    hottest: FloatArray
    stress: FloatArray


def truth(twin: HeatedWires) -> Truth:
    """Read the log of a twin that was made with ``log_truth=True``, after its run."""
    hottest, stress = twin._peaks()
    return Truth(twin._truth()["angle"], hottest, stress)

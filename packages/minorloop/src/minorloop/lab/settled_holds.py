"""Measure settled outputs of an actuator, judged as by ``minorloop run``."""

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.lab.actuator import Actuator
from minorloop.lab.records import Record
from minorloop.lab.settling import SPAN_SHARE, judge

FURTHER = 1_000_003
"""Distance between the noise seeds of experiments on one specimen."""


def hold_each(
    actuator: Actuator, inputs: npt.ArrayLike, hold: float, sample_interval: float = 1.0
) -> tuple[Record, FloatArray]:
    """Apply inputs one after the other; return every sample, and the settled outputs (n,).

    ``actuator``: actuator to drive; ``inputs`` (n,): in order, each within the actuator's limits;
    ``hold``: seconds for each; ``sample_interval``: seconds between samples.
    """
    values = np.asarray(inputs, dtype=np.float64)
    holds = [actuator.apply(float(u), hold, sample_interval) for u in values]
    whole = Record.joined(holds)
    span = float(np.ptp(whole.y))
    return whole, np.array([settled_value(each, span) for each in holds])


def settled_value(hold: Record, span: float) -> float:
    """Return the settled output of a hold.

    ``hold``: evenly spaced samples of a hold, the first an interval after its beginning;
    ``span``: range of the output in the experiment, in its unit.
    """
    # A hold with fewer samples is not judged; its last sample counts
    if hold.t.size < 12:
        return float(hold.y[-1])
    times = hold.t - hold.t[0] + (hold.t[1] - hold.t[0])
    length = float(times[-1])
    tolerance = SPAN_SHARE * span / length
    # The slope is taken over the last tenth of the hold, as in a plan by default
    return judge(times, hold.y, tolerance=tolerance, window=length / 10).value

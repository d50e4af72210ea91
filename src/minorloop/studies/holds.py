"""Settled measurements on an actuator."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.lab.actuator import Actuator
from minorloop.lab.records import Record


def hold_each(
    actuator: Actuator, inputs: npt.ArrayLike, hold: float, sample_interval: float = 1.0
) -> tuple[Record, FloatArray]:
    """Apply inputs one after the other, and return the settled outputs.

    Parameters
    ----------
    actuator : Actuator
        What to drive.
    inputs : (n,) array_like
        In order, each within the actuator's limits.
    hold : float
        Seconds for each.
    sample_interval : float
        Seconds between samples.

    Returns
    -------
    record : Record
        Every sample.
    settled : (n,) array
        The last sample of each hold.
    """
    values = np.asarray(inputs, dtype=np.float64)
    holds = [actuator.apply(float(u), hold, sample_interval) for u in values]
    return Record.joined(holds), np.array([record.y[-1] for record in holds])

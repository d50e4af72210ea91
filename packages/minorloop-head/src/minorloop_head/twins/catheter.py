"""The catheter that carries the head: it advances in the pipe and rolls about the axis.

A motor at the entrance pushes and turns a long elastic tube with friction on the wall: the tip
follows with a delay, ignores small motions, and jumps a little when it breaks away.

Channels, in this order: ``advance rate`` in mm/s, -20 to 20, and ``roll rate`` in deg/s, -60
to 60, in; ``advance`` in mm and ``roll`` in degrees, of the tip, out.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.lab.actuator import Channel
from minorloop_head.twins._kernels import catheter_run
from minorloop_head.twins.simulated_axes import SimulatedAxes

TRAVEL = 1500.0
"""Travel of the catheter in the pipe, in mm."""
TURNS = 720.0
"""Largest roll in either direction, limited by the winding of the cables, in degrees."""

# A choice: a tube of a few N/mm and N m/deg against a few newtons of friction.
_NOMINAL = {
    "advance_acceleration": 40.0,  # mm/s^2
    "advance_breakaway": 1.2,  # mm
    "advance_sliding": 0.8,  # mm
    "advance_relaxation": 0.10,  # s
    "roll_acceleration": 180.0,  # deg/s^2
    "roll_breakaway": 6.0,  # deg
    "roll_sliding": 4.0,  # deg
    "roll_relaxation": 0.06,  # s
    "friction_growth": 1e-3,  # 1/mm
}
_DRIVES = list(_NOMINAL)[:8]


class Catheter(SimulatedAxes):
    """A motor, an elastic tube and friction: two rates in, the place of the tip out.

    Its nine parameters are those of motors, tube and friction; options are those of
    ``SimulatedAxes``. Noise is in mm and degrees, the channels of faults are ``advance`` and
    ``roll``.

    Notes
    -----
    The motor reaches a commanded rate with limited acceleration and stops at the ends of its
    travel, 0 to 1500 mm and -720 to 720 degrees. The tip q sticks until it lags the motor p by
    more than the breakaway; then tau dq/dt = p - q -+ s until it stops, where s is the lag of
    sliding friction. Both lags grow with the length in the pipe.
    """

    kind = "catheter"
    inputs = (
        Channel("advance rate", "mm/s", -20.0, 20.0),
        Channel("roll rate", "deg/s", -60.0, 60.0),
    )
    outputs = (Channel("advance", "mm"), Channel("roll", "deg"))
    _nominal = _NOMINAL
    _rest_input = (0.0, 0.0)
    _farthest = 2000.0
    _truth_names = ("tip", "motor", "motor_rate")

    @cached_property
    def _drives(self) -> FloatArray:
        """Parameters of both axes (2, 6), see ``catheter_step``."""
        drives = np.reshape([self._parameters[name] for name in _DRIVES], (2, 4))
        return np.hstack([drives, [[0.0, TRAVEL], [-TURNS, TURNS]]])

    def _at_rest(self) -> FloatArray:
        return np.zeros((2, 4))

    def _run(self, ends: FloatArray, first: FloatArray, u: FloatArray) -> FloatArray:
        out: FloatArray = catheter_run(
            self._state, self._drives, self._parameters["friction_growth"], self._clock, ends,
            first, u, self._pace, self.delay, self._past, self._mark,
        )  # fmt: skip
        return out

    def _output_now(self) -> FloatArray:
        return self._state[:, 2].copy()

    def _truth_now(self) -> FloatArray:
        return self._state[:, [2, 1, 0]].T

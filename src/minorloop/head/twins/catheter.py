"""The catheter that carries the head: it advances in the pipe and rolls about the axis.

A motor at the entrance pushes and turns a long elastic tube with friction on the wall: the tip
follows with a delay, does not follow small motions, and jumps a little when it breaks away.

Channels, in this order: ``advance rate`` in mm/s, -20 to 20, and ``roll rate`` in deg/s, -60
to 60, in; ``advance`` in mm and ``roll`` in degrees, of the tip, out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.head.twins.sensor import Fault
from minorloop.head.twins.simulated_axes import SimulatedAxes
from minorloop.lab.actuator import Channel
from minorloop.twins import _kernels
from minorloop.twins.checkpoints import check_within, damaged

TRAVEL = 1500.0
"""Travel of the catheter in the pipe, in mm."""
TURNS = 720.0
"""Largest roll in either direction before the cables are wound up, in degrees."""

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


class Catheter(SimulatedAxes):
    """A motor, an elastic tube and friction: two rates in, the place of the tip out.

    Parameters
    ----------
    specimen : int, optional
        Seed of a specimen: the nine parameters of motors, tube and friction are drawn within
        +-10 % of nominal. Without it, the nominal catheter.
    noise : float
        Standard deviation of the readings, in mm and in degrees.
    seed : int
        Seed of the noise.
    tick : float
        Duration of one ``exchange``, in seconds.
    delay : float
        Delay of the readings, in seconds.
    faults : sequence of Fault
        Times in which readings are stuck or lost, channel ``advance`` or ``roll``.
    substeps : int
        Divides every time step of the integration, 10 ms at most.
    log_truth : bool
        Whether to log the hidden state at the end of every call, for scoring after the run.

    Raises
    ------
    ParameterError
        If an option is out of its range.

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
    _rest_input = (0.0, 0.0)
    _longest_step = 0.01
    _farthest = 2000.0
    _truth_names = ("tip", "motor", "motor_rate")

    def __init__(
        self,
        specimen: int | None = None,
        noise: float = 0.0,
        seed: int = 0,
        *,
        tick: float = 0.04,
        delay: float = 0.0,
        faults: Sequence[Fault] = (),
        substeps: int = 1,
        log_truth: bool = False,
    ) -> None:
        super().__init__(
            _NOMINAL,
            specimen=specimen,
            noise=noise,
            seed=seed,
            tick=tick,
            delay=delay,
            faults=faults,
            substeps=substeps,
            log_truth=log_truth,
        )
        *drives, self._growth = self._parameters.values()
        ends = np.array([[0.0, TRAVEL], [-TURNS, TURNS]])
        self._drives = np.hstack([np.reshape(drives, (2, 4)), ends])

    def _at_rest(self) -> FloatArray:
        return np.zeros((2, 4))

    def _check_state(self, state: FloatArray, clock: float) -> None:
        rate, motor, tip, way = state.T
        _, breakaway, sliding, relaxation, low, high = self._drives.T
        fastest = np.array([channel.high for channel in self.inputs])
        check_within(rate, -fastest, fastest, "rate of motor")
        check_within(motor, low, high, "position of motor")
        stretch = 1.0 + self._growth * TRAVEL
        most = stretch * (breakaway + sliding) + (relaxation + self._longest_step) * fastest
        check_within(motor - tip, -most, most, "lag of tip")
        if not np.isin(way, (-1.0, 0.0, 1.0)).all():
            raise damaged("a tip neither sticks nor slides")

    def _run(self, ends: FloatArray, first: FloatArray, u: FloatArray) -> FloatArray:
        out: FloatArray = _kernels.catheter_run(
            self._state,
            self._drives,
            self._growth,
            self._clock,
            ends,
            first,
            u,
            self._pace,
            self.delay,
            self._past,
            self._mark,
        )
        return out

    def _output_now(self) -> FloatArray:
        return self._state[:, 2].copy()

    def _truth_now(self) -> FloatArray:
        return self._state[:, [2, 1, 0]].T

"""The head of the catheter: two wires, each against its spring, that pan and tilt a camera.

Channels, in this order: ``pan current`` and ``tilt current`` in A, 0 to 0.4, in; ``pan`` and
``tilt`` in degrees, 0 when cold, about 60 at 0.4 A, out. A loop is::

    head = Head(noise=0.05, delay=0.04)
    u = np.zeros(2)
    for each tick of 40 ms:
        y = head.exchange(u)  # (2,) degrees; NaN where a sensor is lost
        u = controller(y)     # (2,) amperes; LimitError beyond [0, 0.4]
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.head.twins.sensor import Fault
from minorloop.head.twins.surroundings import Surroundings
from minorloop.head.twins.wire import HIGHEST_CURRENT, WIRE, HeatedWires
from minorloop.lab.actuator import Channel

# The sensors read 6 to 9 % of the other axis, more when deflected; the springs change the stress of
# the other wire by up to 10 MPa.
_COUPLING = {
    "cross_pan": 0.07,
    "cross_tilt": 0.06,
    "cross_growth": 0.2,  # 1/rad
    "push": 210.0,  # N/m
    "push_balance": 1.5e-3,  # m
}


class Head(HeatedWires):
    """Two wires at right angles: two currents in, pan and tilt out.

    Parameters
    ----------
    specimen : int, optional
        Seed of a specimen: the seventeen parameters of each wire and the five of the coupling
        are drawn within +-10 % of nominal; the pan wire is that of ``Wire(specimen)``.
    noise : float
        Standard deviation of the measured angles, in degrees.
    seed : int
        Seed of the noise.
    tick : float
        Duration of one ``exchange``, in seconds.
    delay : float
        Delay of the measured angles, in seconds.
    surroundings : Surroundings, optional
        Ambient, convection and load over time; still air at 20 degrees without it.
    ageing, drift : float
        As in ``Wire``, of both wires.
    faults : sequence of Fault
        Times in which readings are stuck or lost, channel ``pan`` or ``tilt``.
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
    Each wire follows the equations of ``Wire``. The spring of each axis also pushes on the
    other wire, with the force p (x - x_b) at its compression x; the sensors read

    pan = a + q_1 (1 + g a) b, tilt = b + q_2 (1 + g b) a

    of the angles a and b to which the wires have turned their pulleys.
    """

    kind = "head"
    inputs = (
        Channel("pan current", "A", 0.0, HIGHEST_CURRENT),
        Channel("tilt current", "A", 0.0, HIGHEST_CURRENT),
    )
    outputs = (Channel("pan", "deg"), Channel("tilt", "deg"))
    _rest_input = (0.0, 0.0)

    def __init__(
        self,
        specimen: int | None = None,
        noise: float = 0.0,
        seed: int = 0,
        *,
        tick: float = 0.04,
        delay: float = 0.0,
        surroundings: Surroundings | None = None,
        ageing: float = 0.0,
        drift: float = 0.0,
        faults: Sequence[Fault] = (),
        substeps: int = 1,
        log_truth: bool = False,
    ) -> None:
        wires = {f"{axis}_{name}": WIRE[name] for axis in ("pan", "tilt") for name in WIRE}
        super().__init__(
            {**wires, **_COUPLING},
            specimen=specimen,
            noise=noise,
            seed=seed,
            tick=tick,
            delay=delay,
            surroundings=surroundings,
            ageing=ageing,
            drift=drift,
            faults=faults,
            substeps=substeps,
            log_truth=log_truth,
        )

    def _wires(self) -> list[dict[str, float]]:
        return [
            {name: self._parameters[f"{axis}_{name}"] for name in WIRE} for axis in ("pan", "tilt")
        ]

    def _coupling(self) -> FloatArray:
        return np.array([self._parameters[name] for name in _COUPLING])

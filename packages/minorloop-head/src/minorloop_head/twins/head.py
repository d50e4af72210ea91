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

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.lab.actuator import Channel
from minorloop_head.geometry import AXES
from minorloop_head.twins.wire import HIGHEST_CURRENT, WIRE, HeatedWires

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

    The seventeen parameters of each wire and the five of the coupling belong to a specimen; its pan
    wire is that of ``Wire(specimen)``. Options are those of ``HeatedWires``; the channels of faults
    are ``pan`` and ``tilt``.

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
    _nominal = {  # noqa: RUF012
        **{f"pan_{name}": value for name, value in WIRE.items()},
        **{f"tilt_{name}": value for name, value in WIRE.items()},
        **_COUPLING,
    }
    _rest_input = (0.0, 0.0)

    @property
    def serial(self) -> str:
        """Serial number of the specimen."""
        return f"twin-head-{'nominal' if self.specimen is None else self.specimen}"

    def _wires(self) -> list[dict[str, float]]:
        return [{name: self._parameters[f"{axis}_{name}"] for name in WIRE} for axis in AXES]

    def _coupling(self) -> FloatArray:
        return np.array([self._parameters[name] for name in _COUPLING])

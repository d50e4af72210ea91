"""Send the optical axis, along which the point of a tool goes, to a place of the wall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.head.geometry import wall_point
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.centre import CONE, CentreState, Centring
from minorloop.head.procedures.go import GO, Go, GoState
from minorloop.head.procedures.meter import Metering, MeterState
from minorloop.head.procedures.values import Procedure, Reading, Request

APPROACH = 0.6
"""Share of the deflection to which the head turns before the servo takes over. The servo then
approaches from the side of the axis and does not drive the head beyond the cone."""


def aim_at(
    calibration: HeadCalibration, place: npt.ArrayLike, catheter: npt.ArrayLike, share: float = 1.0
) -> FloatArray:
    """Return pan and tilt (2,), within the cone, of a share of the turn towards a place.

    Parameters
    ----------
    calibration : HeadCalibration
    place : (2,) array_like
        Phi and z.
    catheter : (2,) array_like
        Its advance and roll.
    share : float
        1 looks at the place.
    """
    phi, z = np.asarray(place, dtype=np.float64).tolist()
    point = wall_point(phi, z, calibration.radius)
    return CONE.clip(share * np.array(calibration.mount_at(catheter).aim(point)))


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkState:
    """The place (2,), phi and z, the gain of the camera, and the states of the parts."""

    place: FloatArray
    gain: float
    go: GoState | None = None
    meter: MeterState | None = None
    centre: CentreState | None = None
    done: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Marking(Procedure[MarkState]):
    """Turn towards a place, meter the light, and centre it.

    Parameters
    ----------
    calibration : HeadCalibration
    go : Go
    """

    calibration: HeadCalibration
    go: Go = GO

    def begin(self, place: npt.ArrayLike, gain: float = 1.0) -> MarkState:
        """Return the state of a move of the axis to phi and z (2,), at a gain of the camera."""
        return MarkState(place=np.asarray(place, dtype=np.float64), gain=gain)

    def _next(self, state: MarkState, reading: Reading) -> tuple[MarkState, Request]:
        if state.go is None or not state.go.done:
            aim = aim_at(self.calibration, state.place, reading.place, APPROACH)
            go, request = self.go.step(state.go or self.go.begin(angles=aim), reading)
            return replace(state, go=go), request
        if state.meter is None or not state.meter.done:
            metering = Metering(calibration=self.calibration)
            meter, request = metering.step(state.meter or metering.begin(state.gain), reading)
            return replace(state, meter=meter, gain=meter.gain), request
        centring = Centring(calibration=self.calibration)
        centre, request = centring.step(state.centre or centring.begin(state.place), reading)
        return replace(state, centre=centre, done=centre.done), request

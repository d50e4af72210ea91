"""A minimal plant and tip, and a loop that records requests."""

from functools import cache

import numpy as np

from minorloop import Channel
from minorloop_head.geometry import Mount
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.values import NOW, Reading, Request
from minorloop_head.sources import Shot
from minorloop_head.twins.camera import LENS, Camera, led_positions
from minorloop_head.twins.pipe import Pipe
from minorloop_head.vision.calibrated_camera import CalibratedCamera

TICK = 0.04
MOUNT = Mount(offset=(0.1e-3, -0.1e-3), roll=0.3, advance=1e-3)
PIPE = Pipe.draw(1, length=51.2e-3)
CALIBRATION = HeadCalibration(lens=LENS, leds=led_positions(), offset=(0.1e-3, -0.1e-3), roll=0.3)


@cache
def camera():
    return Camera(PIPE, MOUNT)


CURRENTS = [Channel(f"{axis} current", "A", 0.0, 0.4) for axis in ("pan", "tilt")]
ANGLES = [Channel(axis, "deg") for axis in ("pan", "tilt")]


class Loop:
    """A head that moves by a share of its error in a tick, and an ideal catheter.

    ``stuck`` holds the catheter where it is. Requests are kept in ``asked``.
    """

    def __init__(self, angles=(0.0, 0.0), place=(0.0, 0.0), *, share=0.3, stuck=False, sees=False):
        self.angles, self.place = np.array(angles, float), np.array(place, float)
        self.share, self.stuck, self.sees = share, stuck, sees
        self.asked, self.t = [], 0.0

    def reading(self, request=None):
        request = request or Request()
        image = None
        if request.frame and self.sees:
            camera().look(*self.angles)
            image = camera().frame().image
        return Reading(
            t=self.t,
            angles=self.angles.copy(),
            place=self.place.copy(),
            image=image,
            shots=(Shot(self.t, np.zeros(2000), 1e-8),) * request.shots,
        )

    def tick(self, request):
        self.asked.append(request)
        self.t += TICK
        if request.angles is not None:
            self.angles += self.share * (request.angles - self.angles)
        if not self.stuck:
            self.place += TICK * request.rates

    def run(self, procedure, each=lambda: None, ticks=3000):
        """Run to the end, and return the result."""
        try:
            request = next(procedure)
            for _ in range(ticks):
                if not request.now:
                    self.tick(request)
                elif request is not NOW:
                    self.asked.append(request)
                each()
                request = procedure.send(self.reading(request))
        except StopIteration as end:
            return end.value
        raise AssertionError(f"it never ended; {request}")


def eye() -> CalibratedCamera:
    return CALIBRATION.camera_at((1e-3, 0.0))

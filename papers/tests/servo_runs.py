"""Runs of the visual servo that were not driven."""

import numpy as np

from papers.catheter.inspection_servo import CASES, PRINTED, WITHOUT, ServoRun


def held_points(off=0.1, without=0.4, printed=90.0):
    """Runs with a constant distance in pixels: with the integral, without, and the printed sign."""

    def run(distance):
        t = 0.04 * np.arange(1.0, 1001.0)
        place = np.stack([np.full(t.size, distance), np.zeros(t.size)], axis=1)
        off = np.full(t.size, distance)
        return ServoRun(t, off, ("tracked",) * t.size, off, place)

    each = {f"{case}{words}": d for case in CASES for words, d in (("", off), (WITHOUT, without))}
    return {name: run(distance) for name, distance in {**each, PRINTED: printed}.items()}

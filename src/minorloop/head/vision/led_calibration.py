"""Positions of LEDs from their reflections in a glossy flat target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError, counted
from minorloop.head.geometry import Pinhole
from minorloop.head.vision.calibrated_camera import Image
from minorloop.head.vision.imaging import opencv
from minorloop.head.vision.lens_calibration import TargetPose

LEAST_REFLECTIONS = 4
_SATURATED, _LEAST_PIXELS = 250, 4
_SECOND = 0.3
"""Largest share that the second largest saturated spot may have of the largest."""
_FARTHEST = 0.05
"""Largest distance of an LED from the lens, in metres."""
_LARGEST_RMS = 5.0
"""Largest rms distance of reflections from the fit, in pixels."""


def find_reflection(image: Image) -> FloatArray | None:
    """Return the pixel (2,) of the one saturated spot in a picture; None without exactly one.

    Parameters
    ----------
    image : (H, W) array of uint8
    """
    cv2 = opencv()
    bright = (image >= _SATURATED).astype(np.uint8)
    count, _, statistics, centres = cv2.connectedComponentsWithStats(bright)
    areas = statistics[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < _LEAST_PIXELS:
        return None
    order = np.argsort(areas)[::-1]
    if len(order) > 1 and areas[order[1]] > _SECOND * areas[order[0]]:
        return None
    found: FloatArray = np.asarray(centres[1 + order[0]], dtype=np.float64)
    return found


def fit_led(
    lens: Pinhole, poses: Sequence[TargetPose], pixels: FloatArray, name: str
) -> tuple[FloatArray, FloatArray]:
    """Fit the position of an LED to its reflections.

    Parameters
    ----------
    lens : Pinhole
    poses : sequence of N TargetPose
        Of the glossy target.
    pixels : (N, 2) array
        Where the reflection was.
    name : str
        Of the LED, for messages.

    Returns
    -------
    position, sd : (3,) array
        In the camera, in metres, and its standard deviation.

    Raises
    ------
    RecordError
        If there are too few, or they are not of one LED.

    Notes
    -----
    The image of an LED at L in the mirror n x = d is at L - 2 (n L - d) n.
    """
    if len(poses) < LEAST_REFLECTIONS:
        raise RecordError(
            f"{counted(len(poses), 'picture')} with one reflection of {name}; give "
            f"{LEAST_REFLECTIONS} or more, so dark that only the reflection is white, with the "
            "target at different distances and tilts"
        )
    normals = np.array([pose.rotation[:, 2] for pose in poses])
    places = np.array([pose.position for pose in poses])
    distances = (normals * places).sum(axis=1)

    def mirrored(led: FloatArray) -> FloatArray:
        image: FloatArray = led + 2 * (distances - normals @ led)[:, None] * normals
        return image

    def misfit(led: FloatArray) -> FloatArray:
        image = mirrored(led)
        image[:, 2] = np.maximum(image[:, 2], 1e-4)
        off: FloatArray = (lens.project(image) - pixels).ravel()
        return off

    found = least_squares(misfit, np.zeros(3), x_scale=1e-3)
    rms = float(np.sqrt(2 * found.cost / len(poses)))
    if rms > _LARGEST_RMS or np.linalg.norm(found.x) > _FARTHEST:
        raise RecordError(
            f"the reflections of {name} are not those of one LED (rms {rms:.2g} px); switch the "
            "others and the light of the room off"
        )
    variance = 2 * found.cost / max(found.fun.size - 3, 1)
    jacobian = np.asarray(found.jac)
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
    return found.x, np.sqrt(np.diag(covariance))

"""Whether pictures of a pipe are blurred or veiled, as by a wet or a dirty lens."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve, maximum_filter, uniform_filter

from minorloop.arrays import FloatArray
from minorloop_head.vision.calibrated_camera import Image

CLEAR, BLURRED, VEILED = "clear", "blurred", "veiled"
"""Verdicts on a picture."""
_FINE, _COARSE = 1, 4
"""Half widths in pixels over which slopes are taken."""
_LEAST_RATIO = 1.8
"""Least mean squared slope over few pixels over that over many, of a picture that is not blurred.
In pictures of five simulated pipes it is 2.2 to 5.0, and 0.5 to 1.6 with a blur of 2.5 pixels."""
_MOST_VEIL = 0.25
"""Largest grey of the darkest hundredth of a picture over its mean: the pipe ahead is dark."""
_LIT, _WHITE = 40.0, 250
"""Least grey level of wall whose texture is above the noise, and that of glints."""
_BLOCK, _SHARE, _FEWEST = 48, 0.8, 8
"""Side of a block in pixels, the least share of it that is lit, and fewest such blocks."""
_SECOND = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])
"""Mask without an answer to edges, of which noise of variance 1 has the variance 36."""
_DARK = 2.0
"""Grey level that is added before the logarithm, so that noise in the dark counts little."""


def clarity(image: Image) -> str:
    """Return ``clear``, ``blurred`` or ``veiled``.

    Parameters
    ----------
    image : (height, width) array of uint8
        Along a pipe under all lights, in focus, so that the dark pipe ahead is in it.

    Returns
    -------
    str
        A picture with too little lit wall to tell is ``clear``; one of a wall without texture is
        ``blurred``.

    Notes
    -----
    The wall has texture of all sizes, so that its slopes over few pixels are steeper than over
    many, which a blur ends; the median over blocks counts. Noise is subtracted as estimated by
    Immerkaer, Fast noise variance estimation, 1996. A veil, which is light that the lens scatters,
    brightens the dark.
    """
    grey = np.asarray(image, dtype=np.float64)
    if np.percentile(grey, 1) > _MOST_VEIL * grey.mean():
        return VEILED
    logarithm = np.log(grey + _DARK)
    lit = uniform_filter(grey, 2 * _COARSE + 1) > _LIT
    lit &= ~maximum_filter(np.asarray(image) >= _WHITE, 2 * _COARSE + 1)
    shares = _blocks(lit)
    usable = shares > _SHARE
    if usable.sum() < _FEWEST:
        return CLEAR
    noise = _blocks(convolve(grey, _SECOND) ** 2 / 36 / (grey + _DARK) ** 2)
    fine, coarse = (
        _blocks(_squared_slope(logarithm, half)) - noise / ((2 * half + 1) * half) ** 2
        for half in (_FINE, _COARSE)
    )
    ratio = float(np.median(fine[usable] / np.maximum(coarse[usable], 1e-12)))
    return CLEAR if ratio > _LEAST_RATIO else BLURRED


def _squared_slope(values: FloatArray, half: int) -> FloatArray:
    """Return the squared slope of means over 2 half + 1 pixels, taken over as many as these."""
    means, step = uniform_filter(values, 2 * half + 1), 2 * half
    down = np.zeros_like(values)
    across = np.zeros_like(values)
    down[half:-half] = means[step:] - means[:-step]
    across[:, half:-half] = means[:, step:] - means[:, :-step]
    return np.asarray((down**2 + across**2) / step**2)


def _blocks(values: npt.NDArray[np.generic]) -> FloatArray:
    """Return means over blocks, those at the far edges left out."""
    rows, columns = (size // _BLOCK for size in values.shape)
    part = values[: rows * _BLOCK, : columns * _BLOCK].astype(np.float64)
    return np.asarray(part.reshape(rows, _BLOCK, columns, _BLOCK).mean(axis=(1, 3)))

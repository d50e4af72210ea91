"""Compiled loops that smooth images: arrays in, arrays filled.

`ndimage` computes pixel by pixel in double precision; here a row at once in single precision.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ZERO, MIRROR = 0, 1
"""What is assumed beyond an image: nothing, or its mirror image, with the edge pixel twice."""


def gaussian_shares(sd: float, truncate: float) -> np.ndarray[tuple[int], np.dtype[np.float32]]:
    """Return the middle weight of a Gaussian and those to one side, up to ``truncate`` sd.

    Parameters
    ----------
    sd : float
        In pixels.
    truncate : float
    """
    off = np.arange(int(truncate * sd + 0.5) + 1)
    weights = np.exp(-0.5 * (off / sd) ** 2)
    return (weights / (2 * weights.sum() - weights[0])).astype(np.float32)


@njit(cache=True, nogil=True)
def _inside(i, size, beyond):
    """Return the pixel that counts for pixel i of a row; -1 where nothing does."""
    if 0 <= i < size:
        return i
    if beyond == ZERO:
        return -1
    i = i % (2 * size)
    return min(i, 2 * size - 1 - i)


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add(total, weight, one, other):
    """Add ``weight`` times two rows to a row."""
    for j in range(total.size):
        total[j] += weight * (one[j] + other[j])


@njit(cache=True, nogil=True)
def smooth(image, shares, beyond, out):
    """Fill out (rows, columns) with an image smoothed along both axes; both are float32.

    ``shares`` (n + 1,) are the middle weight and those to one side; ``beyond`` is ZERO or MIRROR.
    """
    rows, columns = image.shape
    reach = shares.size - 1
    total, padded = np.empty(columns, np.float32), np.zeros(columns + 2 * reach, np.float32)
    nothing = np.zeros(columns, np.float32)
    for i in range(rows):
        total[:] = 0.0
        _add(total, shares[0], image[i], nothing)
        for n in range(1, reach + 1):
            up, down = _inside(i - n, rows, beyond), _inside(i + n, rows, beyond)
            if up >= 0 or down >= 0:
                above = image[up] if up >= 0 else nothing
                _add(total, shares[n], above, image[down] if down >= 0 else nothing)
        padded[reach : reach + columns] = total
        for n in range(1, reach + 1):
            left, right = _inside(-n, columns, beyond), _inside(columns - 1 + n, columns, beyond)
            padded[reach - n] = total[left] if left >= 0 else 0.0
            padded[reach + columns - 1 + n] = total[right] if right >= 0 else 0.0
        out[i] = 0.0
        _add(out[i], shares[0], padded[reach : reach + columns], nothing)
        for n in range(1, reach + 1):
            before, after = padded[reach - n :], padded[reach + n :]
            _add(out[i], shares[n], before, after)


def gaussian(
    image: np.ndarray[tuple[int, int], np.dtype[np.float32]],
    sd: float,
    truncate: float,
    beyond: int = MIRROR,
) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    """Return an image smoothed by a Gaussian, to six digits that of ``ndimage.gaussian_filter``.

    Parameters
    ----------
    image : (rows, columns) array of float32
    sd : float
        In pixels.
    truncate : float
        Standard deviations at which it is cut off.
    beyond : int
        ``MIRROR`` or ``ZERO``: what is assumed beyond the image.
    """
    out = np.empty_like(image)
    smooth(np.ascontiguousarray(image), gaussian_shares(sd, truncate), beyond, out)
    return out

"""The wall laid flat: what is known of its depth, how well, and by whom it was seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, as_finite
from minorloop.errors import ParameterError, SignalError
from minorloop.head.geometry import wrapped

STEP = 0.1e-3
UNSEEN, CAMERA, SONAR, BOTH = 0, 1, 2, 3
Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Patch:
    """A rectangle of the wall in even texels.

    Parameters
    ----------
    phi, z : float
        Of the middle of its first texel, in radians and metres.
    rows, columns : int
        Texels along and around the pipe.
    radius : float
        Of the pipe, in metres.
    step : float
        Size of a texel, in metres.

    Raises
    ------
    ParameterError
        If it is empty, or goes round the pipe more than once.
    """

    phi: float
    z: float
    rows: int
    columns: int
    radius: float = 10e-3
    step: float = STEP

    def __post_init__(self) -> None:
        as_finite("phi of a patch", self.phi)
        as_finite("z of a patch", self.z)
        if self.rows < 1 or self.columns < 1 or not (self.step > 0 and self.radius > 0):
            raise ParameterError(
                f"a patch of {self.rows} by {self.columns} texels of {self.step} m is empty"
            )
        if (self.columns - 1) * self.step > 2 * np.pi * self.radius:
            raise ParameterError(
                f"a patch of {self.columns} columns goes round a pipe of radius {self.radius} m "
                "more than once"
            )

    @classmethod
    def around(
        cls, phi: float, z: float, *, size: float, radius: float = 10e-3, step: float = STEP
    ) -> Patch:
        """A square patch of about ``size`` metres about a place."""
        half = round(size / 2 / step)
        count = 2 * half + 1
        return cls(phi - half * step / radius, z - half * step, count, count, radius, step)

    @property
    def places(self) -> FloatArray:
        """(rows, columns, 2) phi and z of the texels."""
        phi = self.phi + np.arange(self.columns) * self.step / self.radius
        z = self.z + np.arange(self.rows) * self.step
        return np.stack(np.broadcast_arrays(phi[None, :], z[:, None]), axis=-1)

    def off(self, phi: float, z: float) -> FloatArray:
        """(rows, columns, 2) metres around and along from a place."""
        places = self.places
        around = wrapped(places[..., 0] - phi)
        return np.stack([self.radius * around, places[..., 1] - z], axis=-1)


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depth of the wall under its nominal radius.

    Parameters
    ----------
    patch : Patch
        Where.
    depth, sd : (rows, columns) arrays
        In metres, with its standard deviation; NaN and infinite where unknown. A depth is
        infinite in a hole that goes through.
    source : (rows, columns) array of uint8
        ``UNSEEN``, ``CAMERA``, ``SONAR`` or ``BOTH``.
    """

    patch: Patch
    depth: FloatArray
    sd: FloatArray
    source: Bytes

    def __post_init__(self) -> None:
        shape = (self.patch.rows, self.patch.columns)
        for name in ("depth", "sd", "source"):
            if getattr(self, name).shape != shape:
                raise SignalError(
                    f"{name} has shape {getattr(self, name).shape}; the patch has {shape}"
                )

    @property
    def unseen(self) -> float:
        """Share of the patch that nothing has seen."""
        return float((self.source == UNSEEN).mean())


def unseen_map(patch: Patch) -> DepthMap:
    """A map of which nothing is known."""
    shape = (patch.rows, patch.columns)
    return DepthMap(
        patch, np.full(shape, np.nan), np.full(shape, np.inf), np.zeros(shape, dtype=np.uint8)
    )


def camera_map(
    patch: Patch, seen: BoolArray, defect: npt.ArrayLike, *, sd: float = 0.05e-3
) -> DepthMap:
    """What a camera tells of depth: the wall is on its cylinder, except where there is a defect.

    Parameters
    ----------
    patch : Patch
        Where.
    seen : (rows, columns) array of bool
        What the camera has seen.
    defect : (rows, columns) array_like
        Probability of a defect, 0 to 1; from 0.5 on the depth is unknown.
    sd : float
        Of the radius of a pipe off nominal, in metres.
    """
    open_to = seen & (np.asarray(defect, dtype=np.float64) < 0.5)
    depth = np.where(open_to, 0.0, np.nan)
    source = np.where(seen, CAMERA, UNSEEN).astype(np.uint8)
    return DepthMap(patch, depth, np.where(open_to, sd, np.inf), source)


def sonar_map(
    patch: Patch,
    spots: npt.ArrayLike,
    depths: npt.ArrayLike,
    sds: npt.ArrayLike,
    *,
    footprint: float = 0.25e-3,
) -> DepthMap:
    """The profile of the wall from echoes along a sweep.

    Parameters
    ----------
    patch : Patch
        Where.
    spots : (K, 2) array_like
        Phi and z of each echo.
    depths, sds : (K,) array_like
        Distance beyond the nominal wall and its standard deviation, in metres; NaN where there
        was no echo.
    footprint : float
        Standard deviation of what one echo speaks for, in metres.

    Notes
    -----
    Means weighted by footprint and inverse variance; texels farther than two footprints from any
    echo stay unseen.
    """
    where = np.asarray(spots, dtype=np.float64).reshape(-1, 2)
    values, widths = np.asarray(depths, dtype=np.float64), np.asarray(sds, dtype=np.float64)
    if not len(where) == values.size == widths.size:
        raise SignalError(f"{len(where)} spots, {values.size} depths, {widths.size} deviations")
    empty = unseen_map(patch)
    weight, total, nearest = (np.zeros_like(empty.depth) for _ in range(3))
    for spot, value, width in zip(where, values, widths, strict=True):
        if not (np.isfinite(value) and np.isfinite(width) and width > 0):
            continue
        square = (patch.off(*spot) ** 2).sum(axis=-1) / footprint**2
        share = np.where(square <= 4, np.exp(-0.5 * square), 0.0)
        weight += share / width**2
        total += share * value / width**2
        nearest = np.maximum(nearest, share)
    told = nearest > 0
    depth = np.divide(total, weight, out=np.full_like(total, np.nan), where=told)
    sd = np.sqrt(np.divide(1.0, weight, out=np.full_like(total, np.inf), where=told))
    return DepthMap(patch, depth, sd, np.where(told, SONAR, UNSEEN).astype(np.uint8))


def blend(first: DepthMap, second: DepthMap) -> DepthMap:
    """Two maps of one patch in one: by inverse variance where both know, by whoever knows else.

    Raises
    ------
    SignalError
        If the patches differ.
    """
    if first.patch != second.patch:
        raise SignalError("the maps are of different patches; lay both out on one")
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = [np.where(np.isnan(m.depth), 0.0, 1 / m.sd**2) for m in (first, second)]
        total = weights[0] + weights[1]
        depth = sum(
            np.where(weight > 0, weight * np.nan_to_num(m.depth, posinf=0.0), 0.0)
            for weight, m in zip(weights, (first, second), strict=True)
        ) / np.where(total > 0, total, np.nan)
        sd = np.where(total > 0, 1 / np.sqrt(total), np.inf)
    through = np.isposinf(first.depth) | np.isposinf(second.depth)
    depth = np.where(through, np.inf, depth)
    source = (first.source | second.source).astype(np.uint8)
    return DepthMap(first.patch, depth, np.where(through, np.nan, sd), source)


def paste(wall: DepthMap, part: DepthMap) -> DepthMap:
    """A map with the texels of another, where it knows something, in place of its own.

    Parameters
    ----------
    wall : DepthMap
        Of the larger patch.
    part : DepthMap
        Of a smaller one; the nearest of its texels counts.
    """
    places, patch = wall.patch.places, part.patch
    middle = patch.phi + 0.5 * (patch.columns - 1) * patch.step / patch.radius
    around = wrapped(places[..., 0] - middle)
    column = np.rint(around * patch.radius / patch.step + 0.5 * (patch.columns - 1)).astype(int)
    row = np.rint((places[..., 1] - patch.z) / patch.step).astype(int)
    inside = (column >= 0) & (column < patch.columns) & (row >= 0) & (row < patch.rows)
    i, j = np.clip(row, 0, patch.rows - 1), np.clip(column, 0, patch.columns - 1)
    inside &= part.source[i, j] != UNSEEN
    depth, sd = (
        np.where(inside, part.depth[i, j], wall.depth),
        np.where(inside, part.sd[i, j], wall.sd),
    )
    source = np.where(inside, part.source[i, j] | wall.source, wall.source)
    return DepthMap(wall.patch, depth, sd, source.astype(np.uint8))


@dataclass(frozen=True)
class WaterLine:
    """The surface of the water in a pipe.

    Parameters
    ----------
    height : float
        As y in the pipe, which points down, in metres: water is where y is larger. NaN where
        nothing was swept.
    sd : float
        Standard deviation, in metres.
    wrong : float
        Share of the echoes that contradict it.
    """

    height: float
    sd: float
    wrong: float

    def wet(self, phi: npt.ArrayLike, radius: float) -> BoolArray:
        """Whether the wall at phi is under water."""
        under: BoolArray = radius * np.sin(np.asarray(phi, dtype=np.float64)) > self.height
        return under


def find_water(
    phi: npt.ArrayLike,
    heard: Sequence[bool] | BoolArray,
    radius: float,
    *,
    face: float | None = None,
) -> WaterLine:
    """The water line from where the wall was heard in a sweep round the pipe.

    Parameters
    ----------
    phi : (K,) array_like
        Where the beam met the wall, in radians.
    heard : (K,) sequence of bool
        Whether the wall answered.
    radius : float
        Of the pipe, in metres.
    face : float, optional
        Distance of the face of the probe from the axis, in metres. A probe hears with its face
        under water only: of water below the axis, the face tells and not the wall.

    Returns
    -------
    WaterLine
        Midway between the highest place heard and the lowest not heard, or at the top or bottom
        of the pipe where all or none was.

    Notes
    -----
    The height with the fewest contradictions, so that a lost echo does not move it.
    """
    up = np.sin(np.asarray(phi, dtype=np.float64).ravel())
    y = np.where(up > 0, radius if face is None else face, radius) * up
    wet = np.asarray(heard, dtype=bool).ravel()
    if y.size != wet.size:
        raise SignalError(f"{y.size} places and {wet.size} answers")
    if y.size == 0:
        return WaterLine(np.nan, np.inf, np.nan)
    order = np.argsort(y)
    y, wet = y[order], wet[order]
    edges = np.concatenate([[-radius], y, [radius]])
    # Contradictions with the line between the n-th place and the next.
    wrong = np.concatenate([[0], np.cumsum(wet)]) + (~wet).sum()
    wrong = wrong - np.concatenate([[0], np.cumsum(~wet)])
    best = np.flatnonzero(wrong == wrong.min())
    n = int(best[len(best) // 2])
    low, high = float(edges[n]), float(edges[n + 1])
    return WaterLine((low + high) / 2, (high - low) / np.sqrt(12), float(wrong[n]) / y.size)

"""A map of the wall from the bursts of a sweep, and the pits, cracks and holes in it (C-scan)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError, cKDTree

from minorloop.arrays import BoolArray, FloatArray
from minorloop_head.geometry import wrapped
from minorloop_head.reconstruction.depth_map import (
    ECHOES,
    UNSEEN,
    DepthMap,
    Patch,
    WaterLine,
    coupled_at,
    find_water,
    unseen_map,
)
from minorloop_head.reconstruction.findings import Finding
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.wall_echoes import (
    BESIDE,
    PULSE,
    Indices,
    SweptBurst,
    WallEchoes,
    beam_width,
    wall_echoes,
)
from minorloop_head.ultrasound.wall_shape import speed_error

PIT, CRACK, CUT = "pit", "crack", "cut by the edge"
NO_ECHO = "no echo: a hole through the wall, or a place without coupling"
_WET = 0.5
"""Least amplitude of the strongest echo of a beam under water, over that of a plain wall: at the
water line, half of the beam is."""
_SURE = 6.0
"""Least deviation of a find, in standard deviations of the texture of the wall on the map."""
_FEWEST = 3
"""Fewest bursts on a surface: fewer are outliers."""
_FLOOR_SD = 4e-6
"""Error of a depth by the envelope alone, in metres, from sweeps of the twin."""
_LOST, _LOST_SURE = 0.1, 3.0
"""Least share of the echo of the wall that a crack takes, and its least ratio to the noise of this
share: four bursts in a row are no chance. A crack of 0.06 mm takes 0.1 midway between two lines."""
_SLENDER, _SHORTEST = 3.0, 1e-3
"""Least length of a crack over its width on the map, and in metres."""
_LEVEL = 0.02e-3
"""Largest difference of the depths on both sides of a crack, in metres."""
_BRIDGED, _CLOSE = 3.0, 0.8
"""Largest distance in widths of the beam between bursts on one crack, on or about one pit, or on a
steep flank and its foot, as sway leaves gaps; and fewest bursts per width along a crack."""
_FAINT = 0.6
"""Amplitude over that of a plain wall below which part of the beam misses the wall."""
_CLOSED, _SMOOTH, _GENTLE = 0.6 * np.pi, 0.04e-3, 0.75
"""Limits of the echoes around a place without any: angle between two of them as seen from its
middle; root mean square of their depths about a plane, in metres; and slope of the plane over that
of a wall without an echo."""
_TOLD, _RAISED = 2, 10e-6
"""Fewest faint echoes at the edge of a place without any that distinguish a bead from a hole, and
least height of their median over the wall in metres: more than the error of a depth by the
envelope."""
_NEAR = 2.0
"""Distance in widths of the beam within which bursts are at the edge of the swept area."""
_PLACE_SD, _SIZE_SD = 0.1e-3, 0.12e-3
"""Standard deviations of place and size of a find in metres, half the distance of bursts."""
_ASTRAY = 1.5
"""Error of a value that changes with the place, in standard deviations of the bursts beside it: its
change over 0.3 mm, the error of the place and the distance of the nearest burst."""


@dataclass(frozen=True)
class EchoFind:
    """A pit, a crack or a place without an echo in the map of a sweep."""

    kind: str
    """``pit`` or ``crack``; ``cut by the edge`` if it may be either or neither: a sweep beyond the
    edge decides; `NO_ECHO` if the level wall around has echoes, and no burst on it has."""
    phi: float
    z: float
    """Centre, in radians and metres; the place of a crack that is nearest to it."""
    diameter: float
    """Diameter in metres of a pit at half its depth, or of a place without an echo; width of a
    crack on the map, which is at least that of the beam."""
    length: float
    """Greatest extent, in metres."""
    depth: float = np.nan
    depth_sd: float = np.nan
    """Depth below the wall beside it, and its standard deviation, in metres; NaN for a place
    without an echo, and for a crack whose floor returns none."""
    bursts: int = 0
    """Number of bursts on it."""
    at_least: bool = False
    """Whether it reaches the edge of the swept area, so that it may be longer."""

    @property
    def place(self) -> tuple[float, float]:
        """Phi and z, about which a raster can be scanned."""
        return self.phi, self.z

    def finding(self, radius: float) -> Finding:
        """Return the find as a finding, in a pipe of a radius."""
        verdict = "swept, at least as long" if self.at_least else "swept"
        return Finding(
            self.kind, verdict, self.phi, _PLACE_SD / radius, self.z, _PLACE_SD, self.diameter,
            _SIZE_SD, self.length, _SIZE_SD, self.depth, self.depth_sd,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class CScan:
    """Map of the flooded wall by a sweep."""

    wall: DepthMap
    """Depth of the strongest echo below the wall; unseen where there is none, in gaps and above the
    water."""
    amplitude: FloatArray
    """Shape (rows, columns). Amplitude of the echo of the wall about a texel over that of a plain
    wall; NaN in gaps and more than the width of the beam above the water."""
    gap: BoolArray
    """Shape (rows, columns). Flooded texels farther than the width of the beam from every burst."""
    water: WaterLine
    """Water line by the places with echoes."""
    finds: tuple[EchoFind, ...]
    """Pits by depth, cracks, then places without an echo; none by a probe without a lens."""
    noise: tuple[float, float]
    """Standard deviations of depth in metres and of amplitude by the texture of this wall, with
    which finds are compared."""


def c_scan(swept: Sequence[SweptBurst], probe: CalibratedProbe, patch: Patch) -> CScan:
    """Map the wall by the bursts of a sweep, and find pits and cracks in it.

    ``swept``: bursts in any order; those with a verdict count as gaps. ``probe``: the probe, and
    its pipe, water and mount. ``patch``: the texels of the map.

    Notes
    -----
    A texel has the echo of the nearest burst. A smooth surface that is steeper than half the
    opening angle of the lens sends no echo back, so that a steeper step between neighbouring bursts
    is an edge. Edges divide the bursts into surfaces; a surface that is deeper than those around it
    is the floor of a pit. A crack weakens the echo of a wall that is flat beside it. Bands of
    depths include that of the speed of sound, which is not corrected by the distance of the wall.
    """
    heard = [one for one in swept if not one.burst.verdict and np.isfinite(one.spot).all()]
    echoes, width = wall_echoes(heard, probe), beam_width(probe)
    face, offset, phi = probe.transducer.face, probe.mount.offset[1], echoes.spots[:, 0]
    # Where there is no wall at all, the usual echo is one of noise.
    answers = np.isfinite(echoes.depth) & (echoes.strongest > _WET)
    water = find_water(phi, answers, probe.radius, face=face, offset=offset, place_sd=_PLACE_SD)
    coupled = coupled_at(phi, probe.radius, face=face, offset=offset) > water.height
    used = np.flatnonzero(coupled & np.isfinite(echoes.amplitude))
    noise = _spread(echoes.texture[used]), _spread(echoes.lost[used])
    _, speed_sd = speed_error(0.0, probe.radius - face)
    around = patch.places[..., 0]
    flooded = water.wet(around, probe.radius) | np.isnan(water.height)
    points = _flat(echoes.spots, patch)
    if used.size < _FEWEST:
        blank = np.full(flooded.shape, np.nan)
        return CScan(unseen_map(patch), blank, flooded, water, (), noise)
    tree = cKDTree(points[used])
    off, found = map(np.asarray, tree.query(_flat(patch.places, patch)))
    nearest, near = used[found], off < width
    # A beam that is partly above the line still has an echo.
    mapped = near & water.wet(around, probe.radius, margin=-width)
    finds: tuple[EchoFind, ...] = ()
    if np.isfinite(probe.transducer.focus):
        on = _Bursts(points, np.where(near, nearest, -1), patch, width)
        steepest = 0.5 * probe.transducer.aperture / probe.transducer.focus
        floors = [
            replace(one, sd=float(np.hypot(one.sd, speed_sd * one.depth)))
            for one in _floors(echoes.depth, used, on, (steepest, noise[0]))
        ]
        clear = used[water.wet(phi[used], probe.radius, margin=2 * width)]
        slender = _slender_groups(echoes, clear, on, noise[1])
        finds = _finds(slender, floors, _silent(echoes, clear, on, steepest), on)
    deep = np.abs(echoes.depth)
    floor = np.hypot(np.where(deep > PULSE, _FLOOR_SD, 0.0), speed_sd * deep)
    depth = echoes.depth
    sd = np.hypot(_astray(depth, echoes, noise[0]), floor)
    seen = mapped & np.isfinite(depth[nearest])
    wall = DepthMap(
        patch,
        np.where(seen, depth[nearest], np.nan),
        np.where(seen, sd[nearest], np.inf),
        np.where(seen, ECHOES, UNSEEN).astype(np.uint8),
    )
    loud = np.where(mapped, echoes.amplitude[nearest], np.nan)
    return CScan(wall, loud, flooded & ~near, water, finds, noise)


def _astray(values: FloatArray, echoes: WallEchoes, noise: float) -> FloatArray:
    """Return the standard deviation (N,) of values at the places of bursts.

    It contains the noise and the change of values with the place, as at a rim.
    """
    beside = values[echoes.near[:, :BESIDE]]
    known = np.isfinite(beside)
    mean = np.where(known, beside, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    square = np.where(known, beside - mean[:, None], 0.0) ** 2
    change = np.sqrt(square.sum(axis=1) / np.maximum(known.sum(axis=1), 1))
    return np.asarray(np.hypot(_ASTRAY * change, noise))


@dataclass(frozen=True, eq=False)
class _Bursts:
    """Points (N, 2) of bursts on the flat wall, and the nearest to each texel, -1 in a gap."""

    points: FloatArray
    nearest: Indices
    patch: Patch
    width: float

    def neighbours(self, chosen: Indices, reach: float = 2.0) -> Indices:
        """Return pairs (E, 2) of chosen bursts that are neighbours, within a number of widths."""
        try:
            corners = Delaunay(self.points[chosen]).simplices
        except (QhullError, ValueError):  # too few, or on one line
            return np.empty((0, 2), dtype=np.intp)
        pairs = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
        edges = chosen[np.unique(np.sort(pairs, axis=1), axis=0)]
        return np.asarray(edges[self.apart(edges) <= reach * self.width])

    def pairs(self, chosen: Indices) -> Indices:
        """Return pairs (E, 2) of chosen bursts that are near enough to be on one crack."""
        near = cKDTree(self.points[chosen]).query_pairs(
            _BRIDGED * self.width, output_type="ndarray"
        )
        return np.asarray(chosen[near])

    def apart(self, edges: Indices) -> FloatArray:
        """Return the lengths (E,) of edges, in metres."""
        between = self.points[edges[:, 0]] - self.points[edges[:, 1]]
        return np.asarray(np.linalg.norm(between, axis=1))

    def slender(self, members: Indices) -> bool:
        """Return whether bursts are close together on a long and narrow part."""
        one = self.find(CRACK, members)
        return (
            one is not None
            and len(members) >= max(_FEWEST, _CLOSE * one.length / self.width)
            and one.length > max(_SHORTEST, _SLENDER * max(one.diameter, self.width))
        )

    def cut(self, members: Indices) -> bool:
        """Return whether most of some bursts are at the edge of the swept area."""
        return bool(np.mean(self.from_edge(members) < _NEAR * self.width) > 0.5)

    def closed(self, members: Indices, rim: Indices) -> bool:
        """Return whether bursts of a rim are on all sides of the middle of some bursts."""
        way = self.points[rim] - self.points[members].mean(axis=0)
        around = np.sort(np.arctan2(way[:, 1], way[:, 0]))
        gaps = np.diff(around, append=around[0] + 2 * np.pi)
        return bool(gaps.max() < _CLOSED)

    def plane(self, members: Indices, depth: FloatArray) -> tuple[float, float]:
        """Return slope and root mean square of depths (N,) of some bursts about their plane."""
        plane = self._plane(members, depth[members])
        return float(np.hypot(*plane[:2])), float(self._off(plane, members, depth).std())

    def raised(self, members: Indices, around: Indices, depth: FloatArray) -> float:
        """Return the median height of some bursts over the plane through others, in metres."""
        plane = self._plane(around, depth[around])
        return -float(np.median(self._off(plane, members, depth)))

    def _plane(self, members: Indices, depth: FloatArray) -> FloatArray:
        """Return the slopes and the constant (3,) of the plane through depths (N,)."""
        places = np.column_stack([self.points[members], np.ones(len(members))])
        return np.asarray(np.linalg.lstsq(places, depth)[0])

    def _off(self, plane: FloatArray, members: Indices, depth: FloatArray) -> FloatArray:
        """Return the depths of some bursts below a plane, in metres."""
        return np.asarray(depth[members] - self.points[members] @ plane[:2] - plane[2])

    def from_edge(self, members: Indices) -> FloatArray:
        """Return the distances (N,) of some bursts from the edge of the swept area, in metres."""
        points, low, high = self.points[members], self.points.min(axis=0), self.points.max(axis=0)
        return np.asarray(np.minimum(points - low, high - points).min(axis=1))

    def within(self, others: Indices, reach: float) -> BoolArray:
        """Return which bursts (N,) are within a distance of others."""
        if not others.size:
            return np.zeros(len(self.points), dtype=bool)
        return np.asarray(cKDTree(self.points[others]).query(self.points)[0] <= reach)

    def beside(self, members: Indices, others: Indices) -> bool:
        """Return whether most of some bursts are near others."""
        off = cKDTree(self.points[others]).query(self.points[members])[0]
        return bool(np.mean(off < _BRIDGED * self.width) > 0.5)

    def left(self, members: Indices, edges: Indices) -> BoolArray:
        """Return which edges (E, 2) lead to the left of the line through bursts."""
        points = self.points[members]
        across = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][1]
        way = self.points[edges[:, 1]] - self.points[edges[:, 0]]
        return np.asarray(way @ across > 0)

    def groups(self, edges: Indices) -> Indices:
        """Return the number (N,) of the group of each burst, which edges connect."""
        count = len(self.points)
        ones = np.ones(len(edges))
        graph = coo_matrix((ones, (edges[:, 0], edges[:, 1])), shape=(count, count))
        return np.asarray(connected_components(graph, directed=False)[1])

    def find(self, kind: str, members: Indices, **more: float) -> EchoFind | None:
        """Return the texels nearest to some bursts as a find; None if there are none.

        At the edge of the swept area its kind is unknown.
        """
        texels = self.patch.places[np.isin(self.nearest, members)]
        if not len(texels):
            return None
        flat = _flat(texels, self.patch)
        middle = flat.mean(axis=0)
        spread = np.linalg.svd(flat - middle, compute_uv=False) / np.sqrt(len(flat))
        length = float(np.sqrt(12) * spread[0]) + self.patch.step  # of an even line
        area = len(texels) * self.patch.step**2
        diameter = 2 * np.sqrt(area / np.pi)
        if kind == CRACK:  # the middle of an arch is beside it
            middle = flat[np.argmin(np.linalg.norm(flat - middle, axis=1))]
        phi = _middle(self.patch) + middle[0] / self.patch.radius
        return EchoFind(
            CUT if self.cut(members) else kind,
            float(wrapped(phi)),
            float(middle[1]),
            float(area / length if kind == CRACK else diameter),
            float(length if kind == CRACK else diameter),
            bursts=len(members),
            at_least=kind == CRACK and bool((self.from_edge(members) < self.width).any()),
            **more,
        )


@dataclass(frozen=True, eq=False)
class _Floor:
    """Bursts on a floor, its depth below the wall beside it, and its standard deviation."""

    members: Indices
    depth: float
    sd: float


def _floors(
    depth: FloatArray, used: Indices, on: _Bursts, limits: tuple[float, float]
) -> list[_Floor]:
    """Return the surfaces that are deeper than those beyond their edges, and than the pipe.

    The wall about a bead is deeper than its top, but no floor. ``limits`` are the steepest slope
    without an edge and the noise of depths.
    """
    steepest, noise = limits
    heard = used[np.isfinite(depth[used])]
    edges = on.neighbours(heard)
    steep = _steep(depth, edges, on, steepest)
    surface = on.groups(edges[~steep])
    large = np.bincount(surface)[surface] >= _FEWEST
    rim = np.concatenate([edges[steep], edges[steep][:, ::-1]])
    rim = rim[large[rim].all(axis=1)]
    drop = depth[rim[:, 0]] - depth[rim[:, 1]]
    least = max(_SURE * noise, PULSE)
    inner = surface[rim[:, 0]]
    sunk = [k for k in np.unique(inner) if np.median(depth[surface == k]) > 0.5 * least]
    deep = [k for k in sunk if (drop[inner == k] > least).mean() > 0.5]
    floor = np.isin(surface, deep)
    # Join floors that touch, and the parts of a floor on both sides of a gap between lines.
    over = on.neighbours(heard, _BRIDGED)
    over = np.concatenate([edges, over[~_steep(depth, over, on, steepest)]])
    whole = on.groups(over[floor[over].all(axis=1)])
    found = []
    for k in np.unique(whole[floor]):
        members = np.flatnonzero(whole == k)
        beside = np.unique(rim[(whole[rim[:, 0]] == k) & ~floor[rim[:, 1]], 1])
        if beside.size:
            below = float(np.median(depth[members]) - np.median(depth[beside]))
            sd = float(np.hypot(_spread(depth[members]) / np.sqrt(len(members)), _FLOOR_SD))
            found.append(_Floor(members, below, sd))
    return found


def _steep(depth: FloatArray, edges: Indices, on: _Bursts, steepest: float) -> BoolArray:
    """Return which edges (E, 2) are steeper than a surface that sends an echo back."""
    fall = depth[edges[:, 1]] - depth[edges[:, 0]]
    return np.asarray(np.abs(fall) > steepest * np.maximum(on.apart(edges), on.width))


def _slender_groups(echoes: WallEchoes, used: Indices, on: _Bursts, noise: float) -> list[Indices]:
    """Return groups of bursts that are long and narrow, on which a flat wall lacks echo.

    The wall on both sides of each is level, unless the edge cuts it.
    """
    short = echoes.lost > max(_LOST_SURE * noise, _LOST)
    # The foot of a steep flank lacks echo too.
    flank = on.within(used[echoes.scattered[used]], _BRIDGED * on.width)
    lost = np.isin(np.arange(len(short)), used) & echoes.flat & short & ~flank
    group = on.groups(on.pairs(np.flatnonzero(lost)))
    edges = on.neighbours(used)
    rim = np.concatenate([edges, edges[:, ::-1]])
    rim = rim[lost[rim[:, 0]] & ~short[rim[:, 1]] & np.isfinite(echoes.depth[rim[:, 1]])]
    found = []
    for k in np.unique(group[lost]):
        members, beside = np.flatnonzero((group == k) & lost), rim[group[rim[:, 0]] == k]
        if on.slender(members):
            left = on.left(members, beside)
            sides = [echoes.depth[beside[side, 1]] for side in (left, ~left) if side.any()]
            if on.cut(members) or (
                len(sides) == 2 and abs(np.median(sides[0]) - np.median(sides[1])) < _LEVEL
            ):
                found.append(members)
    return found


def _silent(echoes: WallEchoes, used: Indices, on: _Bursts, steepest: float) -> list[Indices]:
    """Return groups of bursts without an echo, where the wall around them has one.

    A burst in a group has no echo and no neighbour with one, so that single lost bursts form no
    group. At the rim of a hole the beam is partly on the wall, and the echo is faint; on a slope
    all echoes are faint, so that bursts without echo are examined first. A plane through the wall
    around would have an echo, unlike the flank of a dent.
    """
    silent = np.isnan(echoes.depth)
    edges = on.neighbours(used)
    both = np.concatenate([edges, edges[:, ::-1]])
    found: list[Indices] = []
    for quiet in (silent, silent | (echoes.strongest < _FAINT)):
        inner = np.setdiff1d(both[silent[both[:, 0]], 0], both[~quiet[both[:, 1]], 0])
        group = on.groups(edges[quiet[edges].all(axis=1)])
        for k in np.unique(group[inner]):
            members = np.flatnonzero(group == k)
            rim = np.unique(both[(group[both[:, 0]] == k) & ~quiet[both[:, 1]], 1])
            near = np.union1d(members, rim)
            new = not any(np.isin(one, members).any() for one in found)
            if new and min(rim.size, members.size) >= _FEWEST and on.closed(members, rim):
                slope, rough = on.plane(rim, echoes.depth)
                if slope < _GENTLE * steepest and rough < _SMOOTH and not _bead(echoes, near, on):
                    found.append(members)
    return found


def _bead(echoes: WallEchoes, members: Indices, on: _Bursts) -> bool:
    """Return whether faint echoes at the edge of a place without any are from above the wall.

    These come from the foot of a bead, whose flanks reflect the beam elsewhere. About a hole, the
    wall beside it echoes there.
    """
    heard = np.isfinite(echoes.depth)
    faint = heard & (echoes.strongest < _FAINT)
    foot = members[faint[members]]
    around = on.within(members, _BRIDGED * on.width) & heard & ~faint
    around[members] = False
    if foot.size < _TOLD or around.sum() < _FEWEST:
        return False
    return on.raised(foot, np.flatnonzero(around), echoes.depth) > _RAISED


def _finds(
    slender: Sequence[Indices], floors: Sequence[_Floor], silent: Sequence[Indices], on: _Bursts
) -> tuple[EchoFind, ...]:
    """Return floors as pits, cracks with the depth of the floors in them, and silent places."""
    inside = [
        [one for one in floors if np.isin(one.members, members).mean() > 0.5] for members in slender
    ]
    pits = [one for one in floors if not any(one in each for each in inside)]
    pits.sort(key=lambda one: -one.depth)
    finds = [on.find(PIT, one.members, depth=one.depth, depth_sd=one.sd) for one in pits]
    for members, own in zip(slender, inside, strict=True):
        most = max(own, key=lambda one: len(one.members), default=None)
        known = {} if most is None else {"depth": most.depth, "depth_sd": most.sd}
        if not any(on.beside(members, one.members) for one in pits):
            finds.append(on.find(CRACK, members, **known))
    told = [*slender, *(one.members for one in floors)]
    for members in silent:
        if not any(on.beside(members, other) for other in told):
            finds.append(on.find(NO_ECHO, members))
    return tuple(find for find in finds if find is not None)


def _middle(patch: Patch) -> float:
    return patch.phi + 0.5 * (patch.columns - 1) * patch.step / patch.radius


def _flat(places: FloatArray, patch: Patch) -> FloatArray:
    """Return places (..., 2) on the flat wall, in metres around from the middle and along."""
    around = patch.radius * wrapped(places[..., 0] - _middle(patch))
    return np.stack([around, places[..., 1]], axis=-1)


def _spread(values: FloatArray) -> float:
    """Return the standard deviation of most finite values, by their median deviation."""
    known = values[np.isfinite(values)]
    return 1.4826 * float(np.median(np.abs(known - np.median(known)))) if known.size else np.nan

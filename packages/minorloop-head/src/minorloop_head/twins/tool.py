"""A simulated micro-tool on the head: it extends until it touches the wall, and leaves a mark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from minorloop.arrays import as_finite
from minorloop.errors import LimitError, ParameterError
from minorloop_head.geometry import Mount, Tool, wrapped
from minorloop_head.twins.mounted import Mounted
from minorloop_head.twins.pipe import Bore, Dirt, Pipe

RATE = 10e-3
"""Rate of the extension, in m/s."""
_MARK_RADIUS, _MARK_ALBEDO = 0.15e-3, 0.35
"""Radius of a mark in metres, and its albedo relative to the metal: a dot of ink."""
_SPREAD, _TILT = 0.2e-3, 0.01
_KNOWN, _KNOWN_TILT = 0.03e-3, 1.5e-3
"""Standard deviations of offset (metres) and slope: of a specimen, and of what is known of it. A
calibration against a target does as well."""


class MicroTool(Mounted):
    """A pen beside the lens.

    Parameters
    ----------
    pipe : Pipe
    mount : Mount, optional
        Place of the head in the pipe; on the axis without it.
    tool : Tool, optional
        As designed.
    specimen : int, optional
        Seed of a specimen, which differs from the design and is calibrated; the design without it.
    """

    def __init__(
        self,
        pipe: Pipe,
        mount: Mount | None = None,
        tool: Tool | None = None,
        *,
        specimen: int | None = None,
    ) -> None:
        super().__init__(mount)
        self.pipe = pipe
        design = tool or Tool()
        self._tool, self.calibration = _specimen(design, specimen)
        self._extension = self._wanted = 0.0
        self.touching = False
        self.touches: list[tuple[float, float]] = []
        self.marks: list[tuple[float, float]] = []

    @property
    def extension(self) -> float:
        """Extension now, in metres."""
        return self._extension

    def extend(self, length: float) -> None:
        """Extend to a length in metres, or until the point touches the wall.

        Raises
        ------
        LimitError
            If the length is not from 0 to the longest.
        """
        if not 0 <= as_finite("extension of the tool", length) <= self._tool.longest:
            raise LimitError(
                f"extension {length} m is beyond the limits [0, {self._tool.longest:g}] m"
            )
        self._wanted = float(length)

    def _advance(self, seconds: float) -> None:
        """Move the point: towards what is wanted, and never through the wall."""
        super()._advance(seconds)
        if not (self._extension or self._wanted or self.touching):
            return  # withdrawn: where it would meet the wall does not matter
        most = seconds * RATE
        moved = self._extension + float(np.clip(self._wanted - self._extension, -most, most))
        phi, z, free = self._met()
        was, self.touching = self.touching, moved >= free
        self._extension = min(moved, free)
        if not self.touching or was:
            return
        self.touches.append((phi, z))
        if self._bore_at(phi, z) is None:
            self.marks.append((phi, z))
            dot = Dirt(phi, z, _MARK_RADIUS, _MARK_ALBEDO, softness=0.03e-3, raggedness=0.0)
            self.pipe = replace(self.pipe, dirt=(*self.pipe.dirt, dot))

    def _met(self) -> tuple[float, float, float]:
        """Return phi and z at which the way meets the wall, and the extension to what it meets."""
        try:
            phi, z, length = self._tool.meet(
                self._mount, self._pan, self._tilt, self.pipe.radius
            ).tolist()
        except ParameterError:
            return 0.0, 0.0, 0.0
        bore = self._bore_at(phi, z)
        return phi, z, length + (0.0 if bore is None else bore.depth)

    def _bore_at(self, phi: float, z: float) -> Bore | None:
        for bore in self.pipe.bores:
            off = np.hypot(self.pipe.radius * float(wrapped(phi - bore.phi)), z - bore.z)
            if off < bore.diameter / 2:
                return bore
        return None

    def _place(self) -> tuple[float, float]:
        """Return phi and z at which the tool would touch the wall now. For scoring only."""
        phi, z, _ = self._met()
        return phi, z


def _specimen(design: Tool, specimen: int | None) -> tuple[Tool, Tool]:
    """Return the true tool, and the calibrated one."""
    if specimen is None:
        return design, design
    rng = np.random.default_rng([specimen, 61])
    true = _changed(design, rng, _SPREAD, _TILT)
    return true, _changed(true, rng, _KNOWN, _KNOWN_TILT)


def _changed(tool: Tool, rng: np.random.Generator, spread: float, tilt: float) -> Tool:
    x, y, z = (np.array(tool.offset) + rng.normal(0, spread, 3)).tolist()
    right, down = (np.array(tool.slope) + rng.normal(0, tilt, 2)).tolist()
    return replace(tool, offset=(x, y, z), slope=(right, down))

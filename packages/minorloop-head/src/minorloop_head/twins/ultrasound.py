"""A simulated ultrasonic probe on the head in a flooded pipe.

The disc, with a fixed lens or without, is 5 mm wide and less than 10 mm from the wall: it works
in its near field, where an echo is an integral over the wall. A loop is::

    twin = Ultrasound(Pipe.draw(3, pits=1, water=-9.9e-3))
    twin.look(0.44, 0.0)      # radians; where the head is now
    shot = twin.shot()        # 2048 samples at 100 MHz, then 1 ms has passed
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import LimitError, ParameterError
from minorloop_head.geometry import Mount, Probe, meet_wall, wall_point, wrapped
from minorloop_head.sources import Shot
from minorloop_head.twins import _echo_kernels as kernels
from minorloop_head.twins.beam_field import Beam, beam_of
from minorloop_head.twins.mounted import Mounted
from minorloop_head.twins.pipe import Bore, Crack, Pipe
from minorloop_head.twins.pit_echo import CrackBasis, PitBasis, basis_of, basis_of_crack
from minorloop_head.twins.sensor import SimulatedFault
from minorloop_head.twins.surroundings import ATMOSPHERE

_SAMPLE_INTERVAL = 10e-9  # s
SAMPLES = 2048
"""Samples of a shot: 20 us, the way to a wall 15 mm away and back."""
INTERVAL = 1e-3  # s, between pulses
_WATER_TO_STEEL = 0.938  # reflection coefficient
FULL_SCALE = 1.0
"""Largest amplitude of the converter, which is the unit of a trace."""
_RESOLUTION = 0.125e6  # of the spectrum, in Hz: echoes of one shot last 8 us
_LOWEST, _HIGHEST = 2e6, 18e6  # Hz
_LEAD = 1e-6  # s before the first echo
_FACET = 0.03e-3  # m, a fifth of a wavelength at 10 MHz
_CELL = 0.12e-3  # m, of the roughness
_RIM = 24  # places on the rim of a pit that give its plane: it is 3 mm long, a dent 1 mm wide
_STEEL = 5900.0  # m/s, of longitudinal waves
_STEPS = 4096  # of the converter, from -FULL_SCALE to FULL_SCALE
_SETTINGS = {"frequency": 10e6, "bandwidth": 0.6, "skew": 0.0, "steel": _STEEL, "loss": 0.75}

_Spectrum = npt.NDArray[np.complex128]
_Features = tuple[FloatArray, FloatArray]


class Ultrasound(Mounted):
    """Pulse and echo of a disc in a flooded metal pipe.

    Raises a `ParameterError` if an option is out of its range.

    ``pipe``: the pipe with its defects. Only the wall under water gives echoes, and only while the
    face of the probe is under water.
    ``mount``: place of the head in the pipe.
    ``probe``: the disc, its lens, and its place on the head.
    ``specimen``: seed of a specimen: frequency, bandwidth, phase of the pulse, focal length,
    direction of the beam, sound speed of the steel and loss in it are drawn about nominal. Without
    it, the nominal probe.
    ``seed``: seed of the noise, the roughness and the grains.
    ``noise``: standard deviation of a sample, as a share of the peak of the echo of a plain wall.
    ``temperature``, ``pressure``: of the water, in degrees Celsius and Pa: the speed of sound
    follows from them.
    ``gain``: as in `amplify`.
    ``roughness``: standard deviation of the height of the wall, in metres.
    ``grain``: amplitude of the echoes of grains under the wall, as a share of that of the wall.
    ``faults``: times in which traces are ``lost`` (flat) or ``stuck`` (the last one), channel
    ``echo``.
    ``settle``: spectra are computed again only if face or spot have moved farther than this, in
    metres; 0 computes each.

    Notes
    -----
    By reciprocity, the echo is the integral of 2 p dp/dn over the wall, with p from the angular
    spectrum of the disc. In pits, waves travel between rigid walls to a floor of any shape and
    back; in cracks, between flat ones. Behind every surface the steel rings with the reflection
    at its outer face in air. Through-holes end in water.
    """

    kind = "ultrasound"

    def __init__(
        self,
        pipe: Pipe,
        mount: Mount | None = None,
        probe: Probe | None = None,
        *,
        specimen: int | None = None,
        seed: int = 0,
        noise: float = 0.1,
        temperature: float = 20.0,
        pressure: float = ATMOSPHERE,
        gain: float = 0.5,
        roughness: float = 0.5e-6,
        grain: float = 0.01,
        faults: Sequence[SimulatedFault] = (),
        settle: float = 4e-6,
    ) -> None:
        for name, value in (("noise", noise), ("roughness", roughness), ("grain", grain)):
            if not as_finite(name, value) >= 0:
                raise ParameterError(f"{name} of the probe is {value}; give a number >= 0")
        self.probe = probe or Probe()
        super().__init__(mount)
        self._pipe = pipe
        self._speed = _speed_of_sound(temperature, pressure)
        self._noise, self._faults, self._settle = noise, tuple(faults), float(settle)
        self._rng = np.random.default_rng([seed, 2])
        self._settings, self._true_probe, self._boresight = _specimen(self.probe, specimen)
        self._surface = _surface(np.random.default_rng([seed, 3]), roughness, grain)
        self.amplify(gain)
        self._kept: tuple[FloatArray, FloatArray, FloatArray] | None = None
        self._before: FloatArray | None = None
        self._prepare()

    def wait(self, seconds: float) -> None:
        """Advance the clock without a pulse; the head continues to turn.

        Raises a `ParameterError` if the time is negative.
        """
        if not as_finite("a wait", seconds) >= 0:
            raise ParameterError(f"a wait of {seconds} s; give a time >= 0")
        self._advance(seconds)

    def amplify(self, gain: float) -> None:
        """Set the peak of the echo of a plain wall as a share of full scale.

        Raises a `LimitError` if the gain is not from 0.001 to 100.
        """
        if not 1e-3 <= gain <= 100:
            raise LimitError(f"gain {gain} is beyond the limits [0.001, 100]; nothing was changed")
        self._gain = float(gain)

    def shot(self) -> Shot:
        """Fire one pulse and record 20 us."""
        clean = self._ring_down + self._echo()
        noisy = clean + self._noise * self._rng.standard_normal(SAMPLES)
        half = _STEPS // 2
        counts = np.round(np.clip(self._gain * noisy / FULL_SCALE, -1.0, 1.0) * half)
        trace: FloatArray = np.clip(counts, -half, half - 1) * (FULL_SCALE / half)
        trace = self._with_faults(trace)
        shot = Shot(self._clock, trace, _SAMPLE_INTERVAL)
        self._before = trace
        self.wait(INTERVAL)
        return shot

    def _with_faults(self, trace: FloatArray) -> FloatArray:
        for fault in self._faults:
            if fault.channel == "echo" and fault.at <= self._clock < fault.until:
                if fault.kind == "lost":
                    return np.zeros_like(trace)
                return trace if self._before is None else self._before
        return trace

    def _prepare(self) -> None:
        """Prepare the constants of all shots."""
        self._frequencies = np.arange(_LOWEST, _HIGHEST + 1.0, _RESOLUTION)
        self._k = 2 * np.pi * self._frequencies / self._speed
        radius, probe = self._pipe.radius, self._true_probe
        self._reach = 1.6e-3 if np.isfinite(probe.focus) else 0.5 * probe.aperture + 1.4e-3
        stand_off = radius - probe.face
        self._beam: Beam = beam_of(
            probe.aperture, probe.focus, self._k,
            near=stand_off - 2e-3, far=stand_off + 1.6e-3, off=self._reach + 0.8e-3,
        )  # fmt: skip
        self._parts = _parts(self._beam.table)
        self._features = _features(self._pipe)
        pits = [bore for bore in self._pipe.bores if not bore.through]
        self._bases: list[PitBasis] = [basis_of(pit, radius, self._k[-1]) for pit in pits]
        self._pits: list[Bore] = pits
        self._mouths = [self._mouth(pit) for pit in pits]
        self._courses = [basis_of_crack(crack, radius) for crack in self._pipe.cracks]
        self._ring_down = _ring_down(self._settings["frequency"])
        self._scale = 1.0
        plain = Pipe(radius=radius, thickness=self._pipe.thickness)
        squarely = np.array([radius - stand_off, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
        quiet = (self._surface[0], 0.0 * self._surface[1], 0.0)
        spectrum = self._pulse() * self._wall(*squarely, _features(plain), quiet, -np.inf)[0]
        self._scale = 1 / np.abs(self._to_time(spectrum, 2 * stand_off / self._speed)).max()

    def _mouth(self, pit: Bore) -> FloatArray:
        """Return the plane (3,) through the rim of a pit: depth in its middle, and two slopes.

        The slopes are around and along the pipe. A pit in a dent begins where the wall is.
        """
        turn = 2 * np.pi * np.arange(_RIM) / _RIM
        x, y = 0.5 * pit.diameter * np.cos(turn), 0.5 * pit.diameter * np.sin(turn)
        smooth, dents = (np.zeros((1, 1)), 1.0, 0.0), self._features[1]
        rim = [
            -kernels.height_at(pit.phi + a / self._pipe.radius, pit.z + b, self._pipe.radius,
                               *smooth, dents)
            for a, b in zip(x.tolist(), y.tolist(), strict=True)
        ]  # fmt: skip
        plane = np.linalg.lstsq(np.stack([np.ones(_RIM), x, y], axis=1), rim, rcond=None)[0]
        return np.asarray(plane, dtype=np.float64)

    def _pulse(self) -> _Spectrum:
        """Return the spectrum of the pulse there and back, reflected by steel in water."""
        set_ = self._settings
        width = set_["bandwidth"] * set_["frequency"] / 2 / np.sqrt(2 * np.log(2))
        off = (self._frequencies - set_["frequency"]) / width
        pulse: _Spectrum = _WATER_TO_STEEL * np.exp(-0.5 * off**2 + 1j * set_["skew"] * off**2)
        water = 10 ** (-0.022e3 * (self._frequencies / 10e6) ** 2 / 20)
        return pulse * water ** (2 * (self._pipe.radius - self.probe.face))

    def _steel(self, thickness: float) -> _Spectrum:
        """Return the ringing of the steel behind a surface, as a share of its echo."""
        if thickness <= 0:
            return np.zeros(len(self._frequencies), dtype=np.complex128)
        loss = self._settings["loss"] * 10 ** (-0.1e3 * 2 * thickness / 20)
        turn = np.exp(4j * np.pi * self._frequencies * thickness / self._settings["steel"])
        first = -(1 - _WATER_TO_STEEL**2) / _WATER_TO_STEEL
        ringing: _Spectrum = first * loss * turn / (1 - _WATER_TO_STEEL * loss * turn)
        return ringing

    def _wall(
        self,
        origin: FloatArray,
        axis: FloatArray,
        features: _Features,
        surface: tuple[FloatArray, FloatArray, float],
        water: float,
    ) -> tuple[_Spectrum, _Spectrum]:
        """Return the integral (F,) over the wall, and the echo of the grains under it."""
        texture, grains, rough = surface
        bores, dents = features
        out = np.zeros(len(self._k), dtype=np.complex128)
        extra = np.zeros_like(out)
        kernels.echo_of_wall(
            self._parts, self._beam.grid, self._k[0], self._k[1] - self._k[0], origin, axis,
            self._pipe.radius, self._reach, _FACET, water, bores, dents, texture,
            grains, _CELL, rough, self._stand_off, out, extra,
        )  # fmt: skip
        return out, extra

    @property
    def _stand_off(self) -> float:
        """Distance from the face to the wall at right angles, in metres."""
        return self._pipe.radius - self.probe.face

    def _echo(self) -> FloatArray:
        """Return the trace without noise, computed again if the head has moved."""
        origin, axis = self._true_probe.beam(
            self._mount, self._pan + self._boresight[0], self._tilt + self._boresight[1]
        )
        water = -np.inf if self._pipe.water is None else self._pipe.water
        if self._pipe.water is None or origin[1] < water:
            return np.zeros(SAMPLES)
        if self._kept is not None:
            old_origin, old_axis, trace = self._kept
            moved = np.linalg.norm(origin - old_origin)
            turned = self._stand_off * np.linalg.norm(axis - old_axis)
            if max(moved, turned) < self._settle:
                return trace
        spectrum = self._spectrum(origin, axis, water)
        trace = self._to_time(spectrum, 2 * self._stand_off / self._speed)
        self._kept = (origin, axis, trace)
        return trace

    def _spectrum(self, origin: FloatArray, axis: FloatArray, water: float) -> _Spectrum:
        wall, grain = self._wall(origin, axis, self._features, self._surface, water)
        received = wall * (1 + self._steel(self._pipe.thickness)) + grain
        for pit, basis, mouth in zip(self._pits, self._bases, self._mouths, strict=True):
            received += self._floor(pit, basis, mouth, origin, axis, water)
        for crack, course in zip(self._pipe.cracks, self._courses, strict=True):
            received += self._crack(crack, course, origin, axis, water)
        spectrum: _Spectrum = received * self._pulse()
        return spectrum

    def _crack(
        self, crack: Crack, course: CrackBasis, origin: FloatArray, axis: FloatArray, water: float
    ) -> _Spectrum:
        """Return the echo of the floor of a crack, less that of the missing wall over it."""
        spot_phi, spot_z, _ = meet_wall(origin, axis, self._pipe.radius)
        part = course.near(spot_phi, spot_z, self._pipe.radius, self._reach)
        part = part[course.points[part][..., 1].max(axis=1, initial=-np.inf) >= water]
        if part.size == 0:
            return np.zeros(len(self._k), dtype=np.complex128)
        points = np.ascontiguousarray(course.points[part].reshape(-1, 3))
        mouth = self._pressure(points, origin, axis).reshape(len(self._k), part.size, -1)
        thickness = self._pipe.thickness
        # Without a floor, only the wall over it is missing.
        depths = (0.0, crack.depth) if crack.depth < thickness else (0.0,)
        wall, *floor = course.echo(mouth, part, self._k, *depths)
        change: _Spectrum = -wall * (1 + self._steel(thickness))
        for echo in floor:
            change += echo * (1 + self._steel(thickness - crack.depth))
        return change

    def _floor(
        self,
        pit: Bore,
        basis: PitBasis,
        mouth: FloatArray,
        origin: FloatArray,
        axis: FloatArray,
        water: float,
    ) -> _Spectrum:
        """Return the echo of the floor of a pit with a plane mouth (3,), if the beam is near.

        A pit is full of water if most of its mouth is under water.
        """
        radius = self._pipe.radius
        spot_phi, spot_z, _ = meet_wall(origin, axis, radius)
        far = np.hypot(radius * float(wrapped(spot_phi - pit.phi)), spot_z - pit.z)
        x, y = basis.places.T
        dry = radius * np.sin(pit.phi + x / radius) < water
        if far > self._reach + pit.diameter / 2 or basis.weights @ dry > basis.weights @ ~dry:
            return np.zeros(len(self._k), dtype=np.complex128)
        normal = np.array([np.cos(pit.phi), np.sin(pit.phi), 0.0])
        around = np.array([-normal[1], normal[0], 0.0])
        centre = wall_point(pit.phi, pit.z, radius)
        sunk = mouth[0] + mouth[1] * x + mouth[2] * y
        flat = x[:, None] * around + y[:, None] * np.array([0.0, 0.0, 1.0])
        points = centre + flat + sunk[:, None] * normal
        under = self._steel(self._pipe.thickness - pit.depth)
        pressure = self._pressure(points, origin, axis)
        floor: _Spectrum = basis.echo(pressure, self._k) * (1 + under)
        return floor

    def _pressure(self, points: FloatArray, origin: FloatArray, axis: FloatArray) -> _Spectrum:
        """Return the pressure (F, N) of the beam at points (N, 3)."""
        pressure = np.empty((len(self._k), len(points)), dtype=np.complex128)
        kernels.pressure_at(
            self._beam.table, self._beam.grid, self._k[0], self._k[1] - self._k[0], origin, axis,
            self._stand_off, points, pressure,
        )  # fmt: skip
        return pressure

    def _to_time(self, spectrum: _Spectrum, at: float) -> FloatArray:
        """Return the trace (T,) of a spectrum whose phases count from time ``at``."""
        count = round(1 / (_RESOLUTION * _SAMPLE_INTERVAL))
        first = int((at - _LEAD) / _SAMPLE_INTERVAL)
        early = first * _SAMPLE_INTERVAL - at
        bins = np.zeros(count // 2 + 1, dtype=np.complex128)
        start = round(_LOWEST / _RESOLUTION)
        turned = spectrum * np.exp(-2j * np.pi * self._frequencies * early)
        bins[start : start + len(spectrum)] = np.conj(turned)
        piece = np.fft.irfft(bins, count)
        trace = np.zeros(SAMPLES)
        stop = min(first + count, SAMPLES)
        trace[first:stop] = self._scale * piece[: stop - first]
        return trace

    def _floor_level(self) -> float:
        """Return the peak of the floor echo of the first pit at right angles, over a plain wall."""
        bore, basis, mouth = self._pits[0], self._bases[0], self._mouths[0]
        axis = np.array([np.cos(bore.phi), np.sin(bore.phi), 0.0])
        origin = axis * self.probe.face + np.array([0.0, 0.0, bore.z])
        spectrum = self._floor(bore, basis, mouth, origin, axis, -np.inf) * self._pulse()
        return float(np.abs(self._to_time(spectrum, 2 * self._stand_off / self._speed)).max())


def compile_echoes() -> None:
    """Compile the loops of an echo.

    This takes seconds on a new machine, longer than a camera in the same process may wait.
    """
    table, out = np.zeros((2, 2, 1), dtype=np.complex64), np.zeros(1, dtype=np.complex128)
    origin, axis = np.zeros(3), np.array([1.0, 0.0, 0.0])
    beam = table, np.ones(3), 1.0, 1.0, origin, axis
    bores, dents = _features(Pipe())
    surface = np.zeros((1, 1)), np.zeros((1, 1, 2)), 1.0, 0.0
    kernels.echo_of_wall(
        _parts(table), *beam[1:], 1.0, 0.0, 1.0, -np.inf, bores, dents, *surface, 0.0, out,
        np.zeros_like(out),
    )  # fmt: skip
    kernels.pressure_at(*beam, 0.0, origin[None], out[None])


def _parts(table: npt.NDArray[np.complex64]) -> npt.NDArray[np.float32]:
    """Return a table (N, M, F) with real and imaginary parts apart, (N, M, 2, F)."""
    return np.ascontiguousarray(np.stack([table.real, table.imag], axis=2))


def _speed_of_sound(temperature: float, pressure: float) -> float:
    """Return that of pure water, in m/s (Bilaniuk and Wong, J. Acoust. Soc. Am. 93, 1609, 1993).

    It grows by 1.6 m/s a megapascal (Wilson, J. Acoust. Soc. Am. 31, 1067, 1959, at 10 to 40
    degrees).
    """
    if not 0 <= as_finite("temperature of the water", temperature) <= 95:
        raise ParameterError(
            f"water at {temperature} degrees; give a temperature from 0 to 95 degrees Celsius"
        )
    terms = (
        3.16585020e-9, -1.48259672e-6, 3.34638117e-4, -5.81172916e-2, 5.03836171, 1402.38744,
    )  # fmt: skip
    return float(np.polyval(terms, temperature) + 1.6e-6 * (pressure - ATMOSPHERE))


def _specimen(
    probe: Probe, specimen: int | None
) -> tuple[dict[str, float], Probe, tuple[float, float]]:
    """Return the settings of the pulse, the true probe, and the error of its beam."""
    settings = dict(_SETTINGS)
    if specimen is None:
        return settings, probe, (0.0, 0.0)
    rng = np.random.default_rng(specimen)
    settings["frequency"] *= rng.uniform(0.95, 1.05)
    settings["bandwidth"] *= rng.uniform(0.9, 1.1)
    settings["skew"] = rng.uniform(-0.3, 0.3)
    settings["steel"] *= rng.uniform(0.99, 1.01)
    settings["loss"] = rng.uniform(0.5, 1.0)
    true = replace(probe, focus=probe.focus * rng.uniform(0.98, 1.02))
    off = np.radians(rng.normal(0.0, 0.1, 2))
    return settings, true, (float(off[0]), float(off[1]))


def _surface(
    rng: np.random.Generator, roughness: float, grain: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return heights of unit variance, grains (amplitude, delay in m of water), roughness."""
    texture = rng.standard_normal((256, 256))
    grains = np.zeros((128, 128, 2))
    grains[..., 0] = rng.standard_normal((128, 128)) * (rng.random((128, 128)) < 0.2)
    grains[..., 1] = rng.uniform(0.05e-3, 2e-3, (128, 128))
    # A fifth of the facets contain a grain; some two hundred are in the spot.
    grains[..., 0] *= grain * 10.0 * np.exp(-grains[..., 1] / 1e-3)
    return texture, grains, float(roughness)


def _features(pipe: Pipe) -> _Features:
    """Return bores and dents as arrays for the kernels."""
    bores = [(b.phi, b.z, b.diameter / 2, b.chamfer, b.chamfer_slope) for b in pipe.bores]
    dents = [(d.phi, d.z, d.size, d.height) for d in pipe.dents]
    return (
        np.array(bores, dtype=np.float64).reshape(-1, 5),
        np.array(dents, dtype=np.float64).reshape(-1, 4),
    )


def _ring_down(frequency: float) -> FloatArray:
    """Return the ring-down of the disc: for 1 us it is louder than any echo."""
    t = _SAMPLE_INTERVAL * np.arange(SAMPLES)
    ring: FloatArray = 20.0 * np.exp(-t / 0.13e-6) * np.sin(2 * np.pi * frequency * t)
    return ring

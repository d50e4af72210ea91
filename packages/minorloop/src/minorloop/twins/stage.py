"""A simulated fast stage: a piezo that moves a platform with a resonance, read by a quick sensor.

The hysteresis is a sum of many plays with a bend, minus pinning potentials whose minor loops do not
close, so that no Preisach operator describes it. Three slow lags add creep. The platform is a mass
on a spring with little damping, behind both.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.twins import _kernels

RATE = 10_000.0
"""Samples a second."""
VOLTAGE = 100.0
"""Greatest voltage; the least one is 0."""
TRAVEL = 40.0
"""Change of the position in um from 0 to that voltage, without creep."""
_NOISE = 0.01
"""Standard deviation of a reading in um, white: that of a capacitive sensor of this range."""
_RESONANCE = 300.0
"""Natural frequency in Hz, in the middle of the specimens."""
_RADII = np.linspace(0.0, 48.0, 97)
"""Radii of the plays in V."""
_SWEEP = 2000
"""Steps of the sweep to the greatest voltage and of that back, before a record."""


@dataclass(frozen=True)
class Stage:
    """A specimen; its parameters are drawn by the seed."""

    seed: int
    """Draws the specimen, and with ``experiment`` the noise."""

    @cached_property
    def _drawn(self) -> dict[str, FloatArray]:
        rng = np.random.default_rng([self.seed, 0])
        plays = np.exp(-_RADII / rng.uniform(12, 20))
        plays[0] = rng.uniform(4, 8) * plays[1:].sum() / 2.5
        return {
            "plays": plays / plays.sum(),
            # Two potentials: shares of the loop of 3 to 8 %, forgotten within 12 to 60 V.
            "strength": rng.uniform(0.4, 0.9, 2),
            "rate": 1 / np.array([rng.uniform(12, 25), rng.uniform(30, 60)]),
            "bend": rng.uniform(-0.08, 0.08, 1),
            "omega": 2 * np.pi * _RESONANCE * rng.uniform(0.95, 1.05, 1),
            "damping": rng.uniform(0.03, 0.06, 1),
            "times": np.array([0.1, 1.0, 10.0]) * rng.uniform(0.7, 1.4, 3),
            "shares": rng.uniform(0.008, 0.02, 3),
        }

    @property
    def resonance(self) -> float:
        """Natural frequency in Hz."""
        return float(self._drawn["omega"][0]) / (2 * np.pi)

    def positions(self, u: FloatArray, noise: float = _NOISE, experiment: int = 0) -> FloatArray:
        """Return the positions (T,) in um, read at the end of each sample.

        Before the first sample, the stage was moved to the greatest voltage and back to 0, and
        rested there for long.

        ``u`` (T,): voltages, each held for a sample; ``noise``: standard deviation of a reading in
        um; ``experiment``: number of the experiment, which draws the noise.
        """
        drawn = self._drawn
        up = np.linspace(0.0, VOLTAGE, _SWEEP + 1)
        before = np.concatenate([up, up[-2::-1]])
        w = _kernels.hysteretic(
            np.concatenate([before, u]), _RADII, drawn["plays"], drawn["strength"], drawn["rate"]
        )
        low, high = w[before.size - 1], w[_SWEEP]
        z = (w[before.size :] - low) / (high - low)
        pushed = TRAVEL * (z + drawn["bend"] * z * (1 - z))
        # Steps of the integration for each sample
        y = _kernels.creeping_resonance(
            pushed,
            1 / RATE,
            8,
            float(drawn["omega"][0]),
            float(drawn["damping"][0]),
            drawn["times"],
            drawn["shares"],
        )
        rng = np.random.default_rng([self.seed, 1, experiment])
        return np.asarray(y + noise * rng.normal(size=y.size))

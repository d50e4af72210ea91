"""Base classes of simulated actuators: clock, sensor noise, time steps, checkpoints."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_seconds, as_waveform, as_whole
from minorloop.errors import ParameterError
from minorloop.lab.actuator import Channel, Value, check_input
from minorloop.lab.records import Record
from minorloop.twins.checkpoints import Checkpoint, check_within

_SPREAD = 0.1
"""Specimens differ from the nominal parameters by up to this share."""
MAX_SAMPLES = 20_000_000
"""Most samples of one call: 480 MB of a record."""
MAX_STEPS = 200_000_000
"""Most time steps of one call, to bound its duration."""
_SEEDS = 2**64 - 1
"""Largest seed: a key of the generator of the noise has 64 bits."""


class SimulatedPlant(ABC):
    """A plant in simulated time: its clock, holds, waveforms and checkpoints.

    The physics is hidden: the parameters and the output without noise are private attributes, for
    scoring after a run and not for estimators.

    Parameters
    ----------
    parameters : dict of str to float
        Nominal physical parameters.
    specimen : int, optional
        Seed of a specimen: each parameter is multiplied by a number drawn uniformly from [0.9, 1.1]
        by ``numpy.random.default_rng(specimen)``, in the given order. Nominal if not given.
    noise : float
        Standard deviation of the sensors, in the unit of each output.
    seed : int
        Seed of the noise. The noise of the n-th sample since the start depends only on the seed
        and n.
    tick : float
        How long one ``exchange`` takes, in seconds.
    substeps : int
        Number of parts of each time step of the integration; more is slower and more exact.
    """

    kind: str
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]

    def __init__(
        self,
        parameters: dict[str, float],
        *,
        specimen: int | None,
        noise: float,
        seed: int,
        tick: float,
        substeps: int,
    ) -> None:
        self.specimen = None if specimen is None else as_whole("specimen", specimen, 0, _SEEDS)
        self.noise = as_finite("noise", noise)
        self.seed = as_whole("seed", seed, 0, _SEEDS)
        self.tick = as_seconds("tick", tick)
        self.substeps = as_whole("substeps", substeps, 1)
        if self.noise < 0:
            raise ParameterError(f"noise is {noise}; give a standard deviation >= 0")
        self._parameters = spread(parameters, self.specimen)
        self._one_tick = np.array([self.tick])
        self._clock = 0.0

    @property
    def clock(self) -> float:
        """Simulated time since the start, in seconds."""
        return self._clock

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold an input and record it and the output on the clock of the twin.

        Raises a `ParameterError` if a time is not positive, or there would be too many samples or
        steps.
        """
        value = check_input(self.inputs, u)
        ends = _sample_times(duration, sample_interval)
        began = self._clock
        y = self._hold(value, ends)
        return self._record(began + ends, np.tile(value, (ends.size, 1)), y)

    def drive(self, t: npt.ArrayLike, u: npt.ArrayLike) -> Record:
        """Apply a sampled waveform, linear between samples, and record it and the output.

        It has T samples on the clock of the twin, the first of them before any motion.

        Raises a `LimitError` if an input is beyond the limits, and nothing is applied then; a
        `SignalError` if the shapes differ, a number is not finite, or time does not increase.

        ``t`` (T,): strictly increasing times in seconds; the first is the present time, whatever
        its value. Steps of the integration end at these times, and between distant ones. 240
        samples a period are enough for a sine. ``u`` (T,) or (channels, T): input at these times,
        in the units of the channels. The step to the first value takes no time.
        """
        times, given = as_waveform(t, u, channels=len(self.inputs))
        values = np.ascontiguousarray(given.reshape(-1, times.size).T)
        for extreme in (values.min(axis=0), values.max(axis=0)):
            check_input(self.inputs, extreme)
        began = self._clock
        y = self._follow(times, values)
        return self._record(began + times - times[0], values, y)

    def exchange(self, u: Value) -> Value:
        """Hold an input for one tick, and return the output; NaN where a sensor is lost."""
        read = self._hold(check_input(self.inputs, u), self._one_tick)[0]
        return float(read[0]) if len(self.outputs) == 1 else read

    def checkpoint(self) -> dict[str, Any]:
        """Return the complete state for a later ``restore``, ready for JSON.

        It contains the hidden state of the physics, which estimators must not read.
        """
        return {**self._identity(), "clock": self._clock, **self._snapshot()}

    def restore(self, checkpoint: dict[str, Any]) -> None:
        """Return to a checkpoint; further outputs are repeated exactly.

        Raises a `ParameterError` if the checkpoint is damaged or impossible, or was taken from a
        twin with other options, and the twin does not change then.
        """
        self._take_up(Checkpoint(checkpoint, self._identity()))

    @abstractmethod
    def reset(self) -> None:
        """Return to the start: state at rest, clock at 0, noise from its beginning."""

    @abstractmethod
    def safe(self) -> None:
        """Apply the resting input; this takes no time and is not sampled."""

    @abstractmethod
    def _hold(self, value: FloatArray, ends: FloatArray) -> FloatArray:
        """Return readings (T, channels) at times ``ends`` (T,) from now, at a constant input."""

    @abstractmethod
    def _follow(self, t: FloatArray, u: FloatArray) -> FloatArray:
        """Return readings (T, channels) for a waveform (T, channels); the first is the present."""

    @abstractmethod
    def _snapshot(self) -> dict[str, Any]:
        """Return the parts of a checkpoint other than options and clock."""

    @abstractmethod
    def _take_up(self, found: Checkpoint) -> None:
        """Continue from a checkpoint with the options of this twin."""

    def _identity(self) -> dict[str, Any]:
        """Return the options that must be equal in a checkpoint."""
        return {
            "twin": self.kind,
            "specimen": self.specimen,
            "noise": self.noise,
            "seed": self.seed,
            "tick": self.tick,
            "substeps": self.substeps,
        }

    def _record(self, t: FloatArray, u: FloatArray, y: FloatArray) -> Record:
        if len(self.inputs) == 1:
            return Record(u[:, 0], y[:, 0], t, str(self.inputs[0]), str(self.outputs[0]))
        return Record(u.T, y.T, t, [str(c) for c in self.inputs], [str(c) for c in self.outputs])


class SimulatedActuator(SimulatedPlant):
    """A plant with one input and one output, whose sensor does not fail.

    Raises a `ParameterError` if an option is out of its range.

    ``specimen``, ``noise``, ``seed`` and ``substeps``: as in `SimulatedPlant`; ``tick``: how long
    one ``exchange`` takes, in seconds; the default belongs to the actuator; ``drift``: relative
    change of the coupling gain per hour, compounding: -0.05 loses 5 % an hour.
    """

    _nominal: dict[str, float]
    _equations: int
    """How many of these, the first ones, are those of the equations without the pinning."""
    _integrate: Callable[..., FloatArray]
    """Compiled loop, as `minorloop.twins._kernels` describes it."""
    _default_tick: float
    _rest: tuple[float, ...]
    _rest_input: float
    _first_step: float
    _longest_step: float
    _growth = 1.15

    def __init__(
        self,
        specimen: int | None = None,
        noise: float = 0.0,
        seed: int = 0,
        *,
        tick: float | None = None,
        drift: float = 0.0,
        substeps: int = 1,
    ) -> None:
        super().__init__(
            self._nominal,
            specimen=specimen,
            noise=noise,
            seed=seed,
            tick=self._default_tick if tick is None else tick,
            substeps=substeps,
        )
        self.drift = as_finite("drift", drift)
        if self.drift <= -1:
            raise ParameterError(f"drift is {drift} per hour; give more than -1")
        self.reset()

    def reset(self) -> None:
        """Return to the start: state at rest, clock at 0, noise from its beginning."""
        self._state: FloatArray = np.array(self._rest)
        self._clock = 0.0
        self._input: float | None = None
        self._held = 0.0
        self._samples = 0

    def safe(self) -> None:
        """Apply the resting input; this takes no time and is not sampled."""
        self._switch(self._rest_input)

    @abstractmethod
    def _bounds(self, clock: float) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest state that the physics can reach until a time."""

    @abstractmethod
    def _output_now(self) -> float:
        """Return the output without noise at the present state. For scoring only."""

    def _identity(self) -> dict[str, Any]:
        return {**super()._identity(), "drift": self.drift}

    def _snapshot(self) -> dict[str, Any]:
        return {
            "state": self._state.tolist(),
            "input": self._input,
            "held": self._held,
            "samples": self._samples,
        }

    def _take_up(self, found: Checkpoint) -> None:
        state, clock = found.array("state", self._state), found.clock()
        held = found.number("held", 0.0, clock * (1 + 1e-9))
        before = None
        if not found.absent("input"):
            before = float(found.inputs("input", self.inputs, np.zeros(())))
        samples = found.count("samples")
        check_within(state, *self._bounds(clock), "state")
        self._state, self._clock, self._input = state, clock, before
        self._held, self._samples = held, samples

    def _gain(self, clock: FloatArray | float) -> FloatArray:
        return np.exp(math.log1p(self.drift) * np.asarray(clock) / 3600.0)

    def _switch(self, value: float) -> None:
        if value != self._input:
            self._input, self._held = value, 0.0

    def _hold(self, value: FloatArray, ends: FloatArray) -> FloatArray:
        self._switch(float(value[0]))
        samples = self._held + ends
        points = np.union1d(self._grid(self._held, float(samples[-1])), samples)
        last = np.searchsorted(points, samples)
        h = np.diff(points, prepend=self._held)
        y = self._march(np.full(h.size, float(value[0])), h)[last]
        self._held += float(ends[-1])
        return self._sensed(y)

    def _follow(self, t: FloatArray, u: FloatArray) -> FloatArray:
        first, u = self._output_now(), u[:, 0]
        self._input, self._held = float(u[-1]), 0.0
        gaps = np.diff(t)
        parts = np.maximum(np.ceil(gaps / self._first_step - 1e-9), 1)
        check_count(float(parts.sum()) * self.substeps, MAX_STEPS, "steps")
        last = np.cumsum(parts).astype(np.int64) - 1
        h = np.repeat(gaps / parts, parts.astype(np.int64))
        inside = t[0] + np.cumsum(h)
        inside[last] = t[1:]
        y = self._march(np.interp(inside, t, u), h, since=float(u[0]))[last]
        return self._sensed(np.concatenate([[first], y]))

    def _march(self, u: FloatArray, h: FloatArray, since: float | None = None) -> FloatArray:
        """Run steps ``h``, each divided into substeps, with a linear input within a step."""
        n = self.substeps
        if n > 1:
            before = u if since is None else np.concatenate([[since], u[:-1]])
            share = np.arange(1, n + 1) / n
            u = (before[:, None] + (u - before)[:, None] * share).ravel()
            h = np.repeat(h / n, n)
        clock = self._clock + np.cumsum(h)
        linear = tuple(self._parameters.values())[: self._equations]
        pinning = (prefixed(self._parameters, name) for name in ("pinning", "release"))
        y = self._integrate(self._state, linear, *pinning, u, h, self._gain(clock))
        self._clock = float(clock[-1])
        return y[n - 1 :: n]

    def _grid(self, since: float, until: float) -> FloatArray:
        """Return ends of steps as times after a change of input; steps grow to the longest."""
        turns = math.ceil(math.log(self._longest_step / self._first_step, self._growth))
        early = np.cumsum(self._first_step * self._growth ** np.arange(turns))
        low, high = ((time - early[-1]) / self._longest_step for time in (since, until))
        check_count((high - low) * self.substeps, MAX_STEPS, "steps")
        late = early[-1] + self._longest_step * np.arange(max(math.floor(low), 1), max(high, 1))
        grid = np.concatenate([early, late])
        return grid[(grid > since) & (grid < until)]

    def _sensed(self, y: FloatArray) -> FloatArray:
        """Return outputs (T,) with the noise of the sensor, (T, 1)."""
        began, self._samples = self._samples, self._samples + y.size
        if self.noise > 0:
            y = y + self.noise * gaussian(self.seed, began, y.size)
        return y[:, None]


def gaussian(seed: int, first: int, count: int) -> FloatArray:
    """Return standard normal numbers (count,) that depend only on seed and sample number."""
    pairs = np.random.Philox(key=seed)
    pairs.advance(first // 2)  # one step of the counter is four words, two samples
    words = pairs.random_raw(2 * (count + first % 2)).reshape(-1, 2)[first % 2 :]
    # Box and Muller, A note on the generation of random normal deviates, 1958.
    radius = np.sqrt(-2 * np.log(((words[:, 0] >> np.uint64(11)) + 0.5) * 2.0**-53))
    return np.asarray(radius * np.cos(2 * np.pi * ((words[:, 1] >> np.uint64(11)) * 2.0**-53)))


def spread(parameters: dict[str, float], specimen: int | None) -> dict[str, float]:
    """Return the parameters of a specimen, within +-10 % of nominal; nominal if it is None."""
    if specimen is None:
        return dict(parameters)
    factors = np.random.default_rng(specimen).uniform(1 - _SPREAD, 1 + _SPREAD, len(parameters))
    return {
        name: value * float(factor)
        for (name, value), factor in zip(parameters.items(), factors, strict=True)
    }


def _sample_times(duration: float, sample_interval: float) -> FloatArray:
    """Return the times of the samples of a hold from its beginning, the last at its end."""
    length, interval = (
        as_seconds("duration", duration),
        as_seconds("sample_interval", sample_interval),
    )
    check_count(length / interval, MAX_SAMPLES, "samples")
    whole = round(length / interval)
    if whole < 1 or abs(whole * interval - length) > 1e-9 * length:
        whole = math.ceil(length / interval)
    times = interval * np.arange(1, whole + 1, dtype=np.float64)
    times[-1] = length
    return times


def check_count(count: float, most: int, what: str) -> None:
    """Refuse too many samples or steps."""
    if not count <= most:
        raise ParameterError(
            f"that takes {count:.3g} {what}, more than {most:.3g}; shorten it, or sample less "
            "often and in fewer substeps"
        )


def prefixed(parameters: dict[str, float], prefix: str) -> FloatArray:
    """Return the parameters whose names begin with a prefix, in order."""
    return np.array([value for name, value in parameters.items() if name.startswith(prefix)])

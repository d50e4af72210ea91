"""What the simulated plants of one or several axes share: clock, door, sensor, checkpoints."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_samples
from minorloop.errors import ParameterError, SignalError
from minorloop.head.twins.sensor import Fault, Sensor
from minorloop.lab.actuator import Channel, Value, check_input
from minorloop.lab.records import Record
from minorloop.twins.checkpoints import Checkpoint, damaged
from minorloop.twins.simulated_actuator import (
    MAX_SAMPLES,
    MAX_STEPS,
    check_count,
    positive,
    sample_times,
    spread,
    whole_number,
)

MOST_DELAY = 10.0
"""Longest delay of the measurement, in seconds."""


class SimulatedAxes(ABC):
    """A plant with as many inputs as outputs that lives in simulated time.

    The physics is hidden: only private attributes know it, for scoring after a run.

    Parameters
    ----------
    parameters : dict of str to float
        Nominal physical parameters.
    specimen : int, optional
        Seed of a specimen: each parameter is drawn evenly within +-10 %, in the order given.
    noise : float
        Standard deviation of the sensors, in the unit of each output.
    seed : int
        Seed of the noise.
    tick : float
        How long one ``exchange`` takes, in seconds.
    delay : float
        How old a reading is when it is given, in seconds.
    faults : sequence of Fault
        When readings fail.
    substeps : int
        Divides every time step of the integration by this number.
    log_truth : bool
        Whether to keep the hidden state at the end of every call, for scoring after the run.
    """

    kind: str
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    _rest_input: tuple[float, ...]
    _longest_step: float
    _farthest: float
    _truth_names: tuple[str, ...]

    def __init__(
        self,
        parameters: dict[str, float],
        *,
        specimen: int | None,
        noise: float,
        seed: int,
        tick: float,
        delay: float,
        faults: Sequence[Fault],
        substeps: int,
        log_truth: bool,
    ) -> None:
        self.specimen = None if specimen is None else whole_number("specimen", specimen)
        self.seed, self.tick = whole_number("seed", seed), positive("tick", tick)
        self.substeps, self.delay = whole_number("substeps", substeps), as_finite("delay", delay)
        if self.substeps < 1:
            raise ParameterError(f"substeps is {substeps}; give a whole number of at least 1")
        if not 0 <= self.delay <= MOST_DELAY:
            raise ParameterError(f"delay is {delay} s; give 0 to {MOST_DELAY:g} s")
        steps = (self.tick / self._longest_step + 1) * self.substeps
        check_count(steps, MAX_STEPS, f"steps for a tick of {self.tick:g} s")
        kept = 4 * self.delay / self._longest_step * self.substeps
        check_count(kept, MAX_SAMPLES, f"readings for a delay of {self.delay:g} s")
        self._sensor = Sensor(self.outputs, noise, self.seed, faults)
        self.noise = self._sensor.noise
        self._parameters = spread(parameters, self.specimen)
        self._pace = np.array([self._longest_step, float(self.substeps)])
        self._one_tick = np.array([self.tick])
        self._logging = bool(log_truth)
        self.reset()

    @property
    def clock(self) -> float:
        """Simulated time since the start, in seconds."""
        return self._clock

    def reset(self) -> None:
        """Go back to the start: the state at rest, clock at 0, the noise from its beginning."""
        self._clock = 0.0
        self._input: FloatArray = np.array(self._rest_input)
        self._state: FloatArray = self._at_rest()
        self._sensor.reset()
        rows = math.ceil(4 * self.delay * self.substeps / self._longest_step) + 4
        self._past: FloatArray = np.zeros((rows, 1 + len(self.outputs)))
        self._past[:, 1:] = self._output_now()
        self._mark = np.zeros(1, dtype=np.int64)
        self._log: list[FloatArray] = []

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold an input and record it and the output.

        Parameters
        ----------
        u : float or (channels,) array
            The input to hold, in the units of the channels.
        duration : float
            How long, in seconds.
        sample_interval : float
            Time between samples, in seconds; the last sample is taken at the end of the hold.

        Returns
        -------
        Record
            On the clock of the twin; the first sample comes one interval after the start.

        Raises
        ------
        LimitError
            If the input is beyond the limits; nothing is applied then.
        ParameterError
            If a time is not positive, or there would be too many samples or steps.
        """
        value = check_input(self.inputs, u)
        ends = sample_times(duration, sample_interval)
        self._check_steps(ends)
        began = self._clock
        inputs = np.tile(value, (ends.size, 1))
        y = self._sensor.read(began + ends, self._pass(ends, value, inputs))
        return self._record(began + ends, inputs, y)

    def drive(self, t: npt.ArrayLike, u: npt.ArrayLike) -> Record:
        """Drive with a sampled waveform, straight from sample to sample.

        Parameters
        ----------
        t : (T,) array_like
            Strictly increasing times in seconds; the first is now, whatever its value.
        u : (T,) or (channels, T) array_like
            Input at these times. The step to the first value takes no time.

        Returns
        -------
        Record
            T samples on the clock of the twin, the first of them before any motion.

        Raises
        ------
        LimitError
            If an input is beyond the limits; nothing is applied then.
        SignalError
            If the shapes differ, a number is not finite, or time does not increase.
        """
        times, values = self._waveform(t, u)
        for extreme in (values.min(axis=0), values.max(axis=0)):
            check_input(self.inputs, extreme)
        ends = times[1:] - times[0]
        self._check_steps(ends)
        began = self._clock
        now = self._delayed_now()
        y = np.concatenate([now[None], self._pass(ends, values[0].copy(), values[1:].copy())])
        clock = began + times - times[0]
        return self._record(clock, values, self._sensor.read(clock, y))

    def exchange(self, u: Value) -> Value:
        """Hold an input for one tick and give the output at its end.

        Returns
        -------
        float or (channels,) array
            A number for one channel; NaN where a sensor is lost.

        Raises
        ------
        LimitError
            If the input is beyond the limits; nothing is applied then.
        """
        value = check_input(self.inputs, u)
        y = self._pass(self._one_tick, value, value.reshape(1, -1))
        read = self._sensor.read(np.array([self._clock]), y)[0]
        return float(read[0]) if len(self.outputs) == 1 else read

    def safe(self) -> None:
        """Go to the resting input; it takes no time, and is not sampled."""
        self._input = np.array(self._rest_input)

    def checkpoint(self) -> dict[str, Any]:
        """All that a later ``restore`` needs to go on exactly from here, ready for JSON.

        It holds the hidden state of the physics: keep it, do not look into it.
        """
        last = [None if math.isnan(value) else value for value in self._sensor.last.tolist()]
        return {
            **self._identity(),
            "clock": self._clock,
            "input": self._input.tolist(),
            "state": self._state.tolist(),
            "past": self._past.tolist(),
            "mark": int(self._mark[0]),
            "samples": self._sensor.samples,
            "last": last,
        }

    def restore(self, checkpoint: dict[str, Any]) -> None:
        """Go back to a checkpoint; what follows repeats exactly.

        Raises
        ------
        ParameterError
            If the checkpoint is damaged or impossible, or was taken from a twin with other
            options; the twin stays as it was then.
        """
        found = Checkpoint(checkpoint, self._identity())
        clock, mark = found.clock(), found.count("mark", len(self._past) - 1)
        state, past = found.array("state", self._state), found.array("past", self._past)
        before = found.inputs("input", self.inputs, self._input)
        last, samples = found.readings("last", self._sensor.last), found.count("samples")
        self._check_state(state, clock)
        late = 1e-9 * max(clock, 1.0)
        times = np.roll(past[:, 0], -mark - 1)
        if times[0] < 0 or times[-1] > clock + late or (np.diff(times) < 0).any():
            raise damaged("the times of its past do not go from 0 to its clock")
        if np.abs(past[:, 1:]).max() > self._farthest:
            raise damaged(f"its past goes beyond {self._farthest:g} {self.outputs[0].unit}")
        self._input, self._state, self._past = before, state, past
        self._mark[0], self._clock = mark, clock
        self._sensor.samples, self._sensor.last = samples, last

    @abstractmethod
    def _at_rest(self) -> FloatArray:
        """The state at the start, with the resting input on for long."""

    @abstractmethod
    def _check_state(self, state: FloatArray, clock: float) -> None:
        """Refuse a state, of the right shape, that the physics cannot lead to."""

    @abstractmethod
    def _run(self, ends: FloatArray, first: FloatArray, u: FloatArray) -> FloatArray:
        """March the state to ``ends`` (T,) after the clock; delayed outputs (T, channels) there."""

    @abstractmethod
    def _output_now(self) -> FloatArray:
        """The outputs (channels,) at the present state, without noise. For scoring only."""

    @abstractmethod
    def _truth_now(self) -> FloatArray:
        """The hidden state (names, channels) in the order of ``_truth_names``. For scoring only."""

    def _truth(self) -> dict[str, FloatArray]:
        """The log of the hidden state: ``t`` (N,), and (N, channels) of each name. For scoring."""
        shape = (len(self._log), 1 + len(self._truth_names), len(self.outputs))
        log = np.array(self._log).reshape(shape)
        named = {name: log[:, 1 + k] for k, name in enumerate(self._truth_names)}
        return {"t": log[:, 0, 0], **named}

    def _identity(self) -> dict[str, Any]:
        """What must agree for a checkpoint to be taken up."""
        return {
            "twin": self.kind,
            "specimen": self.specimen,
            "noise": self.noise,
            "seed": self.seed,
            "tick": self.tick,
            "delay": self.delay,
            "substeps": self.substeps,
            "faults": [repr(fault) for fault in self._sensor.faults],
        }

    def _pass(self, ends: FloatArray, first: FloatArray, u: FloatArray) -> FloatArray:
        """Let the time to the last of ``ends`` pass; outputs without noise at each of them."""
        y = self._run(ends, first, u)
        self._clock += float(ends[-1])
        self._input = u[-1].copy()
        if self._logging:
            row = np.vstack([np.full(len(self.outputs), self._clock), self._truth_now()])
            self._log.append(row)
        return y

    def _delayed_now(self) -> FloatArray:
        """Output as it is seen now, the state left as it is."""
        kept = self._state.copy(), self._past.copy(), self._mark.copy()
        y: FloatArray = self._run(np.zeros(1), self._input, self._input.reshape(1, -1).copy())[0]
        self._state, self._past, self._mark = kept
        return y

    def _record(self, t: FloatArray, u: FloatArray, y: FloatArray) -> Record:
        if len(self.inputs) == 1:
            return Record(t, u[:, 0], y[:, 0], str(self.inputs[0]), str(self.outputs[0]))
        return Record(t, u.T, y.T, [str(c) for c in self.inputs], [str(c) for c in self.outputs])

    def _check_steps(self, ends: FloatArray) -> None:
        steps = (float(ends[-1]) / self._longest_step + ends.size) * self.substeps
        check_count(steps, MAX_STEPS, "steps")

    def _waveform(self, t: npt.ArrayLike, u: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Times (T,) and inputs (T, channels), refused unless time increases."""
        times, values = as_samples(t, name="t"), as_samples(u, name="u")
        count = len(self.inputs)
        wanted = (times.size,) if count == 1 else (count, times.size)
        if times.ndim != 1 or values.shape != wanted or times.size < 2:
            raise SignalError(
                f"t has shape {times.shape} and u {values.shape}; give (T,) times and "
                f"{'(T,)' if count == 1 else f'({count}, T)'} inputs, T at least 2"
            )
        if not (np.diff(times) > 0).all():
            index = int(np.argmin(np.diff(times) > 0)) + 1
            raise SignalError(f"t does not increase at index {index}; give increasing times")
        return times, np.ascontiguousarray(values.reshape(count, times.size).T)

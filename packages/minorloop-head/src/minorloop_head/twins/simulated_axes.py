"""The base of the simulated plants of the head: several axes, delayed and faulty readings."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError
from minorloop.twins.checkpoints import Checkpoint, damaged
from minorloop.twins.simulated_actuator import MAX_SAMPLES, MAX_STEPS, SimulatedPlant, check_count
from minorloop_head.twins.sensor import Sensor, SimulatedFault

MOST_DELAY = 10.0
"""Longest delay of the measurement, in seconds."""


class SimulatedAxes(SimulatedPlant):
    """A plant with as many inputs as outputs, whose readings are delayed and may fail.

    Raises a `ParameterError` if an option is out of its range.

    ``specimen``: seed of a specimen: each parameter is drawn within +-10 % of nominal. Nominal
    without it.
    ``noise``: standard deviation of the readings, in the unit of each.
    ``seed``: seed of the noise.
    ``tick``: duration of one ``exchange``, in seconds.
    ``delay``: delay of the readings, in seconds.
    ``faults``: times in which readings are stuck or lost.
    ``substeps``: divides every time step of the integration, 10 ms at most.
    ``log_truth``: whether to log the hidden state at the end of every call, for scoring after the
    run.
    """

    _nominal: dict[str, float]
    _rest_input: tuple[float, ...]
    _longest_step = 0.01
    _farthest: float
    _truth_names: tuple[str, ...]

    def __init__(
        self,
        specimen: int | None = None,
        noise: float = 0.0,
        seed: int = 0,
        *,
        tick: float = 0.04,
        delay: float = 0.0,
        faults: Sequence[SimulatedFault] = (),
        substeps: int = 1,
        log_truth: bool = False,
    ) -> None:
        super().__init__(
            self._nominal, specimen=specimen, noise=noise, seed=seed, tick=tick, substeps=substeps
        )
        self.delay = as_finite("delay", delay)
        if not 0 <= self.delay <= MOST_DELAY:
            raise ParameterError(f"delay is {delay} s; give 0 to {MOST_DELAY:g} s")
        steps = (self.tick / self._longest_step + 1) * self.substeps
        check_count(steps, MAX_STEPS, f"steps for a tick of {self.tick:g} s")
        kept = 4 * self.delay / self._longest_step * self.substeps
        check_count(kept, MAX_SAMPLES, f"readings for a delay of {self.delay:g} s")
        self._sensor = Sensor(self.outputs, self.noise, self.seed, faults)
        self._pace = np.array([self._longest_step, float(self.substeps)])
        self._logging = bool(log_truth)
        self.reset()

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

    def safe(self) -> None:
        """Go to the resting input, in no time and without a sample."""
        self._input = np.array(self._rest_input)

    @abstractmethod
    def _at_rest(self) -> FloatArray:
        """Return the state after a long time at the resting input."""

    @abstractmethod
    def _run(self, ends: FloatArray, first: FloatArray, u: FloatArray) -> FloatArray:
        """Integrate to ``ends`` (T,) after the clock; return delayed outputs (T, channels)."""

    @abstractmethod
    def _output_now(self) -> FloatArray:
        """Return the outputs (channels,) of the present state, without noise. For scoring only."""

    @abstractmethod
    def _truth_now(self) -> FloatArray:
        """Return the hidden state (names, channels), see ``_truth_names``. For scoring only."""

    def _truth(self) -> dict[str, FloatArray]:
        """Return the log of the hidden state: ``t`` (N,), and (N, channels) for each name."""
        shape = (len(self._log), 1 + len(self._truth_names), len(self.outputs))
        log = np.array(self._log).reshape(shape)
        named = {name: log[:, 1 + k] for k, name in enumerate(self._truth_names)}
        return {"t": log[:, 0, 0], **named}

    def _identity(self) -> dict[str, Any]:
        faults = [repr(fault) for fault in self._sensor.faults]
        return {**super()._identity(), "delay": self.delay, "faults": faults}

    def _snapshot(self) -> dict[str, Any]:
        last = [None if math.isnan(value) else value for value in self._sensor.last.tolist()]
        return {
            "input": self._input.tolist(),
            "state": self._state.tolist(),
            "past": self._past.tolist(),
            "mark": int(self._mark[0]),
            "samples": self._sensor.samples,
            "last": last,
        }

    def _take_up(self, found: Checkpoint) -> None:
        clock, mark = found.clock(), found.count("mark", len(self._past) - 1)
        state, past = found.array("state", self._state), found.array("past", self._past)
        before = found.inputs("input", self.inputs, self._input)
        last, samples = found.readings("last", self._sensor.last), found.count("samples")
        late = 1e-9 * max(clock, 1.0)
        times = np.roll(past[:, 0], -mark - 1)
        if times[0] < 0 or times[-1] > clock + late or (np.diff(times) < 0).any():
            raise damaged("the times of its past do not go from 0 to its clock")
        if np.abs(past[:, 1:]).max() > self._farthest:
            raise damaged(f"its past goes beyond {self._farthest:g} {self.outputs[0].unit}")
        self._input, self._state, self._past = before, state, past
        self._mark[0], self._clock = mark, clock
        self._sensor.samples, self._sensor.last = samples, last

    def _hold(self, value: FloatArray, ends: FloatArray) -> FloatArray:
        self._check_steps(ends)
        began = self._clock
        y = self._advance(ends, value, np.tile(value, (ends.size, 1)))
        return self._sensor.read(began + ends, y)

    def _follow(self, t: FloatArray, u: FloatArray) -> FloatArray:
        ends = t[1:] - t[0]
        self._check_steps(ends)
        began, now = self._clock, self._delayed_now()
        y = np.concatenate([now[None], self._advance(ends, u[0].copy(), u[1:].copy())])
        return self._sensor.read(began + t - t[0], y)

    def _advance(self, ends: FloatArray, first: FloatArray, u: FloatArray) -> FloatArray:
        """Advance the clock to the last of ``ends``; return outputs without noise at each."""
        y = self._run(ends, first, u)
        self._clock += float(ends[-1])
        self._input = u[-1].copy()
        if self._logging:
            row = np.vstack([np.full(len(self.outputs), self._clock), self._truth_now()])
            self._log.append(row)
        return y

    def _delayed_now(self) -> FloatArray:
        """Return the delayed output of now, without a change of the state."""
        kept = self._state.copy(), self._past.copy(), self._mark.copy()
        y: FloatArray = self._run(np.zeros(1), self._input, self._input.reshape(1, -1).copy())[0]
        self._state, self._past, self._mark = kept
        return y

    def _check_steps(self, ends: FloatArray) -> None:
        steps = (float(ends[-1]) / self._longest_step + ends.size) * self.substeps
        check_count(steps, MAX_STEPS, "steps")

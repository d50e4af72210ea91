"""Protocols of models and results, with parameters, results and errors of their methods.

An implementation documents only differences. ``T`` is the number of samples, ``S`` of signals.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy.typing as npt

from minorloop.arrays import Samples
from minorloop.operators.inversion import Inversion, Unreachable


class Operator(Protocol):
    """A rate-independent operator, such as `Preisach`, `PrandtlIshlinskii` or `Polynomial`."""

    def simulate(self, u: npt.ArrayLike, start: Any = ...) -> Samples:
        """Return the outputs for an input signal.

        Raises a `SignalError` if the inputs are not finite numbers of one of these shapes; a
        `ParameterError` if the start state is out of range.

        Parameters
        ----------
        u : (T,) or (S, T) array_like
            Inputs; the rows of a two-dimensional array are independent signals, computed in
            parallel.
        start : start state
            State before the first sample: ``"negative"``, ``"positive"`` or ``"demagnetised"``,
            or a `Memory` of a plane of relays, or the positions (n,) of n plays, or the memory
            that `step` returned.

        Returns
        -------
        (T,) or (S, T) array
            Outputs.
        """

    def invert(
        self, targets: npt.ArrayLike, start: Any = ..., unreachable: Unreachable = ...
    ) -> Inversion:
        """Return inputs that bring the output to each target in turn.

        Raises an `UnreachableError` if a target is out of reach and ``unreachable="raise"``; a
        `NotInvertibleError` if the model is not monotone, or has no inverse; a `SignalError` if the
        targets are not finite numbers in one dimension.

        Parameters
        ----------
        targets : (T,) array_like
            Target outputs, in order.
        start : start state
            State before the first input, as of `simulate`.
        unreachable : {"raise", "clip"}
            Treatment of targets out of reach: raise an error, or go as near as possible.

        Returns
        -------
        Inversion
            Inputs, their outputs, residuals, and whether each target was reachable.

        """

    def step(self, memory: Any, u: float) -> tuple[float, Any]:
        """Return output and memory after one input.

        Raises a `ParameterError` if the input is not a finite number.

        Parameters
        ----------
        memory : start state
            State before the input, as of `simulate`; it is not changed.
        u : float
            The input, in its unit, held over the interval of a sampled system.
        """


class LiveOperator(Operator, Protocol):
    """An operator that follows a live input, and finds one input at a time."""

    def aim(self, memory: Any, y: float, unreachable: Unreachable = ...) -> float:
        """Return the input that brings the output to y from a start state.

        Raises a `NotInvertibleError` or an `UnreachableError` as of `invert`; a `ParameterError` if
        the target is not a finite number.

        Parameters
        ----------
        memory : start state
            State before the input.
        y : float
            Target output, in its unit.
        unreachable : {"raise", "clip"}
            As of `invert`.
        """

    def track(self, start: Any = ...) -> LiveTracker:
        """Return a tracker that follows a live input sample by sample.

        Parameters
        ----------
        start : start state
            State before the first sample, as of `simulate`.
        """


class LiveTracker(Protocol):
    """A model that follows one live input and keeps its memory."""

    def push(self, u: float) -> float:
        """Return the output after the next input, and update the memory.

        Raises a `ParameterError` if the input is not a finite number, or the interval is not
        positive.

        Parameters
        ----------
        u : float
            The next input, in its unit.
        interval : float
            Seconds for which the input is held, for a model in time.
        """

    def peek(self, u: float) -> float:
        """Return the output for a next input; the memory does not change.

        Parameters
        ----------
        u, interval
            As of `push`.
        """

    def aim(self, y: float, unreachable: Unreachable = ...) -> float:
        """Return the input that brings the output to y; the memory does not change.

        Parameters
        ----------
        y, interval, unreachable
            As of `LiveOperator.aim` and `push`, with the same errors.
        """


class TimedModel(Protocol):
    """A model in time, such as `Cascade` or `AfterEffect`."""

    def simulate(
        self, t: npt.ArrayLike, u: npt.ArrayLike, start: Any = ..., *, before: float | None = None
    ) -> Samples:
        """Return the outputs for a sampled input.

        Raises a `SignalError` if the shapes differ or times do not increase.

        Parameters
        ----------
        t : (T,) array_like
            Strictly increasing times in seconds.
        u, x : (T,) array_like
            Inputs; u[k] is applied since t[k - 1], and u[0] for as long as u[1].
        start : start state
            Memory before ``before`` was applied.
        before : float, optional
            Input at which the model had settled before; by default the first of ``u``.
        between : {"held", "straight"}
            The signal between samples, if it can be chosen.

        Returns
        -------
        (T,) array
        """

    def invert(
        self,
        t: npt.ArrayLike,
        targets: npt.ArrayLike,
        start: Any = ...,
        unreachable: Unreachable = ...,
    ) -> Any:
        """Return inputs with which the output meets a target (T,) at each time (T,).

        Raises an `UnreachableError` or a `NotInvertibleError` as of `Operator.invert`; a
        `SignalError` if the shapes differ, or times do not increase.
        """

    def step(self, state: Any, u: float, interval: float) -> tuple[float, Any]:
        """Return output and state after an input that is held for an interval.

        Parameters
        ----------
        state, memory : start state, or state that `step` returned
            State before the input; it does not change.
        u, x : float
            The input, in its unit.
        interval : float
            Duration of the input in seconds.
        """


class Result(Protocol):
    """Result of an identification."""

    def predict(
        self, u: npt.ArrayLike, bands: float | None = None, curves: npt.ArrayLike | None = None
    ) -> Any:
        """Predict the outputs for an input that starts in the same state as the record.

        Raises a `ParameterError` if bands are not between 0 and 1; a `SignalError` if the shapes
        differ or times do not increase.

        Parameters
        ----------
        t : (T,) array_like
            Strictly increasing times in seconds, for a model in time.
        u : (T,) array_like
            Inputs. The first input is assumed to be applied before.
        bands : float, optional
            Probability, such as 0.9, that each output lies within its band.
        curves : (T,) array_like, optional
            Label of the curve of each input; the memory is reset where it changes.
        start : start state
            Memory before the first input, if it is not that of a record.

        Returns
        -------
        (T,) array, or Prediction with bands
        """

    def invert(
        self, targets: npt.ArrayLike, start: Any = ..., unreachable: Unreachable = ...
    ) -> Inversion:
        """Invert targets, with the standard deviation of the outputs and the warnings.

        Parameters
        ----------
        t : (T,) array_like
            Strictly increasing times in seconds, for a model in time.
        targets, before, filter_time, unreachable
            As of the model's own `invert`.
        start : start state, optional
            Memory before the first input; by default that of the record.
        """

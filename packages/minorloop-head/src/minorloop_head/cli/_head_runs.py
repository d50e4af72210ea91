"""How long ``head identify`` takes: an upper bound before it begins, and what is left later."""

from __future__ import annotations

import time

import typer

from minorloop.values import as_duration


class RunsLeft:
    """Says on stderr, in a line for each run, what is left of an identification.

    ``left``: number of holds that are left of each run, by its name; ``hold``: longest hold, in
    seconds.
    """

    def __init__(self, left: dict[str, int], hold: float) -> None:
        self._left, self._runs, self._all = dict(left), len(left), sum(left.values())
        self._hold, self._began = hold, time.monotonic()
        if left:
            typer.echo(
                f"{self._all} holds in {self._runs} runs: at most "
                f"{as_duration(self._all * hold)} of the head's time, less where the wires settle "
                f"sooner than in {hold:g} s",
                err=True,
            )

    def told(self, run: str) -> None:
        """Say that a run begins."""
        holds, left = self._left.get(run, 0), sum(self._left.values())
        number, done = self._runs - len(self._left) + 1, self._all - left
        said = f"{run}, run {number} of {self._runs}: {holds} holds, of {left} left in all"
        if done:
            seconds = (time.monotonic() - self._began) * left / done
            said += f", in about {as_duration(seconds)} if they go on as so far"
        typer.echo(said, err=True)
        self._left.pop(run, None)

"""Whether a wrong model says so: kinds of damage to a record, and sound records.

Plants and records are those of `benchmarks._plants`, damage that of `benchmarks._damage`. A model
is identified from the record, and its true error is that against the undamaged plant on an input
it has not seen, as a share of the plant's range. Above 5 % the model is wrong, and without a
warning it is silent. A warning about a sound record whose model is not wrong is false.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from benchmarks._damage import KINDS, Kind
from benchmarks._plants import Case, a_case
from benchmarks._timing import Row
from minorloop import identify
from minorloop.errors import MinorloopError
from minorloop.identification import Plane

WRONG, MOST_SILENT, MOST_FALSE = 0.05, 0.01, 0.03
SOUND = "sound"
DRAWS, SOUND_DRAWS = 30, 300


@dataclass(frozen=True)
class Verdict:
    """What became of one case."""

    kind: str
    seed: int
    plant: str
    error: float
    warnings: tuple[str, ...]
    advice: tuple[str, ...]

    @property
    def wrong(self) -> bool:
        return self.error > WRONG

    @property
    def silent(self) -> bool:
        return self.wrong and not self.warnings

    @property
    def named(self) -> bool:
        return any(word in text for text in self.advice for word in KINDS[self.kind].words)


@lru_cache(maxsize=400)
def _case(seed: int) -> Case:
    return a_case(seed)


def judged(kind: str, seed: int) -> Verdict:
    """Identify one case and compare the model with the plant."""
    case = _case(seed)
    rng = np.random.default_rng([seed, *kind.encode()])
    u, y = (case.u, case.y) if kind == SOUND else KINDS[kind].damage(case, rng)
    plant = f"{case.kind}, {case.shape}"
    try:
        result = identify(u, y, Plane(case.levels), holdout=case.holdout)
    except MinorloopError as error:  # refused, which says more than a warning
        return Verdict(kind, seed, plant, np.inf, (str(error),), (str(error),))
    residual = result.model.simulate(case.unseen) - case.truth
    error = float(np.sqrt(np.mean(residual**2))) / case.span
    return Verdict(kind, seed, plant, error, result.warnings, result.advice)


def rows(quick: bool = False, first: int = 0) -> list[Row]:
    kinds = list(KINDS)[::10] if quick else list(KINDS)
    draws, many = (3, 6) if quick else (DRAWS, SOUND_DRAWS)
    found: list[Row] = []
    shown: list[Verdict] = []
    for name in kinds:
        began = time.process_time()
        judgements = [judged(name, seed) for seed in range(first, first + draws)]
        found.append(_kind(name, KINDS[name], judgements, time.process_time() - began))
        shown += [] if KINDS[name].unseen else judgements
    began = time.process_time()
    sound = [judged(SOUND, seed) for seed in range(first, first + many)]
    return [*found, _all(shown), _sound(sound, time.process_time() - began)]


def _kind(name: str, kind: Kind, found: list[Verdict], took: float) -> Row:
    wrong = [one for one in found if one.wrong]
    silent = sum(one.silent for one in found)
    named = sum(one.named for one in wrong)
    accuracy = f"{len(wrong)} of {len(found)} wrong: {silent} silent, {named} named"
    if kind.unseen:
        accuracy += f"; not counted: {kind.unseen}"
    return Row(f"advice: {name}", took, accuracy=accuracy)


def _all(found: list[Verdict]) -> Row:
    silent = [one.kind for one in found if one.silent]
    worst = max(set(silent), key=silent.count, default="none")
    share = len(silent) / len(found)
    count = len({one.kind for one in found})
    return Row(
        f"advice: all {count} kinds of damage that a record shows, {len(found)} records",
        0.0,
        required=f"wrong by > {WRONG:.0%} and silent <= {MOST_SILENT:.0%}",
        met=share <= MOST_SILENT,
        accuracy=f"{len(silent)} silent ({share:.2%}); {sum(one.wrong for one in found)} wrong; "
        f"worst kind: {worst}, {silent.count(worst)} silent",
    )


def _sound(found: list[Verdict], took: float) -> Row:
    false = sum(bool(one.warnings) and not one.wrong for one in found)
    wrong, silent = sum(one.wrong for one in found), sum(one.silent for one in found)
    return Row(
        f"advice: sound records, {len(found)}",
        took,
        required=f"false advice <= {MOST_FALSE:.0%}",
        met=false <= MOST_FALSE * len(found),
        accuracy=f"{false} false ({false / len(found):.1%}); {wrong} wrong by > {WRONG:.0%}, "
        f"{silent} of them silent",
    )


def main() -> None:
    """Print the rows of a block of seeds, or its cases one by one."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.advice", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--cases", type=int, help="this many cases of each kind, one by one")
    parser.add_argument("--only", choices=[*KINDS, SOUND], nargs="+", default=[*KINDS, SOUND])
    chosen = parser.parse_args()
    if chosen.cases is None:
        for row in rows(first=chosen.seed):
            print(f"{row.what}: {row.accuracy} {row.required}", flush=True)
        return
    for one in _listed(chosen.only, range(chosen.seed, chosen.seed + chosen.cases)):
        word = "SILENT" if one.silent else "wrong" if one.wrong else "right"
        print(f"{one.kind}: {one.seed} {one.plant}: {one.error:.1%} {word}", flush=True)
        for text in one.warnings:
            print("    ", text[:150])


def _listed(kinds: Iterable[str], seeds: range) -> Iterable[Verdict]:
    return (judged(kind, seed) for kind in kinds for seed in seeds)


if __name__ == "__main__":
    main()

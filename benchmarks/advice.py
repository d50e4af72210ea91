"""Whether a wrong model says so: six defects of a record, and sound records.

Plants and records are those of `benchmarks._plants`. A model is identified from the record as the
command line does it, and its true error is that against the plant's own output on an input it has
not seen, as a share of the plant's range. A defect counts where that error exceeds 5 %.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from benchmarks._plants import Array, Case, a_case
from benchmarks._timing import FIXED, Row, seconds
from minorloop import identify
from minorloop.errors import SignalError

WRONG = 0.05
NAMES = {
    "outlier of 30 ranges": ("outlier", "set aside"),
    "outlier of 1,000 ranges": ("outlier", "set aside"),
    "three cells of -9999": ("-9999",),
    "lag of 5 samples": ("lag",),
    "stuck for a fifth": ("stuck",),
    "clipped": ("clipped",),
}
"""Each defect with what an advice that names it says."""


@dataclass(frozen=True)
class Verdict:
    """What became of one case."""

    seed: int
    case: Case
    error: float
    warnings: tuple[str, ...]
    advice: tuple[str, ...]

    def names(self, defect: str) -> bool:
        return any(word in text for text in self.advice for word in NAMES[defect])


def damaged(case: Case, defect: str, seed: int) -> Array:
    """The outputs of a case with a defect in them."""
    rng = np.random.default_rng([seed, 99])
    y, size = case.y.copy(), case.y.size
    if defect.startswith("outlier"):
        ranges = 30 if "30" in defect else 1000
        y[rng.integers(size)] += ranges * float(rng.choice([-1, 1])) * case.span
    elif defect.startswith("three"):
        y[rng.choice(size, 3, replace=False)] = -9999.0
    elif defect.startswith("lag"):
        y = np.concatenate([np.full(5, y[0]), y[:-5]])
    elif defect.startswith("stuck"):
        first, count = int(rng.integers(size - size // 5)), size // 5
        y[first : first + count] = y[first]
        if rng.uniform() < 0.3:
            y[first : first + count] += case.noise * rng.normal(size=count)
    else:
        low, high = y.min(), y.max()
        cut = rng.uniform(0.12, 0.3) * (high - low)
        ends = int(rng.integers(3))
        y = np.clip(y, low + cut if ends != 1 else low, high - cut if ends != 0 else high)
    return y


def judged(seed: int, defect: str | None) -> Verdict:
    """Identify one case and compare the model with the plant."""
    case = a_case(seed)
    y = case.y if defect is None else damaged(case, defect, seed)
    try:
        result = identify(case.u, y, levels=case.levels, holdout=case.holdout, **FIXED)
    except SignalError as error:  # Refused, which is advice.
        return Verdict(seed, case, np.inf, (str(error),), (str(error),))
    residual = result.model.simulate(case.unseen) - case.truth
    error = float(np.sqrt(np.mean(residual**2))) / case.span
    return Verdict(seed, case, error, result.warnings, result.advice)


def rows(quick: bool = False) -> list[Row]:
    few, many = (range(4), range(6)) if quick else (range(50), range(300))
    return [*(_defect(name, few) for name in NAMES), _sound(many)]


def _defect(defect: str, seeds: range) -> Row:
    found: list[Verdict] = []
    took = seconds(lambda: found.extend(judged(seed, defect) for seed in seeds))
    wrong = [one for one in found if one.error > WRONG]
    warned = sum(bool(one.warnings) for one in wrong)
    named = sum(one.names(defect) for one in wrong)
    named_of_all = sum(one.names(defect) for one in found)
    return Row(
        f"advice: {defect}, {len(found)} plants",
        took,
        required="advice in >= 95 % of models wrong by > 5 %",
        met=named >= 0.95 * len(wrong),
        accuracy=f"{len(wrong)} wrong: {warned} warned, {named} named; of all {named_of_all} named",
    )


def _sound(seeds: range) -> Row:
    found: list[Verdict] = []
    took = seconds(lambda: found.extend(judged(seed, None) for seed in seeds))
    false = [one for one in found if one.warnings and one.error <= WRONG]
    said = sum(bool(one.warnings) for one in found)
    wrong = sum(one.error > WRONG for one in found)
    return Row(
        f"advice: sound records, {len(found)} plants",
        took,
        required="false advice in <= 5 %",
        met=len(false) <= 0.05 * len(found),
        accuracy=f"{len(false)} false; {said} warned, {wrong} wrong by > 5 %",
    )


def main() -> None:
    """Each case of a block of seeds on a line of its own."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.advice")
    parser.add_argument("first", type=int)
    parser.add_argument("count", type=int)
    parser.add_argument("--only", choices=[*NAMES, "sound"], nargs="+")
    chosen = parser.parse_args()
    for name in chosen.only or [*NAMES, "sound"]:
        for seed in range(chosen.first, chosen.first + chosen.count):
            one = judged(seed, None if name == "sound" else name)
            print(f"{name}: {seed} {one.case.kind}, {one.case.shape}: {one.error:.1%}", flush=True)
            for text in one.advice:
                print("   !" if text in one.warnings else "    ", text[:150])


if __name__ == "__main__":
    main()

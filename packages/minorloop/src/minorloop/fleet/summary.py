"""Summary of a fleet: distributions over its specimens, outliers, and failures."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

FIGURES = ("nrmse", "nrmse_holdout", "excited", "low", "high", "opening", "seconds")
_JUDGED = ("nrmse", "nrmse_holdout", "excited", "low", "high", "opening")
WORDS = ("min", "quarter", "median", "three_quarters", "max")
FAR = 5.0
"""Robust standard deviations from the median from which a specimen is an outlier."""
LONGEST = 400
"""Most characters of a reason, a warning or advice, which are on one line."""


@dataclass(frozen=True)
class Outcome:
    """Result of one specimen, with file and columns of its record as the manifest names them."""

    specimen: str
    """Name of the specimen."""
    error: str | None = None
    """Reason why there is no model; None if there is a model."""
    nrmse: float | None = None
    """Error of the model on the fitted samples, over the range of the output."""
    low: float | None = None
    high: float | None = None
    """``low`` and ``high``: least and greatest output of the model."""
    opening: float | None = None
    """Widest gap between the two major branches, as a share of the range."""
    samples: int | None = None
    """Number of fitted rows."""
    seconds: float | None = None
    """Time of the fit."""
    sha256: str | None = None
    """Digest of the record."""
    file: str | None = None
    input: str | None = None
    output: str | None = None
    model: str | None = None
    """Digest of the file of the model."""
    nrmse_holdout: float | None = None
    """Error on the held-out end of the record; None if it has none."""
    excited: float | None = None
    """Share of the cells of the plane that the record excites."""
    warning: str | None = None
    """Reasons not to trust the model; None if there is no warning."""
    advice: str | None = None
    chosen: str | None = None
    """``advice`` and ``chosen``: weaknesses and remedies; and choices of the identification."""
    time: str | None = None
    curves: str | None = None
    groups: str | None = None
    sd: str | None = None

    def __post_init__(self) -> None:
        for name in ("error", "warning", "advice", "chosen"):
            line = " ".join((getattr(self, name) or "").split())
            line = line if len(line) <= LONGEST else f"{line[: LONGEST - 4]} ..."
            object.__setattr__(self, name, line or None)


@dataclass(frozen=True)
class Outlier:
    """A figure of a specimen that is far from those of other specimens."""

    specimen: str
    figure: str
    """``specimen`` and ``figure``: names of the specimen and of the figure."""
    value: float
    """Value of the figure."""
    median: float
    """Median over all specimens."""
    deviations: float
    """Distance from the median in robust standard deviations."""


@dataclass(frozen=True)
class Summary:
    """Results of all specimens of a fleet."""

    outcomes: Sequence[Outcome]
    """Outcomes in the order of the manifest."""
    strays: Sequence[str] = ()
    """Files in the folder that do not belong to any of these specimens."""

    @property
    def failures(self) -> list[Outcome]:
        """Specimens without a model."""
        return [outcome for outcome in self.outcomes if outcome.error is not None]

    @property
    def identified(self) -> list[Outcome]:
        """Specimens with a model."""
        return [outcome for outcome in self.outcomes if outcome.error is None]

    @property
    def warned(self) -> list[Outcome]:
        """Specimens whose model is not to be trusted."""
        return [outcome for outcome in self.outcomes if outcome.warning is not None]

    def distributions(self) -> dict[str, dict[str, float]]:
        """Minimum, quartiles and maximum of each figure over the identified specimens."""
        found = {}
        for figure in FIGURES:
            values = self._values(figure)
            if values.size:
                at = np.percentile(values, [0, 25, 50, 75, 100])
                found[figure] = dict(zip(WORDS, map(float, at), strict=True))
        return found

    def outliers(self, far: float = FAR) -> list[Outlier]:
        """Figures further than ``far`` robust standard deviations from the median.

        The robust standard deviation is 1.4826 times the median absolute deviation. There are no
        outliers among fewer than eight specimens.
        """
        found = []
        for figure in _JUDGED:
            values = self._values(figure)
            # Fewer specimens have no outliers: their median deviation is too uncertain
            if values.size < 8:
                continue
            median = float(np.median(values))
            # Standard deviation over median absolute deviation of a normal distribution
            spread = 1.4826 * float(np.median(np.abs(values - median)))
            # Relative spread below which values count as equal: rounding is not an outlier
            spread = max(spread, 1e-9 * max(1.0, abs(median)))
            with_it = [one for one in self.identified if getattr(one, figure) is not None]
            for outcome, value in zip(with_it, values, strict=True):
                deviations = abs(float(value) - median) / spread
                if deviations > far:
                    found.append(
                        Outlier(outcome.specimen, figure, float(value), median, deviations)
                    )
        return sorted(found, key=lambda one: -one.deviations)

    def plain(self) -> Mapping[str, Any]:
        """As a mapping, for files and ``--json``."""
        return {
            "specimens": len(self.outcomes),
            "identified": len(self.identified),
            "failed": len(self.failures),
            "figures": self.distributions(),
            "outliers": [asdict(outlier) for outlier in self.outliers()],
            "warnings": {one.specimen: one.warning for one in self.warned},
            "failures": {one.specimen: one.error for one in self.failures},
            "strays": list(self.strays),
        }

    def remarks(self) -> dict[str, list[str]]:
        """Sentences on outliers, models not to be trusted, failures and strays, by their kind."""
        return {
            "outliers": [
                f"outlier {one.specimen}: {one.figure} {one.value:.4g}; the median is "
                f"{one.median:.4g}"
                for one in self.outliers()
            ],
            "warnings": [f"warning {one.specimen}: {one.warning}" for one in self.warned],
            "failures": [f"failed {one.specimen}: {one.error}" for one in self.failures],
            "strays": [
                f"{one} does not belong to any specimen in this manifest" for one in self.strays
            ],
        }

    def __str__(self) -> str:
        lines = [f"{len(self.identified)} of {len(self.outcomes)} specimens identified"]
        lines.append(" ".join([f"{'':<14}", *(f"{word:>14}" for word in WORDS)]))
        for figure, at in self.distributions().items():
            row = " ".join(f"{at[word]:>14.4g}" for word in WORDS)
            lines.append(f"{figure:<14} {row}")
        return "\n".join([*lines, *(one for kind in self.remarks().values() for one in kind)])

    def _values(self, figure: str) -> Any:
        values = [getattr(one, figure) for one in self.identified]
        return np.array([value for value in values if value is not None], dtype=np.float64)

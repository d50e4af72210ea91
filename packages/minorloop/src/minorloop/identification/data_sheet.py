"""A model with bands from the coercivity, remanence and saturation of a data sheet.

Three numbers of the major loop do not determine a Preisach plane: many planes have this loop. They
differ in what a data sheet does not say: whether there is one population of relays or two, the kind
of the ridge of each, its relative width, how far the means of its thresholds scatter, and how far
the reversible weight reaches. The model is the mean of such planes, and its bands are their spread.

A ridge alone ties its widths to the squareness: the squarer the loop, the less of them is left, and
the narrower the bands. Two populations do not: the coercivity is between theirs, and each can
be square.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final, overload

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Levels, Samples, as_finite, as_levels
from minorloop.errors import ParameterError
from minorloop.identification.bands import BAND, Prediction, as_probability
from minorloop.identification.result import Scored, ScoreRow
from minorloop.identification.ridge import KINDS, Kind, Ridge
from minorloop.operators.inversion import Inversion, Unreachable, as_signal
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Preisach

FIELDS: Final = 5.0
"""Largest input over the coercivity where it is not given."""
DISCREPANCY: Final = 0.02
"""Standard deviation, over the saturation, of what no Preisach operator can reproduce."""
RELATIVE_WIDTHS: Final = (0.05, 3.0)
"""Range of the spread of half-widths over the coercive field of the ridge: from relays that are
alike within a band of the plane to coercive fields that begin at zero."""
LEAST_SCATTER: Final = 0.03
"""Least spread of the mean thresholds over that field, a fraction of a band; the greatest is the
field of the loop."""
FIELD_RATIO: Final = 10.0
"""Greatest ratio of the coercive fields of the two populations, a decade; the least is 1."""
REVERSIBLE_WIDTHS: Final = (0.5, 2.0)
"""Least half-width of the reversible weight over the coercivity, and greatest over the field."""
_RIDGES = 48
_DRAWS = 2000
_FEWEST = 8
"""Planes of a model; shapes that are tried until so many have the loop, enough for a remanence of
0.9999 of the saturation; fewest planes."""
_HALF = 24
"""Levels above zero: a band near the coercivity is about 0.15 of it at five coercivities."""
_RATIO = 1.0757660660868371
"""Root of x^10 = x + 1: its powers give evenly distributed points in nine dimensions."""
_AMPLITUDES = 8
"""Loops from the coercivity to the largest input, for the widest band: each is at most 1.6 times as
large as the one before, at 25 coercivities."""
_LEAST_FIELD = 0.02
"""Least coercive field of a ridge over the coercivity."""
_ROUNDING = 1e-6
"""Output at the coercivity, over the saturation, that counts as zero. If it is larger, the
search ended at a jump, where the remanence cannot be met."""


@dataclass(frozen=True, eq=False, repr=False)
class DataSheetModel(Scored):
    """A model of a material of which only the major loop is known."""

    SCORES: ClassVar[tuple[ScoreRow, ...]] = (
        ScoreRow("coercivity", "coercivity", "coercivity", "{:.6g}", kept=True),
        ScoreRow("remanence", "remanence", "remanence", "{:.6g}", kept=True),
        ScoreRow("saturation", "saturation", "saturation", "{:.6g}", kept=True),
        ScoreRow("field", "field", "at an input of", "{:.6g}", kept=True),
        ScoreRow(
            "band_half_width", "half_width", "90 % band, mean half width", "{:.3g}", kept=True
        ),
        ScoreRow("", "worst_half_width", "its half width at worst", "{:.3g}"),
        ScoreRow("ridges", lambda found: len(found.ridges), "ridges with this loop"),
        ScoreRow("range", lambda found: list(found.model.range)),
    )

    model: Preisach
    """Mean of the planes; it has the given loop."""
    ridges: FloatArray
    """Shape (R, L, L). Weights of planes of ridges that all have this loop."""
    coercivity: float
    remanence: float
    saturation: float
    field: float
    """The given loop: coercive input, output at zero input, and output at the largest input."""

    @property
    def lag(self) -> int:
        """0: a data sheet has no times."""
        return 0

    @property
    def lag_seconds(self) -> float:
        """0."""
        return 0.0

    @property
    def figures(self) -> dict[str, Any]:
        """All scores and warnings by name, as ``--json`` prints them; they are the advice."""
        return {name: value for name, value in super().figures.items() if name != "advice"}

    @cached_property
    def half_width(self) -> float:
        """Half the width of 90 % bands on average, on loops to coercivity and half the field."""
        return float(self._half_widths([self.coercivity, self.field / 2]).mean())

    @cached_property
    def worst_half_width(self) -> float:
        """Half the width of the widest of these bands, on the major loop and minor loops."""
        amplitudes = np.geomspace(self.coercivity, self.field, _AMPLITUDES)
        return float(self._half_widths([*amplitudes.tolist(), self.field / 2]).max())

    def _half_widths(self, amplitudes: Sequence[float]) -> FloatArray:
        """Half widths of 90 % bands on symmetric loops."""
        loops = np.concatenate([self.loop(amplitude) for amplitude in sorted(amplitudes)])
        return self.predict(loops, bands=BAND).half_width

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What a file of this model says: it has no bands."""
        mean, worst = self.half_width / self.saturation, self.worst_half_width / self.saturation
        return (
            f"this model was made from a data sheet, coercivity {self.coercivity:g}, remanence "
            f"{self.remanence:g} and saturation {self.saturation:g} at an input of {self.field:g}: "
            f"minor loops may be off by {mean:.0%} of the saturation on average, they and the "
            f"major loop by {worst:.0%} at worst; measure some of them",
        )

    def loop(self, amplitude: float, samples: int = 100) -> FloatArray:
        """Return inputs of a symmetric loop, from its positive peak and back to it.

        Parameters
        ----------
        amplitude : float
            Largest input.
        samples : int
            Inputs on each branch.
        """
        down = np.linspace(amplitude, -amplitude, samples)
        return np.concatenate([down, down[-2::-1]])

    @overload
    def predict(self, u: npt.ArrayLike, bands: None = None, start: Start = ...) -> Samples: ...

    @overload
    def predict(self, u: npt.ArrayLike, bands: float, start: Start = ...) -> Prediction: ...

    def predict(
        self, u: npt.ArrayLike, bands: float | None = None, start: Start = "demagnetised"
    ) -> Samples | Prediction:
        """Predict the outputs for an input from a start state, as `Result.predict`."""
        if bands is None:
            return self.model.simulate(u, start)
        probability = as_probability(bands)
        inputs = as_signal(u, name="u")
        y = self.model.simulate(inputs, start)
        return Prediction(inputs, y, self._deviation(inputs, y, start), probability)

    def invert(
        self,
        targets: npt.ArrayLike,
        start: Start = "demagnetised",
        unreachable: Unreachable = "raise",
    ) -> Inversion:
        """Invert targets, and predict the standard deviation of the outputs, as `Result.invert`."""
        found = self.model.invert(targets, start, unreachable)
        sd = self._deviation(found.u, found.y, start)
        return replace(found, sd=sd, warnings=self.warnings)

    def _deviation(self, u: FloatArray, y: FloatArray, start: Start) -> FloatArray:
        """(T,) spread of the ridges about the model, and the discrepancy of any model."""
        square = np.full(u.size, DISCREPANCY**2)
        for weights in self.ridges:
            off = replace(self.model, weights=weights).simulate(u, start) - y
            square += (off / self.saturation) ** 2 / len(self.ridges)
        return np.asarray(self.saturation * np.sqrt(square))


def from_loop(
    coercivity: float, remanence: float, saturation: float, field: float | None = None
) -> DataSheetModel:
    """Make a model with bands from three numbers of the major loop of a data sheet.

    The loop is symmetric about zero. All planes of the model have it exactly. Each has two ridges
    of any shares, drawn from the ranges `RELATIVE_WIDTHS`, `LEAST_SCATTER`, `FIELD_RATIO` and
    `REVERSIBLE_WIDTHS` of what the loop does not determine, evenly in the logarithm.

    Parameters
    ----------
    coercivity : float
        Input, without its sign, at which the output of the major loop is zero; positive.
    remanence : float
        Output of the descending branch at zero input; positive.
    saturation : float
        Output at the largest input; above the remanence.
    field : float, optional
        The largest input; five times the coercivity if not given.

    Raises
    ------
    ParameterError
        If a number is not positive, the remanence is not below the saturation, the field is not
        above the coercivity, or no ridge has such a loop.

    References
    ----------
    Della Torre, Magnetic Hysteresis, 1999, chapter 2: Preisach functions from the major loop.

    Examples
    --------
    >>> steel = ml.from_loop(40.0, 1.2, 1.5)
    >>> round(steel.model.range[1], 2)
    1.5
    """
    hc, br, bm, hm = _checked(coercivity, remanence, saturation, field)
    levels = _levels(hm / hc)
    shares = _RATIO ** -np.arange(1.0, 10.0)
    ridges: list[FloatArray] = []
    for number in range(1, _DRAWS + 1):
        weights = _ridge_with_loop(levels, br / bm, number * shares % 1.0)
        if weights is not None:
            ridges.append(weights)
        if len(ridges) == _RIDGES:
            break
    if len(ridges) < _FEWEST:
        raise ParameterError(
            f"no ridge has a loop of coercivity {hc:g}, remanence {br:g} and saturation {bm:g} at "
            f"an input of {hm:g}; check the numbers, or give the field at which the saturation was "
            "measured"
        )
    scaled = bm * np.array(ridges)
    model = Preisach(as_levels(hc * levels), scaled.mean(axis=0), diagonal="reversible")
    return DataSheetModel(model, scaled, hc, br, bm, hm)


def _checked(
    coercivity: float, remanence: float, saturation: float, field: float | None
) -> tuple[float, float, float, float]:
    given = {"coercivity": coercivity, "remanence": remanence, "saturation": saturation}
    values = {name: as_finite(name, value) for name, value in given.items()}
    values["field"] = FIELDS * values["coercivity"] if field is None else as_finite("field", field)
    for name, value in values.items():
        if value <= 0:
            raise ParameterError(f"{name} is {value:g}; give a positive number, without its sign")
    hc, br, bm, hm = values.values()
    if br >= bm:
        raise ParameterError(
            f"remanence is {br:g} and saturation {bm:g}; give a remanence below the saturation"
        )
    if hm <= hc:
        raise ParameterError(
            f"field is {hm:g} and coercivity {hc:g}; give the largest input of the loop, above the "
            "coercivity"
        )
    return hc, br, bm, hm


def _levels(highest: float) -> Levels:
    """Levels in coercivities, symmetric, denser near zero, with -1, 0 and 1 among them."""
    even = np.linspace(0.0, 1.0, _HALF + 1)
    if highest > 2.0:
        steep = np.arccosh(highest / 2.0)
        even = np.sinh(steep * even) / np.sinh(steep)
    above = highest * even
    above[max(int(np.argmin(np.abs(above[:-1] - 1.0))), 1)] = 1.0
    return as_levels(np.concatenate([-above[:0:-1], above]))


def _ridge_with_loop(levels: Levels, squareness: float, draw: FloatArray) -> FloatArray | None:
    """(L, L) weights of a plane of saturation 1 with the given loop; None if there is none.

    The coercive field of the first population is searched for which the descending branch is zero
    at -1; the reversible share follows from the remanence.
    """
    from scipy.optimize import brentq

    highest = float(levels[-1])
    irreversible, reach = _shape(draw, levels)
    reversible = Ridge("gaussian", 1.0, 1.0, 1.0, 0.0, reach).reversible(levels)
    zero, down = levels.size // 2, int(np.searchsorted(levels, -1.0))
    reversible_output = 1.0 - 2.0 * float(reversible[down:].sum())

    def parts(logarithm: float) -> tuple[FloatArray, float, float]:
        """Irreversible weights, reversible share, and the output at -1."""
        weights = irreversible(float(np.exp(logarithm)))
        remanent = 1.0 - 2.0 * float(weights[:, zero:].sum())
        if remanent < squareness:
            return weights, 0.0, -1.0
        share = 1.0 - squareness / remanent
        output = (1 - share) * (1.0 - 2.0 * float(weights[:, down:].sum()))
        return weights, share, output + share * reversible_output

    def output(logarithm: float) -> float:
        return parts(logarithm)[2]

    low, high = float(np.log(_LEAST_FIELD)), float(np.log(highest))
    if not output(high) >= 0 > output(low):
        return None
    best = float(brentq(output, low, high, xtol=1e-9))
    weights, share, off = parts(best)
    if abs(off) > _ROUNDING:
        return None
    return (1 - share) * weights + np.diag(share * reversible)


def _shape(draw: FloatArray, levels: Levels) -> tuple[Callable[[float], FloatArray], float]:
    """Return the irreversible weights of one draw by coercive field, and its reversible width.

    The field is that of the first of two populations; both numbers are in coercivities.
    ``draw`` has nine numbers from 0 to 1: kind, width and scatter of each population, the share of
    the first, the ratio of their fields, and the reversible width.
    """
    highest = float(levels[-1])
    reach = _between(draw[8], REVERSIBLE_WIDTHS[0], REVERSIBLE_WIDTHS[1] * highest)
    ratio, share = _between(draw[7], 1.0, FIELD_RATIO), float(draw[6])

    def population(kind: float, width: float, scatter: float) -> Callable[[float], FloatArray]:
        which: Kind = KINDS[int(len(KINDS) * kind)]
        wide, far = _between(width, *RELATIVE_WIDTHS), _between(scatter, LEAST_SCATTER, highest)
        return lambda field: Ridge(
            which, field, wide * field, far * field, 0.0, reach
        ).irreversible(levels)

    first, second = population(*draw[:3]), population(*draw[3:6])
    return lambda field: share * first(field) + (1 - share) * second(ratio * field), reach


def _between(share: float, low: float, high: float) -> float:
    """Number between two, even in the logarithm."""
    return float(low * (high / low) ** share)

"""Least squares for weighted plays and dead zones.

Input and output are both divided by half their range, so that digits are not lost for a field of
1e5 A/m or a moment of 1e-7 A m2.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_pair, frozen
from minorloop.errors import ParameterError, SignalError

_STILL = 1e-9
"""Smaller motions of a play, as a share of half the input range, are rounding."""
_MOST_STEPS = 100
"""Most evaluations of the refinement, which converges within a few tens."""


class _BentPlays(NamedTuple):
    """A fit of plays followed by dead zones, in the units of the record."""

    weights: FloatArray
    shift: float
    knots: FloatArray
    slopes: FloatArray
    centre: float


def as_record(u: npt.ArrayLike, y: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return inputs and outputs of one length; NaN marks a gap in y.

    Raises a `SignalError` if lengths differ, or the input or output is empty or constant.
    """
    inputs, outputs = as_pair(u, y)
    if inputs.size == 0 or inputs.min() == inputs.max():
        raise SignalError("u is constant or empty; give an input that changes")
    known = outputs[~np.isnan(outputs)]
    if known.size == 0 or known.min() == known.max():
        raise SignalError("y is constant or has no measured sample; give outputs that change")
    return inputs, outputs


def choose_radii(u: FloatArray, radii: npt.ArrayLike) -> FloatArray:
    """Return the given radii, or this number of them from zero to just below half the range of u.

    Raises a `ParameterError` if a count is not a whole number of at least 1, or the first radius is
    not zero.
    """
    if np.ndim(radii) == 0:
        count = _as_count("radii", radii, least=1)
        return np.linspace(0.0, (u.max() - u.min()) / 2, count, endpoint=False)
    places = _as_numbers("radii", radii)
    if places.size and places.flat[0] != 0:
        raise ParameterError(
            f"radii[0] is {places.flat[0]:g}; a fit needs the linear term, so begin with 0"
        )
    return places


def choose_knots(y: FloatArray, thresholds: npt.ArrayLike) -> FloatArray:
    """Return the given thresholds, or this number of them, denser towards the ends of the range.

    Raises a `ParameterError` if a count is not a whole number, or thresholds do not increase.
    """
    if np.ndim(thresholds) == 0:
        count = _as_count("thresholds", thresholds, least=0)
        known = y[~np.isnan(y)]
        middle, half = (known.max() + known.min()) / 2, (known.max() - known.min()) / 2
        return np.asarray(middle - half * np.cos(np.pi * np.arange(1, count + 1) / (count + 1)))
    knots = _as_numbers("thresholds", thresholds)
    if knots.ndim != 1 or not np.isfinite(knots).all() or not (np.diff(knots) > 0).all():
        raise ParameterError(f"thresholds are {knots}; give finite outputs, strictly increasing")
    return knots


def fit_bent_plays(
    u: FloatArray, y: FloatArray, positions: FloatArray, knots: FloatArray
) -> _BentPlays:
    """Return the plays and dead zones of the best fit ``centre + S(shift + plays)`` to a record.

    Raises a `SignalError` if there are fewer measured samples than unknowns.

    ``u`` and ``y`` (T,): record; NaN in y is left out; ``positions`` (T, n): positions of the
    plays; ``knots`` (K,): outputs at which the slope of S changes, increasing.
    """
    known = ~np.isnan(y)
    plays, y = positions[known], y[known]
    _require_samples(y.size, plays.shape[1] + knots.size + 1)
    across, up = _half_range(u), _half_range(y)
    centre = _middle_piece(y, knots)
    least, mean = np.zeros(plays.shape[1]), plays.mean(axis=0)
    # Least slope of plays, in ranges of output over input: it keeps a fitted operator invertible,
    # and is too small to show in a record
    least[0] = 1e-4
    problem = _Bent(
        columns=_columns(plays, across),
        y=(y - centre) / up,
        knots=(knots - centre) / up,
        least=least,
    )
    theta, shift, compliance = problem.solve()
    weights = theta * up / across
    return _BentPlays(
        weights=weights,
        shift=float(shift * up - mean @ weights),
        knots=problem.corners(compliance) * up,
        slopes=frozen(1 / compliance),
        centre=centre,
    )


class _Bent(NamedTuple):
    """The normalised problem: fit ``S(shift + columns @ theta)`` to y.

    S is described by its inverse, whose pieces lie between fixed knots in y. Their slopes
    (compliances) are unknown, and 1 at the origin.
    """

    columns: FloatArray
    y: FloatArray
    knots: FloatArray
    least: FloatArray

    def solve(self) -> tuple[FloatArray, float, FloatArray]:
        """Return parameters of the plays, shift and compliances with the least output error.

        The descent begins at plays without dead zones.
        """
        from scipy.optimize import least_squares

        plays, mean = self.columns.shape[1], float(self.y.mean())
        theta = _bounded(self.columns, self.y - mean, self.least)
        # Bounds of the slopes of the dead zones: far beyond the slopes of saturating loops
        low = np.concatenate([self.least, [-np.inf], np.full(self.knots.size, 0.01)])
        high = np.concatenate([np.full(plays + 1, np.inf), np.full(self.knots.size, 1000.0)])
        found = least_squares(
            self._residual,
            np.concatenate([np.maximum(theta, self.least), [mean], np.ones(self.knots.size)]),
            self._jacobian,
            bounds=(low, high),
            x_scale="jac",
            max_nfev=_MOST_STEPS,
        )
        return self._parts(np.asarray(found.x))

    def corners(self, compliance: FloatArray) -> FloatArray:
        """Return the (K,) knots as outputs of the plays."""
        return self._lengths(self.knots) @ compliance

    @property
    def _centre(self) -> int:
        return int(np.count_nonzero(self.knots < 0))

    def _parts(self, p: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        plays = self.columns.shape[1]
        return p[:plays], float(p[plays]), np.insert(p[plays + 1 :], self._centre, 1.0)

    def _lengths(self, y: FloatArray) -> FloatArray:
        """(T, K + 1) signed lengths of the interval from the origin to y within each piece."""
        low = np.concatenate([[-np.inf], self.knots])
        high = np.concatenate([self.knots, [np.inf]])
        return np.asarray(np.clip(y[:, None], low, high) - np.clip(0.0, low, high))

    def _output(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the (T,) outputs, and the compliances of their pieces."""
        theta, shift, compliance = self._parts(p)
        x = shift + self.columns @ theta
        corners = self.corners(compliance)
        piece = np.searchsorted(corners, x)
        from_x = np.insert(corners, self._centre, 0.0)[piece]
        from_y = np.insert(self.knots, self._centre, 0.0)[piece]
        return from_y + (x - from_x) / compliance[piece], compliance[piece]

    def _residual(self, p: FloatArray) -> FloatArray:
        return self._output(p)[0] - self.y

    def _jacobian(self, p: FloatArray) -> FloatArray:
        y, local = self._output(p)
        others = np.delete(self._lengths(y), self._centre, axis=1)
        moved = np.hstack([self.columns, np.ones((y.size, 1)), -others])
        return np.asarray(moved / local[:, None])


def _columns(plays: FloatArray, across: float) -> FloatArray:
    """Return the plays less their means, as columns of the bounded parameters."""
    columns = (plays - plays.mean(axis=0)) / across
    # The column of a play that never moves is rounding, and must not get a weight.
    still = np.ptp(columns, axis=0) <= _STILL
    return np.where(still, 0.0, columns)


def _bounded(columns: FloatArray, target: FloatArray, least: FloatArray) -> FloatArray:
    """Return the least-squares solution with lower bounds, from the small triangular factor."""
    from scipy.optimize import nnls

    table = np.column_stack([columns, target - columns @ least])
    factor = np.asarray(np.linalg.qr(table, mode="r"))
    above, _ = nnls(factor[:, :-1], factor[:, -1], maxiter=30 * columns.shape[1])
    return np.asarray(least + above)


def _middle_piece(y: FloatArray, knots: FloatArray) -> float:
    """Return the middle of the piece between knots that contains the middle of y."""
    low, high = float(y.min()), float(y.max())
    ends = np.concatenate([[low], knots, [high]])
    piece = int(np.searchsorted(knots, (low + high) / 2))
    return float(ends[piece] + ends[piece + 1]) / 2


def _half_range(values: FloatArray) -> float:
    return float(values.max() - values.min()) / 2


def _as_count(name: str, value: npt.ArrayLike, *, least: int) -> int:
    count = np.asarray(value)
    if count.dtype.kind not in "iu" or int(count) < least:
        raise ParameterError(f"{name} is {value!r}; give an array, or a whole number >= {least}")
    return int(count)


def _as_numbers(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"{name} are not an array of numbers: {error}") from None


def _require_samples(samples: int, unknowns: int) -> None:
    if samples < unknowns:
        raise SignalError(
            f"{samples} measured samples for {unknowns} unknowns; record more, or ask for fewer "
            "radii or thresholds"
        )

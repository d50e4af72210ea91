"""Least squares for weighted plays, plain and bent by dead zones.

Everything is solved in normalised units, input and output both divided by half their swing,
so that a field in 1e5 A/m and a moment in 1e-7 A m2 cost no digits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_samples, frozen
from minorloop.errors import ParameterError, SignalError

LEAST_SLOPE = 1e-4
"""Of plays, in output swing over input swing: what keeps a fitted operator invertible."""

_FLATTEST, _STEEPEST = 1e-3, 1e2
"""Bounds of the slopes of the dead zones."""
_STILL = 1e-9


class BentPlays(NamedTuple):
    """A fit of plays bent by dead zones, in the units of the record."""

    weights: FloatArray
    shift: float
    knots: FloatArray
    slopes: FloatArray
    centre: float


def as_record(u: npt.ArrayLike, y: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Inputs and outputs of one length, neither constant; NaN marks a gap in y.

    Raises
    ------
    SignalError
        If they are not that.
    """
    inputs, outputs = as_samples(u, name="u"), as_samples(y, name="y", gaps=True)
    if inputs.ndim != 1 or inputs.shape != outputs.shape:
        raise SignalError(
            f"u has shape {inputs.shape} and y {outputs.shape}; give (T,) samples of each"
        )
    if inputs.size == 0 or inputs.min() == inputs.max():
        raise SignalError("u is constant or empty; a fit needs an input that moves")
    known = outputs[~np.isnan(outputs)]
    if known.size == 0 or known.min() == known.max():
        raise SignalError("y is constant or has no measured sample; a fit needs outputs that move")
    return inputs, outputs


def choose_radii(u: FloatArray, radii: npt.ArrayLike) -> FloatArray:
    """Radii as given, or so many, evenly from zero to just below half the swing of u.

    Raises
    ------
    ParameterError
        If a count is not a whole number of at least 1, or the first radius is not zero.
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
    """Thresholds as given, or so many, inside the range of y and denser towards its ends.

    Raises
    ------
    ParameterError
        If a count is not a whole number, or thresholds do not increase.
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


def fit_plays(
    u: FloatArray, y: FloatArray, positions: FloatArray, *, signed: bool
) -> tuple[FloatArray, float]:
    """Weights and offset of plays that bring them nearest to a record.

    Parameters
    ----------
    u, y : (T,) arrays
        Record; NaN in y is left out.
    positions : (T, n) array
        Of the plays.
    signed : bool
        Whether running sums are bounded from below, instead of the weights themselves.

    Returns
    -------
    weights : (n,) array
    offset : float

    Raises
    ------
    SignalError
        If there are fewer measured samples than unknowns.
    """
    known = ~np.isnan(y)
    plays, y = positions[known], y[known]
    _require_samples(y.size, plays.shape[1] + 1)
    across, up = _half_swing(u), _half_swing(y)
    basis, least = _basis(plays.shape[1], signed)
    columns = _columns(plays, across, basis)
    weights = basis @ _bounded(columns, (y - y.mean()) / up, least) * up / across
    return weights, float(y.mean() - plays.mean(axis=0) @ weights)


def fit_bent_plays(
    u: FloatArray, y: FloatArray, positions: FloatArray, knots: FloatArray, *, signed: bool
) -> BentPlays:
    """Plays and dead zones that bring ``centre + S(shift + plays)`` nearest to a record.

    Parameters
    ----------
    u, y : (T,) arrays
        Record; NaN in y is left out.
    positions : (T, n) array
        Of the plays.
    knots : (K,) array
        Outputs at which the slope of S changes, increasing.
    signed : bool
        As for `fit_plays`.

    Raises
    ------
    SignalError
        If there are fewer measured samples than unknowns.
    """
    known = ~np.isnan(y)
    plays, y = positions[known], y[known]
    _require_samples(y.size, plays.shape[1] + knots.size + 1)
    across, up = _half_swing(u), _half_swing(y)
    centre = _straight_part(y, knots)
    basis, least = _basis(plays.shape[1], signed)
    mean = plays.mean(axis=0)
    problem = _Bent(
        columns=_columns(plays, across, basis),
        y=(y - centre) / up,
        knots=(knots - centre) / up,
        least=least,
    )
    theta, shift, compliance = problem.solve()
    weights = basis @ theta * up / across
    return BentPlays(
        weights=weights,
        shift=float(shift * up - mean @ weights),
        knots=problem.corners(compliance) * up,
        slopes=frozen(1 / compliance),
        centre=centre,
    )


class _Bent(NamedTuple):
    """The normalised problem: nearest ``S(shift + columns @ theta)`` to y.

    S is described by its inverse, whose pieces lie between fixed knots in y and have slopes
    (compliances) to be found, 1 at the origin. So ``shift + columns @ theta`` equals the sum
    of compliances times the lengths of y within the pieces, which is linear in all unknowns.
    """

    columns: FloatArray
    y: FloatArray
    knots: FloatArray
    least: FloatArray

    def solve(self) -> tuple[FloatArray, float, FloatArray]:
        """Parameters of the plays, shift, compliances, with the least output error found.

        The descent begins at the joint fit and at plain plays: on some loops that saturate hard
        one of them ends in a local minimum, and not always the same one.
        """
        found = [self._refined(start) for start in (self._joint(), self._straight())]
        theta, shift, compliance = self._parts(min(found, key=self._squared_error))
        return theta, shift, compliance

    def _refined(self, start: FloatArray) -> FloatArray:
        from scipy.optimize import least_squares

        plays = self.columns.shape[1]
        low = np.concatenate([self.least, [-np.inf], np.full(self.knots.size, 1 / _STEEPEST)])
        high = np.concatenate([np.full(plays + 1, np.inf), np.full(self.knots.size, 1 / _FLATTEST)])
        found = least_squares(
            self._residual,
            np.clip(start, low, high),
            self._jacobian,
            bounds=(low, high),
            x_scale="jac",
            max_nfev=100,
        )
        return np.asarray(found.x)

    def _squared_error(self, p: FloatArray) -> float:
        return float(np.sum(self._residual(p) ** 2))

    def corners(self, compliance: FloatArray) -> FloatArray:
        """(K,) places of the knots on the axis of the plays."""
        return self._lengths(self.knots) @ compliance

    @property
    def _centre(self) -> int:
        return int(np.count_nonzero(self.knots < 0))

    def _joint(self) -> FloatArray:
        lengths = self._lengths(self.y)
        others = np.delete(lengths, self._centre, axis=1)
        columns = np.hstack([self.columns, -others])
        mean = columns.mean(axis=0)
        target = lengths[:, self._centre]
        least = np.concatenate([self.least, np.full(self.knots.size, 1 / _STEEPEST)])
        found = _bounded(columns - mean, target - target.mean(), least)
        plays = self.columns.shape[1]
        return np.insert(found, plays, target.mean() - mean @ found)

    def _straight(self) -> FloatArray:
        """Plain plays: what bending must not make worse."""
        mean = float(self.y.mean())
        theta = _bounded(self.columns, self.y - mean, self.least)
        return np.concatenate([theta, [mean], np.ones(self.knots.size)])

    def _parts(self, p: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        plays = self.columns.shape[1]
        return p[:plays], float(p[plays]), np.insert(p[plays + 1 :], self._centre, 1.0)

    def _lengths(self, y: FloatArray) -> FloatArray:
        """(T, K + 1) signed lengths of the way from the origin to y within each piece."""
        low = np.concatenate([[-np.inf], self.knots])
        high = np.concatenate([self.knots, [np.inf]])
        return np.asarray(np.clip(y[:, None], low, high) - np.clip(0.0, low, high))

    def _output(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(T,) outputs, and the compliance of the piece that each lies on."""
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


def _basis(plays: int, signed: bool) -> tuple[FloatArray, FloatArray]:
    """Weights as a linear map of bounded parameters, and the lower bounds of those."""
    if signed:
        return np.eye(plays) - np.eye(plays, k=-1), np.full(plays, LEAST_SLOPE)
    least = np.zeros(plays)
    least[0] = LEAST_SLOPE
    return np.eye(plays), least


def _columns(plays: FloatArray, across: float, basis: FloatArray) -> FloatArray:
    """Plays about their means, in terms of the bounded parameters."""
    columns = (plays - plays.mean(axis=0)) / across @ basis
    # A play that never moves leaves a column of rounding, which must not attract a weight.
    still = np.ptp(columns, axis=0) <= _STILL
    return np.where(still, 0.0, columns)


def _bounded(columns: FloatArray, target: FloatArray, least: FloatArray) -> FloatArray:
    """Least squares with lower bounds, on the triangular factor: a few rows, not T."""
    from scipy.optimize import nnls

    table = np.column_stack([columns, target - columns @ least])
    factor = np.asarray(np.linalg.qr(table, mode="r"))
    above, _ = nnls(factor[:, :-1], factor[:, -1], maxiter=30 * columns.shape[1])
    return np.asarray(least + above)


def _straight_part(y: FloatArray, knots: FloatArray) -> float:
    """Middle of the piece between knots that holds the middle of y."""
    low, high = float(y.min()), float(y.max())
    ends = np.concatenate([[low], knots, [high]])
    piece = int(np.searchsorted(knots, (low + high) / 2))
    return float(ends[piece] + ends[piece + 1]) / 2


def _half_swing(values: FloatArray) -> float:
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

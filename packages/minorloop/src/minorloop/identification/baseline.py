"""Baseline that a model has to beat: the best polynomial of the delayed input."""

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.curves import Curves
from minorloop.identification.rough_model import Basis, one_of_each
from minorloop.threads import one_thread

_MOST = 10_000
"""Approximate number of samples to fit polynomials to; more hardly change the coefficients."""
_DEGREES = range(1, 8)
_DELAYS = range(21)
"""Degrees and delays in samples to try; the delays are the lags that ``lag="auto"`` tries."""


def polynomial_nrmse(
    u: FloatArray, y: FloatArray, train: BoolArray, scored: BoolArray, curves: Curves | None = None
) -> float:
    """Error of the best polynomial of degree 1 to 7 of the input delayed by 0 to 20 samples.

    It is the root-mean-square error over the range of the scored output.

    ``u`` and ``y`` (T,): input and output; outputs are read only where ``train`` or ``scored``;
    ``train`` (T,) of bool: samples to fit the polynomial to, and to choose degree and delay on;
    ``scored`` (T,) of bool: samples to score it on; ``curves``: parts of the record within which
    the input is delayed.
    """
    centre, half = (u.max() + u.min()) / 2, (np.ptp(u) / 2) or 1.0
    x = (u - centre) / half
    # A polynomial is arbitrary beyond its fitted inputs.
    x = np.clip(x, x[train].min(), x[train].max())
    first = np.zeros(u.size, dtype=np.int64) if curves is None else curves.first_rows(u.size)

    def late(places: IntArray, delay: int) -> FloatArray:
        return np.asarray(x[np.maximum(places - delay, first[places])])

    rows = np.flatnonzero(train)
    rows = rows[one_of_each(rows.size, _MOST)]
    wanted = y[rows]
    highest = min(max(_DEGREES), rows.size - 1)
    least, chosen = np.inf, (0, min(_DEGREES))
    with one_thread():
        for delay in _DELAYS[: u.size]:
            basis = np.polynomial.chebyshev.chebvander(late(rows, delay), highest)
            errors = _errors(np.asarray(basis, np.float64), wanted)
            for degree, error in enumerate(errors, start=min(_DEGREES)):
                if error < least:
                    least, chosen = error, (delay, degree)
    best_delay, degree = chosen
    powers = np.polynomial.chebyshev.chebvander(late(rows, best_delay), min(degree, highest))
    best, *_ = np.linalg.lstsq(powers, wanted, rcond=None)
    predicted = np.polynomial.chebyshev.chebval(late(np.flatnonzero(scored), best_delay), best)
    return nrmse(predicted - y[scored], y[scored])


def lateness(u: FloatArray, y: FloatArray, rows: BoolArray, curves: Curves) -> float:
    """Correlation of output and play in some rows, after polynomials of the input are subtracted.

    It is negative if loops run clockwise: the output comes before the input.
    """
    places = np.flatnonzero(rows)
    places = places[one_of_each(places.size, _MOST)]
    plays = Basis.of(u, curves, places.size).plays[places]
    # The play of about a tenth of the range, which shows the direction of loops; and the degree of
    # the polynomial
    q, _ = np.linalg.qr(np.polynomial.chebyshev.chebvander(plays[:, 0], 6))
    play, output = (x - q @ (q.T @ x) for x in (plays[:, 2], y[places] - y[places].mean()))
    return float(play @ output / (np.linalg.norm(play) * np.linalg.norm(output) or 1.0))


def _errors(basis: FloatArray, y: FloatArray) -> FloatArray:
    """Sum of squared errors of the polynomials of each degree from 1 on."""
    q, r = np.linalg.qr(basis)
    size = np.abs(r.diagonal())
    # Part of a polynomial that lower degrees do not explain; a smaller part is rounding
    explained = np.where(size > 1e-10 * size[0], (q.T @ y) ** 2, 0.0)
    return np.asarray(y @ y - np.cumsum(explained))[min(_DEGREES) :]


def rms(residual: FloatArray) -> float:
    """Root-mean-square of a residual."""
    return float(np.sqrt(np.mean(residual**2)))


def nrmse(residual: FloatArray, y: FloatArray) -> float:
    """Root-mean-square residual over the peak-to-peak range of the output."""
    return rms(residual) / (float(np.ptp(y)) or 1.0)


def percent(share: float, digits: int = 3) -> str:
    """Return a share as a percentage, with at most three digits if it is huge."""
    # Share from which the percentage has few digits
    return f"{share:.{digits}%}" if share < 100.0 else f"{100 * share:.3g}%"

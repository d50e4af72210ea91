"""Fit a rational transfer function to measured frequency responses."""

import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_samples, as_whole, check_scale
from minorloop.dynamics.linear import Linear
from minorloop.errors import SignalError
from minorloop.figures import Drawn

ComplexArray = npt.NDArray[np.complex128]

HIGHEST_ORDER = 4
"""Most poles."""
_ITERATIONS = 20
_CONVERGED = 1e-9
"""Relative change of the error at which the iteration ends."""
_LOWEST, _HIGHEST = 1e-15, 1e15
"""Least and greatest frequency whose powers do not overflow."""
_LEAST_ITERATED_DAMPING = 1e-3
_REFINED = 3
"""Number of best results of the iteration that are refined."""
_BEYOND = 10.0
"""Factor by which poles may lie beyond the frequencies."""


@dataclass(frozen=True, eq=False)
class RationalFit(Drawn):
    """A transfer function fitted to a frequency response."""

    model: Linear
    """Continuous, stable, with DC gain 1."""
    frequencies: FloatArray
    """Shape (F,). Frequencies in Hz of all responses, one after the other."""
    measured: ComplexArray
    """(F,) complex array. Measured gains."""
    errors: dict[int, float]
    """Relative error of the best fit of each order."""

    @property
    def error(self) -> float:
        """Root-mean-square relative error of the model."""
        return _relative_error(self.model, self.frequencies, self.measured)

    def __str__(self) -> str:
        tried = ", ".join(f"{order}: {error:.2%}" for order, error in self.errors.items())
        lines = [str(self.model), f"{'relative error':<24} {self.error:.2%}"]
        return "\n".join([*lines, f"{'of each order':<24} {tried}"])


def fit_response(
    frequencies: npt.ArrayLike,
    measured: npt.ArrayLike,
    *,
    order: int | Literal["auto"] = "auto",
    zeros: int | None = None,
) -> RationalFit:
    """Fit a transfer function G(s) with G(0) = 1 and all poles in the left half plane.

    Raises a `SignalError` if the shapes differ, a number is zero or not finite, or there are too
    few frequencies; a `ParameterError` if an order is out of its range.

    Parameters
    ----------
    frequencies : (F,) array_like
        Positive frequencies in Hz; they may repeat.
    measured : (F,) or (A, F) complex array_like
        Gains at these frequencies. Rows of several amplitudes are fitted together.
    order : int or "auto"
        Number of poles, 1 to 4. ``"auto"`` minimises the Bayesian information criterion (Schwarz,
        Estimating the dimension of a model, 1978).
    zeros : int, optional
        Number of zeros, at most ``order``. By default, the criterion chooses up to one less than
        poles. Weakly damped poles and zeros in the right half plane must then halve the error,
        because they often fit noise.

    Notes
    -----
    With N = 1 + n_1 s + ... and D = 1 + d_1 s + ..., each iteration minimises the sum of
    abs(N - G D)^2 / abs(G D')^2, where D' is the D of the previous iteration with its unstable
    roots mirrored. The weights make the errors relative. The best results of several initial
    poles are then refined: nonlinear least squares minimises the relative error itself, with
    poles within a decade of the frequencies.

    References
    ----------
    Sanathanan and Koerner, Transfer function synthesis as a ratio of two complex polynomials,
    IEEE TAC 8, 1963.
    """
    hertz, gains = _as_response(frequencies, measured)
    orders = _orders(order, zeros, np.unique(hertz).size)
    forms = [(n, m) for n in orders for m in (range(n) if zeros is None else (zeros,))]
    tried = {form: _fit(hertz, gains, *form) for form in forms}
    fits = {form: model for form, model in tried.items() if model is not None}
    if not fits:
        raise SignalError(
            "the response cannot be fitted; check that all gains belong to one system"
        )
    errors = {form: _relative_error(model, hertz, gains) for form, model in fits.items()}
    usual = [form for form, model in fits.items() if not _unusual(model)]
    least = min((errors[form] for form in usual), default=np.inf)
    # Ratio of errors below which unusual poles and zeros are accepted
    kept = [form for form in fits if form in usual or errors[form] < 0.5 * least]
    count = 2 * gains.size

    def criterion(form: tuple[int, int]) -> float:
        # Relative error that counts as rounding
        squares = errors[form] ** 2 + 1e-9**2
        return count * float(np.log(squares)) + sum(form) * float(np.log(count))

    best = min(kept, key=criterion)
    of_order = {
        n: min((errors[form] for form in fits if form[0] == n), default=np.inf) for n in orders
    }
    return RationalFit(fits[best], hertz, gains, of_order)


def _unusual(model: Linear) -> bool:
    """Whether a pole is weakly damped, or a zero lies in the right half plane."""
    poles, zeros = model.poles, model.zeros
    # Damping ratio below which a pole is unusual
    return bool((-poles.real < 0.1 * np.abs(poles)).any() or (zeros.real >= 0).any())


def _fit(hertz: FloatArray, gains: ComplexArray, poles: int, zeros: int) -> Linear | None:
    """Fit from several initial poles, and return the best; None if a pole was lost."""
    scale = float(2 * np.pi * np.exp(np.mean(np.log(hertz))))
    s = np.asarray(2j * np.pi * hertz / scale, dtype=np.complex128)
    # Frequencies of the initial poles
    corners = np.geomspace(np.abs(s).min(), np.abs(s).max(), 4)
    starts = [np.ones(1)]
    for chosen in itertools.combinations_with_replacement(corners, poles):
        starts.append(np.poly(-np.array(chosen)) / np.prod(chosen))
    found = [_iterated(s, gains, bottom, zeros, poles) for bottom in starts]
    found.sort(key=lambda pair: _distance(s, gains, *pair))
    found += [_refined(s, gains, bottom, zeros) for _, bottom in found[:_REFINED] if bottom[0]]
    top, bottom = min(found, key=lambda pair: _distance(s, gains, *pair))
    powers = scale ** -np.arange(poles, -1, -1.0)
    if bottom[0] == 0:  # a pole was lost; fewer poles are another candidate
        return None
    return Linear(
        (top * powers[-top.size :]) / powers[0], (bottom * powers) / powers[0]
    ).normalised()


def _iterated(
    s: ComplexArray, gains: ComplexArray, bottom: FloatArray, zeros: int, poles: int
) -> tuple[FloatArray, FloatArray]:
    """Iterate from a denominator; return the best numerator and denominator."""
    best, least, before = None, np.inf, np.inf
    for _ in range(_ITERATIONS):
        weight = 1 / np.abs(gains * np.polyval(bottom, s))
        bottom = _stable(_solve(s, gains, weight, zeros, poles)[1])
        top = _numerator(s, gains, bottom, zeros)
        error = _distance(s, gains, top, bottom)
        if error < least or best is None:
            best, least = (top, bottom), error
        if abs(before - error) <= _CONVERGED * error:
            break
        before = error
    assert best is not None
    return best


def _refined(
    s: ComplexArray, gains: ComplexArray, bottom: FloatArray, zeros: int
) -> tuple[FloatArray, FloatArray]:
    """Minimise the relative error near a denominator; return numerator and denominator.

    `_iterated` takes its weights from its previous step, so it does not reach the minimum if no
    rational function has these gains, for example those of several amplitudes.
    """
    from scipy.optimize import least_squares

    roots = np.roots(bottom)
    real, upper = -roots[roots.imag == 0].real, roots[roots.imag > 0]
    sizes = np.concatenate([real, np.abs(upper)])
    damping = -upper.real / np.abs(upper)
    reach = np.abs(s).min() / _BEYOND, np.abs(s).max() * _BEYOND
    low = np.log(np.repeat([reach[0], _LEAST_ITERATED_DAMPING], [sizes.size, damping.size]))
    high = np.log(np.repeat([reach[1], 1.0], [sizes.size, damping.size]))

    def both(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        size, damped = np.exp(x[: sizes.size]), np.exp(x[sizes.size :])
        below = np.ones(1)
        for rate in size[: real.size]:
            below = np.convolve(below, [1 / rate, 1.0])
        for natural, share in zip(size[real.size :], damped, strict=True):
            below = np.convolve(below, [natural**-2, 2 * share / natural, 1.0])
        return _numerator(s, gains, below, zeros), below

    def misfit(x: FloatArray) -> FloatArray:
        error = _misfit(s, gains, *both(x))
        return np.concatenate([error.real, error.imag])

    begin = np.clip(np.log(np.concatenate([sizes, damping])), low, high)
    return both(least_squares(misfit, begin, bounds=(low, high)).x)


def _misfit(
    s: ComplexArray, gains: ComplexArray, top: FloatArray, bottom: FloatArray
) -> ComplexArray:
    return np.polyval(top, s) / np.polyval(bottom, s) / gains - 1


def _distance(s: ComplexArray, gains: ComplexArray, top: FloatArray, bottom: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.abs(_misfit(s, gains, top, bottom)) ** 2)))


def _solve(
    s: ComplexArray, gains: ComplexArray, weight: FloatArray, zeros: int, poles: int
) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator, highest power first, both with constant 1."""
    columns = [s**k for k in range(zeros, 0, -1)] + [-gains * s**k for k in range(poles, 0, -1)]
    found = _real_least_squares(np.column_stack(columns), gains - 1, weight)
    return np.append(found[:zeros], 1.0), np.append(found[zeros:], 1.0)


def _numerator(s: ComplexArray, gains: ComplexArray, bottom: FloatArray, zeros: int) -> FloatArray:
    """Fit the numerator for a given denominator."""
    if zeros == 0:
        return np.ones(1)
    below = np.polyval(bottom, s)
    columns = np.column_stack([s**k for k in range(zeros, 0, -1)]) / below[:, None]
    weight = 1 / np.abs(gains)
    return np.append(_real_least_squares(columns, gains - 1 / below, weight), 1.0)


def _real_least_squares(
    columns: ComplexArray, wanted: ComplexArray, weight: FloatArray
) -> FloatArray:
    rows, right = columns * weight[:, None], wanted * weight
    stacked = np.vstack([rows.real, rows.imag])
    scale = np.linalg.norm(stacked, axis=0)
    scale[scale == 0] = 1.0
    answer = np.linalg.lstsq(stacked / scale, np.concatenate([right.real, right.imag]), rcond=None)
    return np.asarray(answer[0] / scale)


def _stable(bottom: FloatArray) -> FloatArray:
    """Mirror the roots of the right half plane, and scale the constant to 1."""
    roots = np.roots(bottom / np.abs(bottom).max())
    left = (
        -np.maximum(np.abs(roots.real), _LEAST_ITERATED_DAMPING * np.abs(roots)) + 1j * roots.imag
    )
    mirrored = np.atleast_1d(np.real(np.poly(left)))
    padded = np.concatenate([np.zeros(bottom.size - mirrored.size), mirrored])
    return np.asarray(padded / padded[-1])


def _relative_error(model: Linear, hertz: FloatArray, gains: ComplexArray) -> float:
    error = model.response(hertz) / gains - 1
    return float(np.sqrt(np.mean(np.abs(error) ** 2)))


def _as_response(
    frequencies: npt.ArrayLike, measured: npt.ArrayLike
) -> tuple[FloatArray, ComplexArray]:
    hertz = as_samples(np.atleast_1d(frequencies), name="frequencies")
    gains = np.atleast_2d(np.asarray(measured, dtype=np.complex128))
    if hertz.ndim != 1 or gains.ndim != 2 or gains.shape[1] != hertz.size:
        raise SignalError(
            f"frequencies have shape {hertz.shape} and gains {np.shape(measured)}; give (F,) "
            "frequencies and (F,) or (A, F) gains"
        )
    low, high = float(hertz.min()), float(hertz.max())
    if not (low > 0 and _LOWEST <= low <= high <= _HIGHEST):
        found = low if low < _LOWEST else high
        raise SignalError(
            f"a frequency is {found:g} Hz; give frequencies from {_LOWEST:g} to {_HIGHEST:g} Hz"
        )
    if not np.isfinite(gains).all() or (gains == 0).any():
        raise SignalError("a gain is zero or not finite; remove its frequency")
    check_scale("gain", np.abs(gains))
    return np.tile(hertz, gains.shape[0]), gains.ravel()


def _orders(order: int | Literal["auto"], zeros: int | None, points: int) -> list[int]:
    if order == "auto":
        least = 1 if zeros is None else max(zeros, 1)
        wanted = [n for n in range(least, HIGHEST_ORDER + 1) if n == least or n < points]
    else:
        wanted = [as_whole("order", order, 1, HIGHEST_ORDER)]
    if zeros is not None:
        as_whole("zeros", zeros, 0, wanted[-1])
    if points < wanted[0]:
        raise SignalError(
            f"{points} frequencies for {wanted[0]} poles; measure at more frequencies, or give a "
            "lower order"
        )
    return wanted

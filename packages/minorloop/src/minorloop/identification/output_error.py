"""Difference equations from records: equation error first, then output error.

A difference equation A(q) y = B(q) u, with a = (a_1, ..., a_na) after the leading 1 of A and
b = (b_1, ..., b_nb) from the ``delay``-th sample on, is fitted to records that begin at rest.
Least squares on the equation (ARX) is one linear solve, but noise on the output biases it. Then the
error of the simulated output, which has no such bias, is minimised.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray

_EVALUATIONS = 100
_SMALLEST_GAIN, _SMALLEST_STEP = 1e-10, 1e-13
_EDGE = 1 - 1e-7
"""Largest magnitude of a stable pole."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """One record of deviations from rest, evenly sampled."""

    u: FloatArray
    """Shape (T,). Input minus the input at rest; u[k] lasts from sample k to the next."""
    y: FloatArray
    """Shape (T,). Output minus the output at rest; y[k] is measured at sample k."""


@dataclass(frozen=True)
class Structure:
    """Numbers of coefficients, and delay of the input in samples."""

    na: int
    nb: int
    delay: int

    @property
    def parameters(self) -> int:
        """Coefficients of A and B."""
        return self.na + self.nb


@dataclass(frozen=True, eq=False)
class Coefficients:
    """A = 1 + a_1 q^-1 + ..., B = b_1 q^-delay + b_2 q^-(delay + 1) + ..."""

    a: FloatArray
    """Shape (na,). """
    b: FloatArray
    """Shape (nb,). """
    delay: int

    @property
    def poles(self) -> FloatArray:
        """(na,) complex, in the z-plane."""
        return np.asarray(np.roots(self._whole))

    @property
    def stable(self) -> bool:
        """Whether all poles are inside the unit circle, by more than rounding."""
        return bool((np.abs(self.poles) < _EDGE).all())

    @property
    def dc_gain(self) -> float:
        """Settled output per input."""
        return float(self.b.sum() / self._whole.sum())

    def simulate(self, u: FloatArray) -> FloatArray:
        """Output (T,) from rest."""
        return self._filtered(np.concatenate([np.zeros(self.delay), self.b]), u)

    def sensitivities(self, u: FloatArray) -> FloatArray:
        """(T, na + nb) derivatives of the simulated output with respect to a and b."""
        by_output = self._filtered(np.ones(1), self.simulate(u))
        by_input = self._filtered(np.ones(1), u)
        columns = [-_shifted(by_output, i + 1) for i in range(self.a.size)]
        columns += [_shifted(by_input, self.delay + i) for i in range(self.b.size)]
        return np.column_stack(columns)

    @property
    def _whole(self) -> FloatArray:
        return np.concatenate([[1.0], self.a])

    def _filtered(self, top: FloatArray, x: FloatArray) -> FloatArray:
        from scipy.signal import lfilter

        return np.asarray(lfilter(top, self._whole, x))


def equation_error(stretches: Sequence[Stretch], structure: Structure) -> Coefficients:
    """ARX by least squares: rows [-y(t-1) ... -y(t-na), u(t-delay) ...].

    ``stretches``: records from rest; ``structure``: numbers of coefficients.

    References
    ----------
    Ljung, System Identification, 2nd edition, 1999, eq. 4.11: the regression. Solved by a QR
    factorisation with unit columns.
    """
    rows, wanted = [], []
    for one in stretches:
        columns = [-_shifted(one.y, i + 1) for i in range(structure.na)]
        columns += [_shifted(one.u, structure.delay + i) for i in range(structure.nb)]
        rows.append(np.column_stack(columns))
        wanted.append(one.y)
    theta = _solve(np.vstack(rows), np.concatenate(wanted))
    return Coefficients(theta[: structure.na], theta[structure.na :], structure.delay)


def output_error(stretches: Sequence[Stretch], structure: Structure) -> Coefficients | None:
    """Find the stable coefficients whose simulated output is nearest to the measured output.

    A trust region method begins at the minimum of the equation error; None if that is unstable. A
    constant is also fitted to each stretch, so that an error of its rest has no effect.
    """
    from scipy.optimize import least_squares

    found, samples = equation_error(stretches, structure), sum(one.y.size for one in stretches)
    if not found.stable:
        return None

    def at(x: FloatArray) -> Coefficients:
        return Coefficients(x[: structure.na], x[structure.na :], structure.delay)

    def errors(x: FloatArray) -> FloatArray:
        if not at(x).stable:
            return np.full(samples, np.inf)  # makes the solver take a shorter step
        return np.concatenate(residuals(stretches, at(x)))

    def slopes(x: FloatArray) -> FloatArray:
        return -jacobian(stretches, at(x))

    answer = least_squares(
        errors,
        np.concatenate([found.a, found.b]),
        jac=slopes,
        x_scale="jac",
        ftol=_SMALLEST_GAIN,
        xtol=_SMALLEST_STEP,
        gtol=None,  # its unit is that of the output squared
        max_nfev=_EVALUATIONS,
    )
    return at(answer.x)


def residuals(stretches: Sequence[Stretch], found: Coefficients) -> list[FloatArray]:
    """Measured less simulated output of each stretch, less its mean."""
    each = [one.y - found.simulate(one.u) for one in stretches]
    return [error - error.mean() for error in each]


def cost(stretches: Sequence[Stretch], found: Coefficients) -> float:
    """Sum of squares of the output errors."""
    return float(sum(np.sum(error**2) for error in residuals(stretches, found)))


def jacobian(stretches: Sequence[Stretch], found: Coefficients) -> FloatArray:
    """(samples, na + nb) derivatives of all simulated outputs, less their means."""
    each = [found.sensitivities(one.u) for one in stretches]
    return np.vstack([columns - columns.mean(axis=0) for columns in each])


def covariance(stretches: Sequence[Stretch], found: Coefficients) -> FloatArray:
    """(na + nb, na + nb) covariance of the coefficients.

    Errors of a model that is too simple are correlated; the variance is multiplied by their
    correlation time.
    """
    columns = jacobian(stretches, found)
    errors = residuals(stretches, found)
    free = max(columns.shape[0] - columns.shape[1] - len(stretches), 1)
    variance = sum(float(np.sum(error**2)) for error in errors) / free
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    inverse = np.linalg.pinv(columns / scale)
    return np.asarray(
        variance * correlation_time(errors) * (inverse @ inverse.T) / np.outer(scale, scale)
    )


def correlation_time(errors: Sequence[FloatArray]) -> float:
    """Samples for each independent error: 1 + 2 times the sum of autocorrelations.

    The sum ends before the first negative term (Sokal, Monte Carlo methods, 1997, section 3).
    """
    power = sum(float(error @ error) for error in errors)
    total = 1.0
    for lag in range(1, max(error.size for error in errors) // 2 if power > 0 else 1):
        together = sum(float(error[lag:] @ error[:-lag]) for error in errors if error.size > lag)
        if together <= 0:
            break
        total += 2 * together / power
    return total


def _solve(rows: FloatArray, wanted: FloatArray) -> FloatArray:
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = 1.0
    q, r = np.linalg.qr(rows / scale)
    return np.asarray(np.linalg.lstsq(r, q.T @ wanted, rcond=1e-14)[0] / scale)


def _shifted(x: FloatArray, samples: int) -> FloatArray:
    """Delay a signal by ``samples``, from rest."""
    if samples == 0:
        return x
    return np.concatenate([np.zeros(min(samples, x.size)), x[:-samples]])

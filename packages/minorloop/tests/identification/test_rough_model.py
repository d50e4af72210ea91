import numpy as np

from fault_records import record
from minorloop.identification.curves import Curves
from minorloop.identification.rough_model import RoughRecord, chebyshev_sums, least_error
from minorloop.lab.noise import spread

WHOLE = Curves.whole("negative")


def test_the_rough_model_follows_a_record_with_outliers():
    u, y = record()
    spoilt = y.copy()
    spoilt[::40] += 5 * np.ptp(y)
    rough = RoughRecord.of(u, spoilt, np.ones(u.size, dtype=bool), WHOLE, 0)
    assert spread(rough.rough - y) < 0.02 * np.ptp(y)
    assert np.abs(rough.rough - y).max() < 0.2 * np.ptp(y)


def test_the_rough_model_is_the_sum_of_its_polynomials():
    u, y = record()
    basis = RoughRecord.of(u, y, np.ones(u.size, dtype=bool), WHOLE, 0).basis
    rows, found = basis.rows(slice(None)), np.linspace(1, 2, basis.columns)
    assert rows.shape == (u.size, basis.columns)
    sums = chebyshev_sums(basis.plays, found[1:].reshape(-1, basis.degree), found[0])
    np.testing.assert_allclose(sums, rows @ found)
    assert least_error(rows, y) < 0.01 * np.ptp(y)

import numpy as np
import pytest

from minorloop.connect import connect
from minorloop.identification.adaptive import VALIDATION, Adaptive, _Progress


def experiment(chooser, specimen=1, outlier_at=None, upto=1000):
    """Run it on a strip; disturb the measurement of one hold."""
    strip = connect("twin:ipmc", specimen=specimen, noise=0.1, seed=specimen)
    u, y = [], []
    while len(u) < upto and (level := chooser.choose(u, y)) is not None:
        u.append(level)
        y.append(strip.apply(level, 200.0, 200.0).y[-1])
        if len(u) - 1 == outlier_at:
            y[-1] += 3.0
    return u, y


@pytest.fixture(scope="module")
def done():
    chooser = Adaptive(-1.2, 1.2)
    return chooser, *experiment(chooser)


def test_twelve_holds_and_a_validation_that_is_never_fitted(done):
    chooser, u, y = done
    assert chooser.roles(u, y) == ["design"] * 12 + ["validation"] * VALIDATION
    fit = chooser.identification(u, y)
    np.testing.assert_array_equal(fit.u, u)
    np.testing.assert_array_equal(np.flatnonzero(fit.fitted), np.arange(12))
    np.testing.assert_array_equal(np.flatnonzero(fit.held_out), np.arange(12, 16))
    score = chooser.validation(u, y)
    assert score.nrmse < 0.015
    assert score.covered >= 3
    assert score.trusted
    assert np.sort((np.array(u[12:]) + 1.2) // 0.6).tolist() == [0, 1, 2, 3]
    assert len(set(np.sign(np.diff(u[12:])))) == 2
    np.testing.assert_array_equal(score.measured, y[12:])


def test_what_comes_next_depends_on_the_points_alone(done):
    _, u, y = done
    for count in (0, 3, 9, 12, 14):
        again = Adaptive(-1.2, 1.2)
        assert again.choose(u[:count], y[:count]) == u[count]


def test_an_outlier_is_repeated_and_left_out():
    chooser = Adaptive(-1.2, 1.2)
    u, y = experiment(chooser, outlier_at=8, upto=11)
    roles = chooser.roles(u, y)
    assert roles[8:10] == ["outlier", "repeat"]
    assert u[9] == u[8]
    assert not chooser.identification(u, y).fitted[8]


def test_a_repeated_reading_is_accepted_flagged_and_widens_the_bands():
    """The same far reading twice is the plant, not an outlier."""
    chooser = Adaptive(-1.2, 1.2)
    u, y = experiment(chooser, outlier_at=8, upto=10)
    twice = [*y[:9], y[8]]
    assert chooser.roles(u, twice)[8:10] == ["design", "repeat"]
    assert chooser.changes(u, twice) == [8]
    assert chooser.changes(u, y) == []
    sd = chooser.identification(u, twice).predict(u, bands=0.9).sd
    assert sd.min() > 2.0  # It read 3.0 too much.


@pytest.mark.parametrize(("at", "bad"), [(2, np.nan), (8, np.inf), (13, np.nan)])
def test_a_missing_reading_is_measured_again(done, at, bad):
    chooser, u, y = done
    y = [*y[:at], bad]
    assert chooser.choose(u[: at + 1], y) == u[at]
    score = chooser.validation([*u[: at + 1], u[at]], [*y, done[2][at]])
    assert score is None or np.isfinite(score.nrmse)


def test_what_is_missing_to_the_end_is_not_scored(done):
    chooser, u, y = done
    score = chooser.validation([*u[:13], *[u[13]] * 4], [*y[:13], *[np.nan] * 4])
    assert score.measured.size == 1
    assert np.isfinite(score.nrmse)


@pytest.mark.parametrize("surprising", ["always", "never"])
def test_never_spends_the_validation(surprising, monkeypatch):
    """Whatever is repeated, and however that ends."""
    away = (1.0, 1e-9 if surprising == "always" else 1.0)
    monkeypatch.setattr(_Progress, "_deviation", lambda *_: away)
    chooser = Adaptive(-1.0, 1.0, holds=8)
    u, y = measured(chooser, lambda k, u: u)
    assert len(u) == 12 + (3 if surprising == "always" else 0)
    assert chooser.roles(u, y)[-1] == "validation"
    assert len(set(u[-VALIDATION:])) == VALIDATION


def test_stops_early_where_holds_gain_too_little():
    chooser = Adaptive(-1.2, 1.2, holds=40, least_gain=0.05)
    u, y = experiment(chooser, 2)
    roles = chooser.roles(u, y)
    assert 4 <= roles.count("design") < 20
    assert roles[-VALIDATION:] == ["validation"] * VALIDATION


def measured(chooser, reads):
    u, y = [], []
    while (level := chooser.choose(u, y)) is not None:
        u.append(level)
        y.append(reads(len(y), level))
    return u, y

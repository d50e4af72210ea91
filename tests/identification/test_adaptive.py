import numpy as np
import pytest

from minorloop.connect import connect
from minorloop.errors import ParameterError
from minorloop.identification.adaptive import VALIDATION, Adaptive


def experiment(chooser, specimen=1, knocked_at=None, upto=1000):
    """Carry it out on a strip; knock the measurement of one hold."""
    strip = connect("twin:ipmc", specimen=specimen, noise=0.1, seed=specimen)
    u, y = [], []
    while len(u) < upto and (level := chooser.choose(u, y)) is not None:
        u.append(level)
        y.append(strip.apply(level, 200.0, 200.0).y[-1])
        if len(u) - 1 == knocked_at:
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
    np.testing.assert_array_equal(fit.u, u[:12])
    score = chooser.validation(u, y)
    assert score.nrmse < 0.015
    assert score.covered >= 3
    np.testing.assert_array_equal(score.measured, y[12:])


def test_what_comes_next_depends_on_the_points_alone(done):
    _, u, y = done
    for count in (0, 3, 9, 12, 14):
        again = Adaptive(-1.2, 1.2)
        assert again.choose(u[:count], y[:count]) == u[count]


def test_a_knocked_hold_is_repeated_and_left_out():
    chooser = Adaptive(-1.2, 1.2)
    u, y = experiment(chooser, knocked_at=8, upto=11)
    roles = chooser.roles(u, y)
    assert roles[8:10] == ["knocked", "repeat"]
    assert u[9] == u[8]
    assert not chooser.identification(u, y).fitted[8]


def test_what_repeats_itself_is_believed():
    """The same far reading twice is the plant, not a knock."""
    chooser = Adaptive(-1.2, 1.2)
    u, y = experiment(chooser, knocked_at=8, upto=10)
    roles = Adaptive(-1.2, 1.2).roles(u, [*y[:9], y[8]])
    assert roles[8:10] == ["design", "design"]


def test_stops_early_where_holds_gain_too_little():
    chooser = Adaptive(-1.2, 1.2, holds=40, least_gain=0.05)
    u, y = experiment(chooser, 2)
    roles = chooser.roles(u, y)
    assert 4 <= roles.count("design") < 20
    assert roles[-VALIDATION:] == ["validation"] * VALIDATION


def test_keeps_to_the_step():
    u, _ = experiment(Adaptive(-1.2, 1.2, holds=6, step=0.5))
    assert np.abs(np.diff(u)).max() <= 0.5 * (1 + 1e-12)


def test_a_run_stopped_after_three_holds_gives_a_model_with_wide_bands(done):
    chooser, u, y = done
    early = Adaptive(-1.2, 1.2).identification(u[:3], y[:3])
    late = chooser.identification(u, y)
    grid = np.linspace(-1.2, 1.2, 30)
    assert np.mean(early.predict(grid, bands=0.9).sd) > 3 * np.mean(
        late.predict(grid, bands=0.9).sd
    )
    assert Adaptive(-1.2, 1.2).validation(u[:3], y[:3]) is None


@pytest.mark.parametrize(
    ("options", "says"),
    [({"holds": 2}, "holds is 2"), ({"least_gain": 1.5}, "least_gain is 1.5")],
)
def test_refuses(options, says):
    with pytest.raises(ParameterError, match=says):
        Adaptive(0.0, 1.0, **options)

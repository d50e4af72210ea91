import numpy as np
import pytest

from minorloop.errors import ParameterError, SignalError
from minorloop.identification import excitation, identify
from minorloop.identification.reversal_curves import identify_reversal_curves
from minorloop.lab.columns import read_columns
from minorloop.operators.preisach import Preisach

LEVELS = np.linspace(-1.2, 1.2, 11)


def a_plane(seed=0, **options):
    weights = np.tril(np.random.default_rng(seed).uniform(0, 1, (10, 10)))
    return Preisach(LEVELS, weights, 3.0, **options)


def a_record(samples=1500, noise=0.005, **options):
    rng = np.random.default_rng(5)
    u = rng.uniform(-1.2, 1.2, samples)
    y = a_plane(**options).simulate(u)
    return u, y + noise * np.ptp(y) * rng.normal(size=samples)


@pytest.mark.parametrize("options", [{}, {"smoothness": 0.0}])
@pytest.mark.parametrize("unit", [1e-7, 1.0, 1e6])
def test_a_plane_is_found_from_its_decaying_staircase(options, unit):
    plane, u = a_plane(), excitation.decaying_staircase(LEVELS)
    found = identify(u, unit * plane.simulate(u), levels=LEVELS, **options)
    error = np.abs(found.model.weights - unit * plane.weights).max()
    assert error <= 1e-10 * unit * plane.weights.max()
    assert (found.rank, found.unknowns, found.samples) == (56, 56, 56)
    assert found.condition == pytest.approx(73, rel=0.02)
    assert found.kkt < 1e-10
    assert found.model.offset == pytest.approx(unit * 3.0)


@pytest.mark.parametrize(
    "options", [{"relay": "unipolar"}, {"diagonal": "reversible"}, {"slope": 0.7}]
)
def test_so_is_every_other_structure(options):
    plane, u = a_plane(**options), excitation.decaying_staircase(LEVELS)
    u = np.concatenate([u, np.random.default_rng(0).uniform(-1.2, 1.2, 200)])
    wanted = {**options, "slope": True} if "slope" in options else options
    found = identify(u, plane.simulate(u), levels=LEVELS, smoothness=0.0, **wanted)
    np.testing.assert_allclose(found.model.weights, plane.weights, atol=1e-8)
    assert found.model.slope == pytest.approx(plane.slope, abs=1e-8)


def test_reversal_curves_give_the_plane_without_a_fit():
    plane, u = a_plane(), excitation.reversal_curves(LEVELS)
    y = plane.simulate(u)
    np.testing.assert_allclose(
        identify_reversal_curves(u, y, LEVELS).weights, plane.weights, atol=1e-12
    )
    y[7] = np.nan
    with pytest.raises(SignalError, match="1 reversal values are missing"):
        identify_reversal_curves(u, y, LEVELS)


def test_scores_are_what_they_say():
    u, y = a_record()
    found = identify(u, y, levels=10, holdout=0.25)
    assert found.fitted.sum() == 1125
    assert found.held_out[1125:].all()
    predicted = found.model.simulate(u)
    np.testing.assert_array_equal(found.predict(u), predicted)
    error = (predicted - y)[1125:]
    assert found.holdout_nrmse == pytest.approx(np.sqrt(np.mean(error**2)) / np.ptp(y[1125:]))
    assert found.rmse == pytest.approx(np.sqrt(np.mean((predicted - y)[:1125] ** 2)))
    assert found.nrmse == pytest.approx(found.rmse / np.ptp(y[:1125]))
    assert found.holdout_nrmse < 0.01 < found.baseline_nrmse
    assert "held out" in str(found)


def test_samples_not_measured_move_the_memory_only():
    u, y = a_record(noise=0.0)
    gaps = np.random.default_rng(1).uniform(size=y.size) < 0.5
    found = identify(u, np.where(gaps, np.nan, y), levels=LEVELS)
    assert found.samples == np.count_nonzero(~gaps)
    np.testing.assert_allclose(found.model.weights, a_plane().weights, atol=1e-7)


@pytest.mark.parametrize("lag", [0, 3, 11])
def test_a_lag_is_found_and_put_back(lag):
    u, y = a_record()
    late = np.concatenate([np.full(lag, y[0]), y[: y.size - lag]])
    found = identify(u, late, levels=LEVELS, lag="auto")
    assert found.lag == lag
    np.testing.assert_allclose(found.predict(u)[lag:], late[lag:], atol=0.05 * np.ptp(y))


def test_adaptive_levels_crowd_where_the_output_is_steep():
    u = np.concatenate([np.linspace(-1, 1, 500), np.linspace(1, -1, 500)])
    y = np.tanh(12 * (u - 0.1 * np.repeat([1, -1], 500)))
    grid = identify(u, y, levels=20, spacing="adaptive").model.levels
    steps = np.diff(grid)
    assert (grid[0], grid[-1]) == (-1, 1)
    assert steps[np.abs(grid[:-1]) < 0.2].mean() < 0.5 * steps[np.abs(grid[:-1]) > 0.6].mean()


def test_signed_weights_fit_a_butterfly():
    i = np.arange(10)
    butterfly = Preisach(LEVELS, np.tril(1.0 * np.sign(i[:, None] + i - 9)))
    u, _ = a_record()
    y = butterfly.simulate(u)
    plain, signed = (identify(u, y, levels=LEVELS, signed=signed) for signed in (False, True))
    assert signed.nrmse < 1e-6 < 0.1 < plain.nrmse
    np.testing.assert_allclose(signed.model.weights, butterfly.weights, atol=1e-4)
    assert "cannot be inverted" in " ".join(signed.advice)


@pytest.mark.parametrize(
    ("u", "y", "says"),
    [
        (excitation.major_loop(LEVELS), None, "one major loop"),
        (LEVELS[[0, 10, 1, 9, 2, 8, 3, 7, 4, 6, 5]], None, "reversal points only"),
        (a_record(30)[0], None, "30 samples for 56 unknowns"),
    ],
)
def test_a_poor_input_is_said_to_be_one(u, y, says):
    advice = " ".join(identify(u, a_plane().simulate(u), levels=LEVELS).advice)
    assert says in advice
    assert "no data were held out" in advice


def test_other_advice():
    u, y = a_record()
    assert "widen the levels" in " ".join(identify(1.1 * u, y, levels=LEVELS).advice)
    polynomial = identify(u, u**3, levels=3, holdout=0.3)
    assert "polynomial of the delayed input is better" in " ".join(polynomial.advice)
    changed = np.where(np.arange(y.size) > 1000, y + 10, y)
    assert "more than twice" in " ".join(identify(u, changed, levels=10, holdout=0.3).advice)
    assert identify(u, y, levels=LEVELS, holdout=0.3).advice == ()


def test_draws_itself(tmp_path):
    u, y = a_record()
    identify(u, y, levels=5, holdout=0.3).plot().savefig(tmp_path / "fit.png")
    assert (tmp_path / "fit.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("u", "y", "says"),
    [
        ([0, 1, 2], [0, 1], "3 samples and y has 2"),
        ([0, 1, 2, 3], [0, np.nan, np.nan, 1], "2 outputs are finite"),
        ([1, 1, 1], [0, 1, 2], "the input is 1 throughout"),
        (
            [0, 1, 2],
            [9.9e37, 9.9e37, 9.9e37],
            r"all 3 outputs are overload codes, as 9.9e\+37 is",
        ),
        ([0, 1, 2, 3], [9.9e37, 9.91e37, 1, 2], "2 of 4 outputs are overload codes"),
        ([0, 1, 2], [1, 1, 1], "the output is 1 throughout"),
        ([0, np.nan, 2], [1, 2, 3], "u is nan at index 1"),
        ([0, 1, 2], [1, np.inf, 3], "y is inf at index 1"),
        ([[0, 1, 2]], [[1, 2, 3]], "give one record"),
        (["a", "b", "c"], [1, 2, 3], "real numbers"),
    ],
)
def test_refuses_records_that_say_nothing(u, y, says):
    with pytest.raises(SignalError, match=says):
        identify(u, y)


def test_what_is_held_out_of_a_record_of_codes_says_how_many_were_left_out():
    y = np.full(20, 9.9e37)
    y[[2, 5, 9]] = 1.0, 2.0, 3.0
    with pytest.raises(ParameterError, match="2 of 3 measured samples to fit, 17 codes of the"):
        identify(np.arange(20.0), y, holdout=0.2)


@pytest.mark.parametrize(
    "options",
    [
        {"levels": 0},
        {"levels": 2.5},
        {"levels": True},
        {"levels": [1, 0]},
        {"levels": [0, np.nan]},
        {"levels": 251},
        {"spacing": "odd"},
        {"relay": "odd"},
        {"diagonal": "odd"},
        {"smoothness": "odd"},
        {"lag": "odd"},
        {"lag": 5000},
        {"lag": 1.0},
        {"start": "odd"},
        {"holdout": 0.95},
        {"holdout": "some"},
        {"slope": "steep"},
        {"signed": 1},
    ],
)
def test_refuses_options_out_of_range(options):
    with pytest.raises(ParameterError, match=r"give|needed|sort|must be"):
        identify(*a_record(100), **options)


def test_piezo_minor_loops_are_predicted(shared_data):
    columns = read_columns(
        shared_data / "piezo_micromanipulator_minor_loops.csv", ["input_V", "displacement_um"]
    )
    u, y = (column[200:7000] for column in columns.values())
    found = identify(u, y, levels=25, lag="auto", holdout=2500 / 6800)
    assert found.holdout_nrmse <= 0.008
    assert found.holdout_nrmse < found.baseline_nrmse


def test_one_real_major_loop_is_said_to_be_one(shared_data):
    columns = read_columns(
        shared_data / "piezo_micromanipulator_model.csv", ["input_V", "displacement_um"]
    )
    u, y = (column[200:] for column in columns.values())
    assert "one major loop" in " ".join(identify(u, y, levels=25, lag=3, holdout=0.3).advice)


def reversal_record(folder, name, field, moment, parity):
    path = folder / name
    table = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    top, u, y = table[field].max(), [], []
    for curve in np.unique(table["curve"])[parity::2]:
        rows = (table["curve"] == curve) & (table["kind"] == "curve")
        u += [top, *table[field][rows]]
        y += [np.nan, *table[moment][rows]]
    return np.array(u), np.array(y)


@pytest.mark.parametrize(
    ("name", "field", "moment", "limit"),
    [
        ("forc_feco_nanowires.csv", "field_Oe", "moment_emu", 0.011),
        ("forc_msm33.csv", "field_T", "moment_Am2", 0.011),
    ],
)
def test_reversal_curves_of_magnets(shared_data, name, field, moment, limit):
    u, y = reversal_record(shared_data, name, field, moment, 0)
    found = identify(u, y, levels=51, spacing="adaptive", start="positive")
    u, y = reversal_record(shared_data, name, field, moment, 1)
    seen = np.isfinite(y)
    error = (found.model.simulate(u, "positive") - y)[seen]
    assert np.sqrt(np.mean(error**2)) <= limit * np.ptp(y[seen])


def test_noise_alone_is_not_taken_for_hysteresis():
    rng = np.random.default_rng(0)
    u, y = rng.normal(size=(2, 800))
    advice = " ".join(identify(u, y, levels=8, holdout=0.3).advice)
    assert "is nearly as good" in advice or "does better" in advice


def test_an_output_that_falls_is_said_to():
    u, y = a_record(400)
    assert "reverse the sign of the output" in " ".join(identify(u, -y, levels=10).advice)
    assert "reverse the sign" not in " ".join(identify(u, y, levels=10).advice)


def test_a_smaller_range_at_the_end_is_no_overfitting():
    """The same noise over a smaller range is a larger share of it, and no worse."""
    rng = np.random.default_rng(1)
    t = np.arange(3000)
    u = np.where(t < 2100, 5.0, 0.25) * np.sin(t / 20)
    model = Preisach(np.linspace(-5, 5, 21), np.tril(np.ones((20, 20))))
    y = model.simulate(u) + rng.normal(0, 0.5, t.size)
    found = identify(u, y, levels=20, holdout=0.3)
    assert found.holdout_nrmse > 2 * found.nrmse
    assert "more than twice" not in " ".join(found.advice)


def test_outputs_too_small_to_square_are_refused():
    u, y = a_record(50)
    with pytest.raises(SignalError, match=r"the output changes by .* only; scale it"):
        identify(u, y * 1e-170)

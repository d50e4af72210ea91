import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fixed_options import Plane, identify
from minorloop import Preisach, Record
from minorloop.identification.excitation import decaying_staircase
from minorloop.lab.gaps import bridged, known_memory, with_lost_rows
from minorloop.lab.timebase import check_times

SEEDS = st.integers(0, 2**32 - 1)
T = 0.01 * np.arange(1000)
SINE = np.cos(2 * np.pi * 0.5 * T)


def _cut(u, begin, count):
    """Times and inputs without some samples, and the sample after which they are missing."""
    kept = np.delete(np.arange(u.size), slice(begin, begin + count))
    return T[kept], u[kept], [begin - 1]


def _one_way(u, begin, count):
    """Whether the input is found to go one way across a gap."""
    found = bridged(*_cut(u, begin, count))
    return bool(found.known.all() and not found.turned.any())


@pytest.mark.parametrize("seed", [1000, 1001])
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_a_gap_is_crossed_on_a_smooth_slope_only(seed, noise):
    """The sine turns at every hundredth sample."""
    u = SINE + noise * np.random.default_rng(seed).normal(size=T.size)
    assert _one_way(u, 345, 10)
    assert _one_way(u, 340, 20)
    assert not _one_way(u, 395, 10)  # it turned
    assert not bridged(*_cut(u, 350, 200)).known.any()  # a whole period
    assert not bridged(*_cut(u, 2, 10)).known.any()  # hardly anything before


def test_a_jump_in_a_gap_is_not_crossed_and_a_rest_is():
    steps = np.repeat([0.0, 1.0, -1.0, 0.5], 250)
    assert not bridged(*_cut(steps, 245, 10)).known.any()
    assert _one_way(steps, 345, 30)
    assert not bridged(*_cut(steps, 250, 250)).known.any()  # a whole hold


def test_what_is_said_names_crossed_gaps_and_others():
    kept = np.delete(np.arange(T.size), np.r_[340:350, 395:405, 450:650])
    log = Record(SINE[kept], SINE[kept], T[kept])
    (said,) = log.of_memory
    assert "after 2 of 3 gaps the memory is unknown" in said
    assert said.endswith("in 1 other the input cannot have turned and the memory continues")


class TestMemory:
    @given(seed=SEEDS)
    def test_known_outputs_do_not_depend_on_what_happened_in_the_gap(self, seed):
        chance = np.random.default_rng(seed)
        weights = np.tril(chance.uniform(size=(12, 12)))
        model = Preisach(np.linspace(-1, 1, 13), weights)
        u = np.concatenate([[-1, 1], chance.uniform(-1, 1, 300)])
        place = int(chance.integers(10, 100))
        known = known_memory(u, [place])
        assert known[: place + 1].all()
        for level in (-1.0, 1.0, *chance.uniform(-1, 1, 4)):
            other = np.insert(u, place + 1, level)
            apart = np.delete(model.simulate(other), place + 1) - model.simulate(u)
            assert np.abs(apart[known]).max() <= 0.1 * weights.sum()

    def test_saturation_makes_it_known(self):
        u = np.array([-1, 1, -1, 0.2, 0.1, -0.2, 1.0, 0.3])
        known = known_memory(u, [3])
        assert known.tolist() == [True] * 4 + [False] * 2 + [True] * 2
        assert known_memory(u, []).all()
        assert known_memory(np.ones(4), [1]).all()


class TestLostRows:
    """A table with one row for each hold, 20 s apart, of which 15 of 172 are lost."""

    LEVELS = np.linspace(-1, 1, 19)

    def table(self, seed):
        chance = np.random.default_rng(seed)
        u = decaying_staircase(self.LEVELS)
        model = Preisach(self.LEVELS, np.tril(chance.uniform(0.5, 1.5, (18, 18))))
        lost = chance.choice(np.arange(1, u.size - 1), 15, replace=False)
        return u, model.simulate(u), np.delete(np.arange(u.size), lost)

    @pytest.mark.parametrize("seed", [1000, 1001])
    def test_a_row_that_hid_a_turn_no_longer_spoils_the_fit(self, seed):
        u, y, kept = self.table(seed)
        times = check_times(20.0 * kept)
        log = Record(u[kept], y[kept], times.t)
        assert "15 rows are missing at" in log.notes[-1]
        assert "one row can hide a turn" in log.notes[-1]
        assert "uneven" not in " ".join(log.notes)
        record = log.with_known_memory()
        assert "at an extreme that follows from the steps beside it" in log.of_memory[0]
        assert np.isfinite(log.evenly_sampled().y).sum() <= kept.size
        errors = []
        for inputs, outputs in ((u[kept], y[kept]), (record.u, record.y)):
            model = identify(inputs, outputs, Plane(self.LEVELS)).model
            errors.append(np.sqrt(np.mean((model.simulate(u) - y) ** 2)) / np.ptp(y))
        assert errors[1] < errors[0] / 2

    def test_an_extreme_in_a_lost_row_follows_from_equal_steps(self):
        u = np.array([0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0, 1, 2, 3, 4, 3, 2, 1, 0.0])
        t = np.arange(19.0)
        for lost, extreme in ((5, 5.0), (10, 0.0), (7, np.nan)):
            kept = np.delete(np.arange(19), lost)
            check = with_lost_rows(check_times(t[kept]), u[kept])
            assert check.gaps.tolist() == [lost - 1]
            found = bridged(check.t, u[kept], check.gaps)
            assert found.known.all()
            np.testing.assert_array_equal(found.u, [extreme])

    def test_a_lost_row_among_levels_without_order_leaves_the_memory_unknown(self):
        u = np.random.default_rng(1000).uniform(-1, 1, 60)
        kept = np.delete(np.arange(60), 30)
        check = with_lost_rows(check_times(20.0 * kept), u[kept])
        assert check.gaps.tolist() == [29]
        assert not bridged(check.t, u[kept], check.gaps).known.any()

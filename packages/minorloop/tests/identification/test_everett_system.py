import numpy as np
import pytest

from minorloop.identification import everett_system
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.everett_system import EverettSystem, quick_system
from minorloop.identification.prior import PlanePrior


class TestCounting:
    @pytest.fixture
    def counted(self, monkeypatch):
        """Unknowns of the systems whose order of elimination was searched."""
        sizes, search = [], everett_system.quick_elimination

        def counting(pattern, *rest):
            sizes.append(pattern.shape[0])
            return search(pattern, *rest)

        monkeypatch.setattr(everett_system, "quick_elimination", counting)
        monkeypatch.setattr(everett_system, "_FIRST_PART", 100)
        return sizes

    @pytest.fixture
    def steps(self):
        u = np.random.default_rng(2).uniform(-1, 1, 1600)
        spec = PlaneSpec(np.linspace(-1, 1, 41))
        matrix = DesignMatrix(spec, u, np.ones(u.size, dtype=np.bool_), "negative")
        return matrix, np.ones(u.size), np.ones(spec.unknowns)

    def test_the_order_of_elimination_is_searched_once_for_a_record(self, counted, steps):
        system = quick_system(*steps, np.inf)
        assert system is not None
        searched = len(counted)
        again = quick_system(*steps, np.inf, PlanePrior(steps[0].spec, 5).mesh)
        assert again is not None
        assert again.operations > system.operations
        assert len(counted) == searched

    def test_parts_whose_multiplications_grow_fast_show_that_the_whole_takes_too_many(
        self, counted, steps
    ):
        whole = EverettSystem(*steps).operations
        fresh = DesignMatrix(steps[0].spec, steps[0].u, steps[1] > 0, "negative")
        counted.clear()
        assert quick_system(fresh, *steps[1:], 0.5 * whole) is None
        assert 0.5 * whole < fresh.elimination.operations <= whole
        searched = len(counted)
        assert searched <= 3
        assert fresh.elimination.order is None
        assert quick_system(fresh.coarser(), steps[1], np.ones(211), whole / 16) is None
        assert quick_system(fresh, *steps[1:], 0.5 * whole) is None
        assert len(counted) == searched

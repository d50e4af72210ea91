import numpy as np
import pytest

from minorloop.twins.ipmc import Ipmc
from papers import fibre, ipmc
from papers.facts import twin_facts


def test_the_strip_is_as_published_and_no_preisach_operator():
    facts = ipmc.strip_facts()
    np.testing.assert_allclose(facts["quadratic_fit"], [-0.36, 8.20, 0.34], rtol=0.05)
    np.testing.assert_allclose(facts["range"], [-9.5, 9.4], rtol=0.05)
    assert facts["loop_gap"] == pytest.approx(0.20, rel=0.05)
    assert facts["congruency"] == pytest.approx(0.06, rel=0.05)
    assert facts["wiping_out"] == pytest.approx(0.009, rel=0.05)


def test_the_fibre_has_its_loop_and_is_no_preisach_operator():
    facts = fibre.fibre_facts()
    assert facts["loop_gap"] == pytest.approx(0.20, rel=0.05)
    assert facts["congruency"] > 0.02
    assert facts["wiping_out"] > 0.005


class Ideal(Ipmc):
    """A strip that answers at once and remembers nothing."""

    def apply(self, u, duration, sample_interval):
        record = super().apply(u, duration, sample_interval)
        return type(record)(record.u, 2.0 * record.u + 1.0, record.t, "voltage [V]", "y")


def test_what_remembers_nothing_violates_nothing():
    facts = twin_facts(Ideal, np.linspace(-1, 1, 6), 10.0, loop=(0.1, 0.6), excursion=-0.2)
    np.testing.assert_allclose(facts["quadratic_fit"], [0, 2, 1], atol=1e-12)
    for name in ("loop_gap", "congruency", "wiping_out"):
        assert facts[name] == pytest.approx(0.0, abs=1e-12)

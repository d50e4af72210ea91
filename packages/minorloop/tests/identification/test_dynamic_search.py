import numpy as np

from minorloop.identification.alternation import Found
from minorloop.identification.dynamic_parts import DynamicParts
from minorloop.identification.dynamic_search import better, near, simplest


class Scored(Found):
    """A fit of which only the errors on 40 left-out pieces are known."""

    def __init__(self, dynamics, squares):
        super().__init__(None, None, dynamics, float(np.sqrt(np.mean(squares))))
        self.__dict__["squares"] = np.asarray(squares)


NOISE = 1 + 0.3 * np.random.default_rng(1000).normal(size=40)


def fit(ahead, behind, squares, delay=0.0):
    return Scored(DynamicParts(1e-3, delay, (-3.0,) * ahead, (-3.0, -8.0)[:behind]), squares)


def test_a_small_gain_on_every_piece_is_worth_a_pole_and_chance_is_not():
    one, noise = fit(0, 1, NOISE), np.random.default_rng(1001).normal(size=40)
    assert simplest([one, fit(0, 2, NOISE - 0.06)]).dynamics.poles == 2
    assert simplest([one, fit(0, 2, NOISE - 0.06 + 0.6 * noise)]).dynamics.poles == 1


def test_a_large_gain_on_the_fast_part_of_a_record_is_worth_a_pole():
    few = NOISE.copy()
    few[:10] += np.geomspace(0.5, 2000, 10)  # of 40
    assert better(fit(0, 2, NOISE), fit(0, 1, few))
    assert not better(fit(0, 1, few), fit(0, 2, NOISE))


def test_structures_are_near_if_neither_contains_the_other():
    chosen = fit(0, 1, NOISE)
    assert near(fit(1, 0, 0.9 * NOISE), chosen)
    assert near(fit(1, 0, NOISE), chosen)
    assert not near(fit(1, 0, 1.2 * NOISE), chosen)
    assert not near(fit(0, 2, NOISE), chosen)

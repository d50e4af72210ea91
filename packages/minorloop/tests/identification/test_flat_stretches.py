import numpy as np
import pytest

from fault_records import INPUTS, kinds, plant, record
from minorloop.identification.curves import Curves
from minorloop.identification.screening import record_faults


def noisy(seed=1000, size=8000):
    """A long record with noise of 0.1 % of the span, on loops that shrink and grow."""
    time = np.arange(size) / 400
    u = np.sin(2 * np.pi * time) * (1 - 0.8 * np.abs(2 * (time / 10 % 1) - 1))
    y, noise = plant(0.5 + 0.5 * u), np.random.default_rng(seed).normal(size=size)
    return u, y + 1e-3 * np.ptp(y) * noise


@pytest.mark.parametrize(
    ("shape", "first", "count"),
    [
        *((shape, each.size // 3, each.size // 5) for shape, each in INPUTS.items()),
        *(("noisy", first, count) for first in (840, 2200, 4130) for count in (50, 300)),
    ],
)
def test_a_stuck_output_is_named_with_its_stretch_though_it_is_short(shape, first, count):
    u, y = noisy() if shape == "noisy" else record(shape)
    y[first : first + count] = y[first]
    (finding,) = record_faults(u, y, Curves.whole("negative"), 0)
    assert finding.kind == "stuck"
    assert finding.samples == tuple(range(first, first + count))


@pytest.mark.parametrize("shape", INPUTS)
@pytest.mark.parametrize("side", ["highest", "lowest"])
def test_a_clipped_output_is_named(shape, side):
    u, y = record(shape)
    cut = 0.25 * np.ptp(y)
    clipped = np.minimum(y, y.max() - cut) if side == "highest" else np.maximum(y, y.min() + cut)
    found = record_faults(u, clipped, Curves.whole("negative"), 0)
    assert "clipped" in [finding.kind for finding in found]
    assert f"clipped or saturated at its {side}" in found[0].text


@pytest.mark.parametrize("shape", INPUTS)
@pytest.mark.parametrize("limit", [0.7, 0.73])
def test_an_input_that_the_source_limits_is_named(shape, limit):
    u, _ = record(shape)
    y = plant(np.minimum(u, limit))
    y += 0.003 * np.ptp(y) * np.random.default_rng(1000).normal(size=y.size)
    (finding,) = record_faults(u, y, Curves.whole("negative"), 0)
    assert "the source limits the input" in finding.text


def test_an_output_that_saturates_smoothly_is_not_clipped():
    u, y = record(noise=0.0)
    y = 1 - np.exp(-8 * (y - y.min()) / np.ptp(y))
    y += 0.003 * np.random.default_rng(1000).normal(size=y.size)
    assert kinds(u, y) == []


def wire(u):
    """Phase of a wire with memory of its shape: logistic branches, scaled between reversals."""

    def branch(value, middle):
        return 1 / (1 + np.exp(-12 * (value - middle)))

    phase, last, y = 0.0, u[0], np.empty(u.size)
    for k, value in enumerate(u):
        if value > last:
            phase = 1 - (1 - phase) * (1 - branch(value, 0.65)) / (1 - branch(last, 0.65))
        elif value < last:
            phase *= branch(value, 0.4) / branch(last, 0.4)
        last, y[k] = value, phase
    return y


def few_inputs(rng):
    """Inputs at random to a plant whose output saturates."""
    u = np.r_[0, 1, rng.uniform(size=50)]
    y = plant(u)
    return u, np.tanh(4 * y / np.ptp(y)) + 0.003 * rng.normal(size=u.size)


def readings_of_a_wire(rng):
    """Readings that happen to be dense at an end."""
    u = np.repeat(np.r_[0, 1, rng.uniform(size=80)], 3)
    return u, wire(u) + 0.05 * u + 0.005 * rng.normal(size=u.size)


@pytest.mark.parametrize(
    ("readings", "seeds", "most"), [(few_inputs, 40, 4), (readings_of_a_wire, 30, 2)]
)
def test_readings_that_are_dense_at_an_end_seldom_look_clipped(readings, seeds, most):
    """By the density alone, those of 6 wires did."""
    found = sum(
        "clipped" in kinds(*readings(np.random.default_rng(1000 + seed))) for seed in range(seeds)
    )
    assert found <= most


@pytest.mark.parametrize("shape", ["sine", "levels"])
def test_a_short_rail_without_the_noise_of_the_other_readings_is_found(shape):
    u, y = record(shape)
    assert "clipped" not in kinds(u, y)
    assert "clipped" in kinds(u, np.minimum(y, y.max() - 0.05 * np.ptp(y)))

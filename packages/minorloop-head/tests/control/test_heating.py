import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop import SignalError, Smooth
from minorloop_head.control.heating import (
    identify_coupling,
    identify_heating,
    moving_levels,
    wire_holds,
)
from minorloop_head.twins.wire import Wire
from wires import identified, made_up, settled


def test_the_twin_is_identified_to_within_a_degree_and_a_half():
    found = identified()
    rng = np.random.default_rng(5)
    holds = 0.4 * np.sqrt(rng.uniform(0.2, 1.0, 60))
    error = found.model.operator.simulate(holds**2) - settled(Wire(), holds)
    assert np.sqrt(np.mean(error**2)) < 1.5
    assert found.step_rms < 1.0
    assert 3.0 < found.model.lag < 4.2
    assert found.advice == found.steady.advice
    assert "advice: no data were held out" in str(found)


def test_a_staircase_after_the_curves_lowers_the_error_in_minor_loops():
    levels = np.linspace(0.2, 0.4, 9)
    walk = levels[3] + np.cumsum(np.random.default_rng(3).normal(0.0, 0.02, 120))
    inputs = np.concatenate([[0.0], np.abs((walk - 0.2) % 0.4 - 0.2) + 0.2])
    reached = settled(Wire(), inputs)
    errors, sizes = [], []
    for minor_loops in (False, True):
        holds = wire_holds(levels, minor_loops=minor_loops)
        found = identify(holds**2, settled(Wire(), holds), Plane(levels**2), prior=Smooth(0.0))
        errors.append(np.sqrt(np.mean((found.model.simulate(inputs**2) - reached) ** 2)))
        sizes.append(holds.size)
    assert sizes == [45, 83]
    assert holds[-1] == levels[0]
    assert errors[1] < 0.95 * errors[0]


def test_cold_wires_at_the_beginning_are_not_called_a_stuck_sensor():
    wire = Wire(noise=0.05)
    loop = 0.4 * np.concatenate([np.linspace(0, 1, 25), np.linspace(1, 0, 25)])
    levels = moving_levels(loop, settled(wire, loop), 12)
    wire.reset()
    holds = wire_holds(levels, minor_loops=True)
    found = identify(holds**2, settled(wire, holds), Plane(levels**2), prior=Smooth(0.0))
    assert found.warnings == ()


def test_a_coupling_is_recovered():
    coupling = np.array([[1.0, 0.07], [0.05, 1.0]])
    angles = np.linspace(0, 60, 20)
    records = [np.outer(coupling[:, axis], angles) for axis in range(2)]
    np.testing.assert_allclose(identify_coupling(records), coupling)


def test_bad_input_is_refused():
    wire = made_up()
    t, u = np.arange(3.0), np.zeros(3)
    levels = np.sqrt(wire.operator.levels)
    with pytest.raises(SignalError, match="heating does not depend on the sign"):
        identify_heating([-0.1, 0.2, 0.3], [0, 1, 2], step=(t, u, u), levels=levels)
    with pytest.raises(SignalError, match="does not increase"):
        wire.simulate([0.0, 0.0], [0.1, 0.1])
    with pytest.raises(SignalError, match="axis 1 does not move"):
        identify_coupling([np.ones((2, 3)), np.zeros((2, 3))])
    with pytest.raises(SignalError, match="record 0 has shape"):
        identify_coupling([np.ones(3)])


def records(**changes):
    """Holds of a made-up wire with a step up and down, with changes."""
    wire = made_up()
    holds = np.random.default_rng(0).uniform(0, 0.4, 200)
    t = np.arange(0.0, 30.0, 0.2)
    current = np.where((t > 0.2) & (t < 15), 0.4, 0.0)
    plain = {
        "current": holds,
        "angle": wire.operator.simulate(holds**2),
        "t": t,
        "step_current": current,
        "step_angle": wire.simulate(t, current),
        "levels": np.sqrt(wire.operator.levels),
    }
    for name, change in changes.items():
        plain[name] = change(plain[name]) if callable(change) else change
    return plain


def identified_from(records):
    step = records["t"], records["step_current"], records["step_angle"]
    return identify_heating(
        records["current"], records["angle"], step=step, levels=records["levels"]
    )


def test_the_lag_and_the_latent_heat_of_a_wire_are_recovered():
    wire, found = made_up(), identified_from(records())
    assert found.model.lag == pytest.approx(wire.lag, rel=1e-2)
    assert found.model.latent == pytest.approx(wire.latent, rel=2e-2)
    assert found.step_rms < 0.05
    assert "lag [s]" in str(found)


def at_random(spread):
    return lambda y: np.random.default_rng(1).uniform(0.0, spread, y.size)


def first(count):
    return {name: lambda x: x[:count] for name in ("t", "step_current", "step_angle")}


def every(stride):
    return {name: lambda x: x[::stride] for name in ("t", "step_current", "step_angle")}


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"step_current": np.zeros_like, "step_angle": np.zeros_like}, "is 0 A throughout"),
        ({"step_current": lambda i: -i}, "current of the step is negative"),
        ({"step_current": lambda i: 1e3 * i}, "samples of the step lie outside of the levels"),
        ({"step_angle": np.zeros_like}, "moves by 0 degrees in the step"),
        ({"step_angle": lambda y: y[:2]}, "150 times and 2 angles"),
        ({"step_angle": at_random(60.0)}, "the fit of the step has an rms error of"),
        ({"t": lambda t: 1e6 * t}, "lasts .* give times in seconds"),
        (first(2), "has 2 samples; give 10"),
        (every(14), r"is sampled every 2\.8 s and the lag is"),
        ({"current": lambda i: i[:5], "angle": lambda y: y[:5]}, "5 holds were measured for 8"),
        ({"current": lambda i: 1e3 * i}, "of the holds lie outside of the levels"),
        ({"levels": lambda i: 1e3 * i}, "the holds go from .* and the levels from 0 to 400 A"),
        ({"levels": lambda i: i - 0.1}, "a level is negative"),
        ({"angle": lambda y: y[:-1]}, r"current has shape \(200,\) and angle \(199,\)"),
        ({"angle": np.zeros_like}, "the angle of the holds is 0 throughout"),
        ({"angle": np.negative}, "do not rise with the current"),
    ],
)
def test_records_without_information_are_refused(changes, complaint):
    with pytest.raises(SignalError, match=complaint):
        identified_from(records(**changes))

import numpy as np

from minorloop import Linear
from minorloop.identification.steps import as_sampled, steps_in

VALUES = (0.2, 0.7, 0.7, 0.4)
LAG = Linear.lags(4.0)


def record(values=VALUES, samples=80, gain=3.0, offset=1.0):
    t = 0.5 * np.arange(1, samples * len(values) + 1)
    u = np.repeat(values, samples)
    return t, u, offset + gain * LAG.simulate(t, u, before=values[0])


def test_changes_are_the_samples_from_which_the_input_is_another():
    found = as_sampled(record())
    assert found.interval == 0.5
    np.testing.assert_array_equal(found.changes, [79, 239])


def test_steps_are_scaled_to_one():
    up, down = steps_in(as_sampled(record()))
    assert up.rising
    assert not down.rising
    for step in (up, down):
        first = int(np.argmax(step.stretch.u))
        since = 0.5 * np.arange(step.stretch.u.size - first)
        np.testing.assert_allclose(step.stretch.y[first:], LAG.step_response(since), atol=2e-4)
        np.testing.assert_allclose(step.stretch.y[:first], 0, atol=1e-4)


def test_a_step_without_response_is_left_out():
    t, u, y = record()
    y[160:] = y[159]
    assert len(steps_in(as_sampled((t, u, y)))) == 1

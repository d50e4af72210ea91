import numpy as np
import pytest

from console_rig import MADE_UP
from minorloop.errors import ParameterError
from minorloop_head.control.head import LEAD, camera_control, head_control
from minorloop_head.control.limits import WireLimits
from minorloop_head.procedures.steer import steer
from minorloop_head.twins.head import Head
from wires import identified, made_up


def test_a_head_reaches_its_targets_and_is_left_safe():
    head = Head(noise=0.05, seed=3)
    result = steer(head, MADE_UP, [[30.0, 30.0], [40.0, 20.0]], 8.0)
    np.testing.assert_allclose(result.reached, result.targets, atol=1.0)
    assert result.current.max() <= 0.4
    assert result.t[-1] == pytest.approx(16.0)
    assert head._input.tolist() == [0.0, 0.0]


class Slow:
    """A head that its camera reads; to search a picture takes some seconds, and then it is used."""

    tick, inputs, outputs, age = 0.04, Head.inputs, Head.outputs, 0.04

    def __init__(self, search):
        self.head, self.search = Head(noise=0.02, seed=3, tick=0.01, delay=0.04), search
        self.now = self.time = 0.0
        self.pictures, self.true, self.seen = 0, [], np.zeros(2)

    def exchange(self, u):
        self.time += self.tick * max(np.ceil((self.now - self.time) / self.tick - 1e-6), 1)
        self.wait(u, self.time - self.now)
        seen = self.seen
        self.pictures += 1
        self.wait(u, self.search)
        return seen

    def wait(self, u, seconds):
        for _ in range(round(seconds / 0.01)):
            self.seen = np.array(self.head.exchange(u))
            self.true.append(self.head._output_now())
        self.now += seconds

    def safe(self):
        self.head.safe()


@pytest.mark.parametrize("search", [0.02, 0.2])
def test_a_computer_that_is_too_slow_for_the_loop_does_not_make_it_overshoot(search):
    head = Slow(search)
    control = camera_control("observer", (identified().model,) * 2, lead=LEAD)
    result = steer(head, control, [[40.0, 20.0]], 14.0)
    assert (np.max(head.true, axis=0) < [41.0, 21.0]).all()
    assert np.ptp(head.true[-400:], axis=0).max() < 1.0
    assert result.missed == ()
    said = [
        each for each in result.warnings if "are needed: the head was turned more slowly;" in each
    ]
    assert len(said) == (search > 0.1)


@pytest.mark.parametrize(("late", "began"), [(6, 0.0), (12, 4.0)])
def test_readings_of_pictures_that_are_known_to_be_old_are_used_and_nothing_swings(late, began):
    class Old(Head):
        seen: tuple[np.ndarray, ...] = ()
        age = 0.08

        def exchange(self, u):
            self.seen += (np.array(super().exchange(u)),)
            old = late if len(self.seen) * self.tick > began else 1
            self.age = (old + 1) * self.tick
            return self.seen[max(len(self.seen) - 1 - old, 0)]

    head, targets = Old(noise=0.02, seed=3), [[25.0, 25.0], [35.0, 30.0], [20.0, 15.0]]
    control = camera_control("observer", (identified().model,) * 2, lead=LEAD)
    result = steer(head, control, targets, 10.0)
    true = np.array(head.seen)[1:]
    for n, target in enumerate(targets[1:], 1):
        at = true[result.row == n]
        assert (at.max(axis=0) < np.maximum(target, targets[n - 1]) + 1.0).all()
        assert abs(at[-50:] - target).max() < 0.7
        assert np.ptp(at[-50:], axis=0).max() < 0.7
    assert result.used.mean() > 0.95
    assert not any("they are late" in each.what for each in result.faults)
    (said,) = (each for each in result.faults if "old, and the control" in each.what)
    assert f"up to {0.04 * (late + 1):.2g} s old" in said.what


def test_readings_that_are_not_believed_are_no_angles_reached():
    class Shifted(Head):
        ticks = 0

        def exchange(self, u):
            self.ticks += 1
            return super().exchange(u) + (self.ticks > 160) * np.array([-14.0, 0.0])

    control = head_control("observer", (identified().model,) * 2)
    result = steer(Shifted(noise=0.05, seed=3), control, [[30.0, 30.0], [40.0, 20.0]], 8.0)
    assert result.used[:159].all()
    assert not result.used[160:, 0].any()
    assert np.isnan(result.reached[:, 0]).all()
    np.testing.assert_allclose(result.reached[:, 1], [30.0, 20.0], atol=0.5)
    # The head itself was right: only its readings were shifted.
    np.testing.assert_allclose(result.expected, result.targets, atol=0.5)
    assert result.missed == ()
    assert result.unconfirmed[1] == (
        "pan is not confirmed at target 2, 40 degrees: its readings were not used at the end of "
        "its hold; by its model it was at 40.0 degrees"
    )
    assert not result.done


@pytest.mark.parametrize("target", [[200.0, 30.0], [30.0, -20.0], [61.0, 58.0]])
def test_a_target_beyond_the_reach_is_refused_before_anything_is_switched_on(target, monkeypatch):
    control = head_control("observer", (made_up(), made_up()), coupling=[[1.0, 0.0], [0.1, 1.0]])
    head = Head()
    monkeypatch.setattr(head, "exchange", lambda u: pytest.fail("it was switched on"))
    with pytest.raises(ParameterError, match=r"of target 2 is .* reach .* to .* degrees there"):
        steer(head, control, [[30.0, 30.0], target], 1.0)


def test_coupling_moves_the_reach_and_so_does_the_limit_of_temperature():
    wire = made_up()
    control = head_control("observer", (wire, wire), coupling=[[1.0, 0.0], [0.1, 1.0]])
    pan, tilt = control.reach([30.0, 40.0])
    np.testing.assert_allclose(tilt - pan, 3.0)
    assert pan[1] == pytest.approx(0.97 * wire.operator.range[1])
    cool = head_control("observer", (wire, wire), limits=WireLimits(hottest=80.0))
    assert cool.reach([30.0, 40.0])[0, 1] < pan[1] - 1.0

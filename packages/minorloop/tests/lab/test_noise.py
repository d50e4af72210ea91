import numpy as np
import pytest

from minorloop.lab.noise import RepeatedReadings, frozen, noise_of

RNG = np.random.default_rng(1000)
NOISE = RNG.normal(size=4000)
TIME = np.arange(4000) / 400
SIGNAL = 50 * np.sin(2 * np.pi * TIME)


def test_a_sensor_that_is_stuck_for_most_of_a_record_is_found():
    y = SIGNAL + NOISE
    y[500:3500] = y[500]
    assert frozen(y).runs == ((500, 3500),)


@pytest.mark.parametrize("digits", [2, 4, 12])
def test_a_smooth_signal_that_rests_is_not_stuck(digits):
    rests = np.where((TIME > 3.25) & (TIME < 4.25), SIGNAL[1300], SIGNAL)
    assert frozen(np.round(rests, digits)).runs == ()


def _verdicts(levels, readings):
    repeated = RepeatedReadings.of_plan(np.asarray(levels))
    said = []
    for level, y in zip(levels, readings, strict=True):
        repeated = repeated.after(level, np.asarray(y))
        said.append(repeated.verdict)
    return said


STAIRS = [*np.linspace(0, 1, 11), *np.linspace(0.9, 0, 10)]


class TestRepeatedReadings:
    def test_a_dead_sensor_is_faulty_as_soon_as_the_input_has_crossed_its_range(self):
        dead = np.full(20, 0.1)
        assert _verdicts([-1, 1, -1, 1], [dead] * 4) == ["", *["faulty"] * 3]
        said = _verdicts(STAIRS, [dead] * len(STAIRS))
        assert said[:11] == [*[""] * 5, *["suspect"] * 5, "faulty"]

    def test_holds_without_a_reading_are_dead_wherever_the_input_is(self):
        none, gaps = np.full(5, np.nan), np.array([0.5, np.nan, 0.5])
        assert _verdicts([-1, 1, 0.9], [[0.2], none, none]) == ["", "", "dead"]
        assert _verdicts([-1, 1, -1], [gaps] * 3)[1:] == ["faulty"] * 2

    @pytest.mark.parametrize(("width", "alive"), [(0.0, 1), (0.1, 3)])
    def test_a_sensor_is_dead_where_less_of_the_input_moved_it_before(self, width, alive):
        levels = [-1, 1, -0.5, 0.3, -0.2, 0.1, 0.0, 0.1, -0.1, 0.2, -0.3]
        place, y = -1.0, []
        for u in levels:
            place = min(max(place, u - width), u + width)
            y.append(place + np.array([0.01, 0.001, 0.0]))
        assert not any(_verdicts(levels, y))
        y[-4:] = [y[-5][-1:]] * 4
        assert _verdicts(levels, y)[-4:] == [""] * alive + ["dead"] * (4 - alive)

    @pytest.mark.parametrize("noise", [0.0, 0.01])
    @pytest.mark.parametrize("codes", [3, 8, 30, 1000])
    def test_a_play_that_is_read_coarsely_is_not_faulty(self, codes, noise):
        """It stays where it is over 60 % of the range after each reversal."""
        place, y = -0.7, []
        levels = [*np.linspace(-1, 1, 41), *np.linspace(0.95, -1, 40), *np.linspace(-0.95, 1, 40)]
        for u in levels:
            place = min(max(place, u - 0.6), u + 0.6)
            y.append(np.round(codes * (place + noise * RNG.normal(size=20))))
        assert "faulty" not in _verdicts(levels, y)


@pytest.mark.parametrize("order", [1, 2, 4])
def test_the_noise_of_a_slow_signal_is_found_from_differences_of_any_order(order):
    rng = np.random.default_rng(1000)
    signal = np.sin(np.linspace(0.0, 6.0, 20_000)) + rng.normal(0.0, 0.01, 20_000)
    signal[::500] += 1.0
    assert noise_of(np.diff(signal, order), order) == pytest.approx(0.01, rel=0.05)

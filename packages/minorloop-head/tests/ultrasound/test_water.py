import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import ParameterError
from minorloop_head.ultrasound.water import sound_speed


@pytest.mark.parametrize(("temperature", "speed"), [(0, 1402.4), (20, 1482.3), (74, 1555.1)])
def test_it_agrees_with_tabulated_values(temperature, speed):
    assert sound_speed(temperature) == pytest.approx(speed, abs=0.15)


@given(st.floats(0, 60), st.floats(0.1, 10))
def test_warmer_water_is_faster(temperature, step):
    assert sound_speed(temperature + step) > sound_speed(temperature)


@pytest.mark.parametrize("temperature", [-1.0, 96.0, float("nan")])
def test_what_is_not_water_is_refused(temperature):
    with pytest.raises(ParameterError, match="temperature"):
        sound_speed(temperature)

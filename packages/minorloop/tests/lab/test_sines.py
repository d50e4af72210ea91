from dataclasses import replace

import numpy as np
import pytest

from minorloop.errors import ParameterError, RecordError
from minorloop.lab.plan import Plan
from minorloop.lab.records import Quantity
from minorloop.lab.sines import Sine, SinePlan, is_sine_plan

SINE = Sine(0.5, 0.7, 0.1, -1.2, 20.0, 3, 2, 40)
GRID = {"preamble": -1.2, "hold": 20.0, "input": "voltage [V]"}


def test_inputs_are_a_sine_about_the_offset_and_end_at_it():
    t = SINE.interval * np.arange(1, SINE.count + 1)
    np.testing.assert_allclose(SINE.inputs, 0.1 + 0.7 * np.sin(np.pi * t), atol=1e-12)
    assert SINE.count == 5 * 40
    assert SINE.length == t[-1] == 10.0
    assert SINE.duration == 50.0


def test_a_grid_has_every_frequency_at_every_amplitude():
    plan = SinePlan.grid([0.1, 1.0], [0.7, 1.0], settling=30.0, **GRID)
    assert [(s.frequency, s.amplitude, s.discarded) for s in plan] == [
        *((0.1, 0.7, 3), (0.1, 1.0, 3)),
        *((1.0, 0.7, 30), (1.0, 1.0, 30)),
    ]
    assert plan.input == Quantity("voltage", "V")
    assert plan.duration == 4 * 40 + 2 * 50 + 2 * 32


@pytest.mark.parametrize("frequency", [0.003, 0.0417, 0.3, 1.7])
def test_with_a_tick_every_sample_takes_whole_ticks(frequency):
    (sine,) = SinePlan.grid([frequency], [0.7], samples=50, tick=0.025, **GRID)
    period = 1 / (sine.frequency * 0.025)
    assert sine.ticks(0.025) * sine.samples == pytest.approx(period, rel=1e-9)
    assert abs(sine.frequency / frequency - 1) < 0.5 / 20
    assert sine.samples <= 75


def test_a_written_plan_is_read_back(tmp_path):
    file = tmp_path / "sines.csv"
    plan = SinePlan.grid([1 / 3, 0.1], [0.7], offset=0.2, tick=0.01, **GRID)
    plan.to_csv(file)
    assert file.read_text().startswith("frequency [Hz],voltage amplitude [V],voltage offset [V],")
    assert is_sine_plan(file)
    assert SinePlan.from_csv(file) == plan
    assert SinePlan.from_dict(plan.to_dict()) == plan


def test_a_plan_of_holds_is_no_plan_of_sines(tmp_path):
    Plan([0.5], 20.0, input="voltage [V]").to_csv(tmp_path / "plan.csv")
    assert not is_sine_plan(tmp_path / "plan.csv")
    with pytest.raises(RecordError, match="no column of an amplitude"):
        SinePlan.from_csv(tmp_path / "plan.csv")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"frequency": 0.0}, "frequency is 0; give a positive number"),
        ({"amplitude": -1.0}, "amplitude is -1"),
        ({"hold": 0.0}, "hold is 0"),
        ({"offset": np.nan}, "offset is nan"),
        ({"measured": 2.5}, "measured periods are 2.5; give a whole number of at least 2"),
        ({"discarded": 10**6}, "has 40000080 samples, more than 2000000"),
    ],
)
def test_refuses_impossible_sines(change, says):
    with pytest.raises(ParameterError, match=says):
        replace(SINE, **change)


@pytest.mark.parametrize(
    ("frequencies", "options", "says"),
    [
        ([], {}, "frequencies are"),
        ([-1.0], {}, "give positive numbers"),
        ([1.0], {"settling": -1.0}, "settling is -1 s"),
        ([1.0], {"tick": 0.0}, "tick is 0 s"),
        ([1.0], {"tick": 0.1}, r"too slow for 1 Hz: a period needs 20 ticks; give up to 0\.5 Hz"),
    ],
)
def test_refuses_impossible_grids(frequencies, options, says):
    with pytest.raises(ParameterError, match=says):
        SinePlan.grid(frequencies, [0.7], **GRID, **options)


def test_a_row_that_is_no_sine_is_named(tmp_path):
    file = tmp_path / "sines.csv"
    SinePlan((SINE,), Quantity("voltage", "V")).to_csv(file)
    file.write_text(file.read_text().replace(",3,2,40", ",3,2.5,40"))
    with pytest.raises(ParameterError, match=r"sine 1 of .*: measured periods are 2\.5"):
        SinePlan.from_csv(file)
    with pytest.raises(ParameterError, match="not a plan of sines"):
        SinePlan.from_dict({"input": "u"})

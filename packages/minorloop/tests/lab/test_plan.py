import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from minorloop.errors import ParameterError, RecordError
from minorloop.lab.plan import FEWEST, Plan
from minorloop.lab.records import Quantity

LEVELS = st.lists(st.floats(-1e9, 1e9) | st.just(np.nan), min_size=1, max_size=8)
NAMES = ["input", "voltage [V]", "p [bar] [kPa]", "[V]", " a  [ b ] ", ""]
QUANTITIES = st.sampled_from([*NAMES, *map(Quantity, NAMES), *(Quantity(n, "m") for n in NAMES)])


@st.composite
def plans(draw):
    """Any plan that is allowed."""
    inputs = draw(LEVELS)
    least = draw(st.floats(1e-3, 1e6))
    longest = [least * draw(st.floats(1, 100)) for _ in inputs]
    window = draw(st.none() | st.floats(0.1, 1).map(min(longest).__mul__))
    return Plan(
        inputs,
        longest,
        draw(st.none() | st.floats(1e-3, 1).map(min(longest).__mul__)),
        window=window,
        tolerance=draw(st.none() | st.floats(1e-12, 1e3)),
        sample_interval=(window or min(longest) / 10) / draw(st.floats(4, 40)),
        input=draw(QUANTITIES),
    )


class TestDefaults:
    def test_times_that_are_not_given_follow_from_the_least_hold(self):
        plan = Plan([0.0, 1.0, 0.5], [200.0, 100.0, 400.0])
        np.testing.assert_array_equal(plan.shortest, [50.0, 25.0, 100.0])
        assert plan.window == 10.0
        assert plan.sample_interval == 0.5
        assert plan.tolerance is None

    def test_slow_sampling_widens_the_window_as_far_as_the_hold_allows(self):
        assert Plan([0.0], 100.0, sample_interval=2.0).window == 20.0
        assert Plan([0.0], 100.0, sample_interval=20.0).window == 100.0

    @given(plan=plans())
    def test_every_plan_keeps_its_own_rules(self, plan):
        assert (plan.shortest <= plan.longest).all()
        assert plan.window <= plan.longest.min()
        assert plan.window >= FEWEST * plan.sample_interval * (1 - 1e-9)
        assert len(plan) == plan.inputs.size == plan.longest.size == plan.shortest.size
        assert plan.open == np.isnan(plan.inputs).any()

    def test_names_the_interval_where_that_asks_for_long_holds(self):
        for interval, asked in ((0.1, r", as the plan asks \(interval\)"), (0.01, "")):
            plan = Plan([0.0], 0.5, window=0.4, sample_interval=interval)
            with pytest.raises(ParameterError, match=f"s between samples{asked}$"):
                plan.check_answers(0.07)


class TestTexts:
    @given(plan=plans())
    def test_json_gives_the_same_plan_back(self, plan):
        text = plan.to_json()
        json.loads(text, parse_constant=pytest.fail)
        again = Plan.from_json(text)
        assert again.difference(plan) == plan.difference(again) == ""
        assert again.to_json() == text

    @settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(plan=plans())
    def test_csv_gives_levels_and_holds_back_exactly(self, plan, tmp_path):
        plan.to_csv(tmp_path / "plan.csv", force=True)
        kept = {
            "window": plan.window,
            "tolerance": plan.tolerance,
            "sample_interval": plan.sample_interval,
        }
        again = Plan.from_csv(tmp_path / "plan.csv", **kept)
        assert again.difference(plan) == ""

    @pytest.mark.parametrize(
        ("changed", "says"),
        [
            ({}, ""),
            ({"input": "force [N]"}, "input was 'u [V]' and is 'force [N]' now"),
            ({"window": 2.0}, "window was 1.0 and is 2.0 now"),
            ({"tolerance": 0.1}, "tolerance was left out and is 0.1 now"),
            ({"inputs": [0.0]}, "inputs had 2 elements and has 1 now"),
            ({"inputs": [0.0, 1 + 1e-15]}, "inputs.1 was 1.0 and is 1.000000000000001 now"),
            ({"inputs": [0.0, np.nan]}, "inputs.1 was 1.0 and is left out now"),
            ({"shortest": [2.5, 3.0]}, "shortest.1 was 2.5 and is 3.0 now"),
        ],
    )
    def test_a_difference_is_described(self, changed, says):
        common = {"inputs": [0.0, 1.0], "longest": 10.0, "sample_interval": 0.05, "input": "u [V]"}
        assert Plan(**common).difference(Plan(**{**common, **changed})) == says


class TestFiles:
    def _file(self, tmp_path, text):
        (tmp_path / "plan.csv").write_text(text)
        return tmp_path / "plan.csv"

    @pytest.mark.parametrize(
        ("header", "factor"),
        [("hold", 1), ("hold [s]", 1), ("hold [ms]", 1e-3), ("hold [min]", 60), ("hold [h]", 3600)],
    )
    def test_holds_are_in_the_unit_of_their_column(self, tmp_path, header, factor):
        plan = Plan.from_csv(self._file(tmp_path, f"{header},u [V]\n90,1\n120,-1\n"))
        np.testing.assert_allclose(plan.longest, [90 * factor, 120 * factor], rtol=1e-15)
        np.testing.assert_array_equal(plan.inputs, [1.0, -1.0])
        assert plan.input == Quantity("u", "V")

    def test_shortest_holds_have_a_column_of_their_own_or_are_given(self, tmp_path):
        file = self._file(tmp_path, "u;hold [min];shortest hold [s]\n1;1;10\n2;1;20\n")
        np.testing.assert_array_equal(Plan.from_csv(file).shortest, [10.0, 20.0])
        np.testing.assert_array_equal(Plan.from_csv(file, shortest=5.0).shortest, [5.0, 5.0])

    def test_one_of_several_columns_is_named(self, tmp_path):
        file = self._file(tmp_path, "u [V],note,hold [s]\n1,a,10\n")
        assert Plan.from_csv(file, input="u").inputs.tolist() == [1.0]
        with pytest.raises(RecordError, match=r"2 columns that could be the input \('u \[V\]', 'n"):
            Plan.from_csv(file)

    @pytest.mark.parametrize(
        ("text", "says"),
        [
            ("", "is empty"),
            ("hold [s],u\n", "has a header and no rows"),
            ("u\n1\n", r"has no column 'hold \[s\]'; a plan says how long"),
            ("u,hold [V]\n1,1\n", r"column 'hold \[V\]' of .* must be in one of s, ms"),
            ("u,hold [s]\n1,1\nx,1\n", "has the text 'x' in row 3"),
            ("u,hold [s]\n1,1\n1,-1\n", "longest hold 1 is -1; give a positive"),
        ],
    )
    def test_a_file_that_is_no_plan(self, tmp_path, text, says):
        with pytest.raises((RecordError, ParameterError), match=says):
            Plan.from_csv(self._file(tmp_path, text))


class TestRefusals:
    @pytest.mark.parametrize(
        ("changed", "says"),
        [
            ({"inputs": []}, r"inputs have shape \(0,\); a plan has \(N,\) levels"),
            ({"inputs": [0.0, np.inf]}, "inputs is inf at index 1"),
            ({"longest": 0.0}, "longest hold 0 is 0; give a positive number of seconds"),
            ({"longest": [10.0, 10.0, 10.0]}, "give one number of seconds, or one for each of 2"),
            ({"shortest": [-1.0, 1.0]}, "shortest hold 0 is -1"),
            ({"shortest": [1.0, 10.5]}, "level 1 is held 10.5 s at least and 10 s at most"),
            ({"window": 11.0}, "window is 11 s and a hold is 10 s; give a window that fits"),
            ({"window": 0.19, "sample_interval": 0.05}, "holds fewer than 4 samples"),
            ({"sample_interval": 1e-9}, "more than 2000000 samples 1e-09 s apart; sample less"),
        ],
    )
    def test_says_what_is_wrong_and_what_to_do(self, changed, says):
        with pytest.raises(ParameterError, match=says):
            Plan(**{"inputs": [0.0, 1.0], "longest": 10.0, **changed})


class TestSlowMeters:
    def test_a_plan_is_slowed_as_far_as_the_meter_needs(self):
        plan = Plan([0.0, 1.0], [10.0, 20.0], tolerance=0.5, input="voltage [V]")
        assert plan.slowed(0.05) is plan
        slow = plan.slowed(0.1234)
        assert (slow.sample_interval, slow.window) == (0.13, 1.3)
        assert (slow.tolerance, slow.input) == (0.5, plan.input)
        np.testing.assert_array_equal(slow.longest, plan.longest)
        np.testing.assert_array_equal(slow.shortest, plan.shortest)
        slow.check_answers(0.1234)

    @pytest.mark.parametrize("seconds", np.geomspace(1e-4, 10, 9))
    def test_a_plan_is_slowed_or_refused(self, seconds):
        plan = Plan([0.0], 10.0)
        if seconds <= 10 / 8.8:
            plan.slowed(seconds).check_answers(seconds)
        else:
            assert plan.slowed(seconds) is plan  # as no interval makes up for it
            with pytest.raises(ParameterError, match=f"the meter takes {seconds:.3g} s"):
                plan.check_answers(seconds)

import numpy as np
import pytest

from fixed_options import Options, identify
from minorloop.errors import ParameterError, SignalError
from minorloop.lab.records import Record
from plane_records import a_record


@pytest.mark.parametrize(
    ("u", "y", "says"),
    [
        ([0, 1, 2], [0, 1], "3 samples and y has 2"),
        ([0, 1, 2, 3], [0, np.nan, np.nan, 1], "2 outputs are finite"),
        ([1, 1, 1], [0, 1, 2], "the input is 1 throughout"),
        ([0, 1, 2], [9.9e37, 9.9e37, 9.9e37], r"all 3 outputs are overload codes, as 9.9e\+37 is"),
        ([0, 1, 2], [1, 1, 1], "the output is 1 throughout"),
        ([0, np.nan, 2], [1, 2, 3], "u is nan at index 1"),
        ([[0, 1, 2]], [[1, 2, 3]], "give one record"),
        (["a", "b", "c"], [1, 2, 3], "real numbers"),
    ],
)
def test_refuses_unusable_records(u, y, says):
    with pytest.raises(SignalError, match=says):
        identify(u, y)


@pytest.mark.parametrize(
    "options",
    [
        {"levels": 0},
        {"levels": 2.5},
        {"levels": True},
        {"levels": [1, 0]},
        {"levels": [0, np.nan]},
        {"levels": 501},
        {"spacing": "odd"},
        {"relay": "odd"},
        {"diagonal": "odd"},
        {"smoothness": "odd"},
        {"lag": "odd"},
        {"start": "odd"},
        {"holdout": 0.95},
        {"slope": "steep"},
    ],
)
def test_refuses_options_out_of_range(options):
    with pytest.raises(ParameterError, match=r"give|needed|sort|must be"):
        Options.of(options).identify(Record(*a_record(100)))


def test_inputs_one_rounding_apart_are_refused_in_the_words_of_the_record():
    u = np.where(np.arange(30) % 2, 1.0, np.nextafter(1.0, 2.0))
    with pytest.raises(
        SignalError, match=r"input changes by 2\.22045e-16 only, about 1, .* 25 bands"
    ):
        identify(u, u)

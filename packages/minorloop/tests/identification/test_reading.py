import numpy as np
import pytest

import minorloop as ml
from minorloop.errors import ParameterError, RecordError

ROWS = "\n".join(f"{k},{k % 7},{k % 5},0.1" for k in range(30))


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(f"t [ms],u [V],y [um],sd [um]\n{ROWS}\n")
    return path


def test_time_and_standard_deviations_are_found_and_said(file):
    record = ml.read(file, input="u", output="y")
    np.testing.assert_allclose(record.t, 1e-3 * np.arange(30))
    np.testing.assert_array_equal(record.sd, 0.1)
    said = "time: column 't [ms]'; name another one, or none, with time= (--time)"
    assert record.origin.chosen == (said,)
    plain = ml.read(file, input="u", output="y", time=None, sd=None)
    assert (plain.timed, plain.sd, plain.origin.chosen) == (False, None, ())


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("v,u [V],y [um],t [s]", "stands still or runs backwards"),
        ("t [ms],u [V],y [um],t [s]", "2 columns that could be time"),
    ],
)
def test_times_that_cannot_be_used_are_left_out_and_said(header, said, file):
    file.write_text(f"{header}\n{ROWS}\n")
    record = ml.read(file, input="u", output="y")
    assert record.check is None
    assert record.origin.chosen[0].startswith("time: none, because")
    assert said in record.origin.chosen[0]


def test_a_column_that_is_missing_or_wrong_is_named(file):
    with pytest.raises(ParameterError, match=r"output \(--output\) is missing; name a column of"):
        ml.read(file, input="u")
    with pytest.raises(RecordError, match="does not exist"):
        ml.read(file.with_name("none.csv"))
    with pytest.raises(RecordError, match="is not a standard deviation of 'y"):
        ml.read(file, input="u", output="y", sd="u")

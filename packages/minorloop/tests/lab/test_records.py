import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from minorloop.errors import OutputError, ParameterError, RecordError
from minorloop.lab.logs import read_log
from minorloop.lab.records import Quantity, Record

PLAIN = "time [s],voltage [V],curvature [1/m]\n0,0.5,1\n1,0.6,2\n2,0.7,3\n"
numbers = arrays(np.float64, (2, 5), elements=st.floats(allow_nan=False, allow_infinity=False))


@pytest.fixture
def table(tmp_path):
    def write(content, name="table.csv"):
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        return file

    return write


def small(**changes):
    values = {"t": [0, 1, 2], "u": [0.5, 0.6, 0.7], "y": [1, 2, 3]} | changes
    return Record(**values, inputs="voltage [V]", outputs="curvature [1/m]")


def test_reads_names_units_and_numbers(table):
    record = read_log(table(PLAIN), input="voltage", output="curvature [1/m]", time="time")
    assert (record.input, record.output) == (Quantity("voltage", "V"), Quantity("curvature", "1/m"))
    np.testing.assert_array_equal(record.t, [0, 1, 2])
    np.testing.assert_array_equal(record.u, [0.5, 0.6, 0.7])
    np.testing.assert_array_equal(record.y, [1, 2, 3])
    assert record.timed
    assert len(record) == 3
    assert str(record) == "3 samples of voltage [V], curvature [1/m]"


@given(numbers)
def test_writing_and_reading_gives_the_same_numbers(tmp_path_factory, values):
    t, (u, y) = 0.1 * np.arange(5), values
    file = tmp_path_factory.mktemp("record") / "record.csv"
    record = Record(u, y, t, "voltage [V]", "curvature [1/m]")
    record.to_csv(file)
    again = read_log(file, input="voltage", output="curvature", time="time")
    for name in "tuy":
        np.testing.assert_array_equal(getattr(again, name), getattr(record, name))
    assert (again.inputs, again.outputs, again.time) == (record.inputs, record.outputs, record.time)


def column(values, name, **attrs):
    """Like a column of pandas, or of xarray with its unit among the attributes."""
    made = np.asarray(values, dtype=float).view(type("Column", (np.ndarray,), {}))
    made.name, made.attrs = name, attrs
    return made


@pytest.mark.parametrize(
    ("unit", "last"), [("ms", 0.002), ("us", 2e-6), ("min", 120), ("h", 7200), ("s", 2)]
)
def test_columns_of_a_frame_bring_their_names_and_units(unit, last):
    t, u = column([0, 1, 2], f"t [{unit}]"), column([1, 2, 3], "voltage", units="V")
    record = Record(u, column([3, 4, 5], "tip"), t)
    assert (str(record.input), str(record.output)) == ("voltage [V]", "tip")
    assert record.t[-1] == pytest.approx(last)
    assert str(record.time) == "t [s]"


def test_a_frame_of_pandas_is_read_by_columns():
    frame = pytest.importorskip("pandas").DataFrame({"u [V]": [1, 2], "y": [3.0, np.nan]})
    record = Record(frame["u [V]"], frame["y"])
    assert (str(record.input), record.timed) == ("u [V]", False)


def test_a_record_owns_its_numbers_and_does_not_change():
    u = np.array([0.5, 0.6, 0.7])
    record = small(u=u)
    u[0] = 99
    assert record.u[0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        record.u[0] = 1


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"u": [1, 2]}, "u has 2 samples and y has 3; give one output for every input"),
        ({"u": np.zeros((3, 2))}, r"of shape \(3, 2\); give \(channels, T\)"),
        ({"y": np.zeros((2, 3))}, "y has 2 channels and 1 names"),
        ({"u": [1, np.nan, 2]}, "u is nan at index 1"),
        ({"t": [0, 2, 1]}, "time.* runs backwards at 1 of 2 steps; it cannot be"),
        ({"t": [], "u": [], "y": []}, "at least one sample"),
        ({"u": "abc"}, "u is not an array of real numbers"),
    ],
)
def test_parts_that_do_not_fit_make_no_record(changes, complaint):
    with pytest.raises(RecordError, match=complaint):
        small(**changes)


def test_several_channels_are_rows_and_are_written_as_columns(tmp_path):
    names = ("x [deg]", "y [deg]")
    record = Record([1, 2], [[1, 2], [3, 4]], [0, 1], "voltage [V]", names)
    record.to_csv(tmp_path / "axes.csv")
    text = (tmp_path / "axes.csv").read_text()
    assert text == "time [s],voltage [V],x [deg],y [deg]\n0.0,1.0,1.0,3.0\n1.0,2.0,2.0,4.0\n"


def test_records_on_one_clock_are_joined():
    later = small(t=[3, 4, 5])
    joined = Record.joined([small(), later])
    np.testing.assert_array_equal(joined.t, range(6))
    assert joined.output == small().output
    with pytest.raises(RecordError, match="runs backwards"):
        Record.joined([later, small()])
    with pytest.raises(RecordError, match="no record to join"):
        Record.joined([])
    with pytest.raises(RecordError, match="different channels"):
        Record.joined([small(), Record([1], [1], [3])])


def test_an_existing_file_is_replaced_only_by_force(tmp_path):
    file = tmp_path / "record.csv"
    small().to_csv(file)
    before = file.read_bytes()
    with pytest.raises(OutputError, match="exists already"):
        small(y=[7, 8, 9]).to_csv(file)
    assert file.read_bytes() == before
    small(y=[7, 8, 9]).to_csv(file, force=True)
    assert read_log(file, input="voltage", output="curvature", time=None).y[0] == 7
    with pytest.raises(OutputError, match="does not exist; make it first"):
        small().to_csv(tmp_path / "missing" / "record.csv")


def test_it_is_drawn_and_shown_in_a_notebook():
    record = Record([1, 2, 3], [[1, 2, np.nan], [3, 4, 5]], [0, 2, 4], "u [V]", ("a", "b [mm]"))
    labels = [axes.get_ylabel() for axes in record.plot().axes]
    assert labels == ["a, b [mm]", "u [V]", "a"]
    shown = record._repr_html_()
    assert "<b>Record</b><table><tr><th>samples</th><td>3</td></tr>" in shown
    assert "<th>a</th><td>1 to 2</td>" in shown
    assert 'src="data:image/png;base64,' in shown


ends = st.none() | st.integers(-20, 20)


@given(st.integers(1, 15), ends, ends)
def test_rows_equal_those_of_a_slice_or_are_refused(total, first, last):
    record = Record(np.arange(float(total)), np.zeros(total))
    wanted = range(total)[slice(first, last)]
    inside = all(end is None or -total <= end <= total for end in (first, last))
    if inside and len(wanted):
        assert record.only(first, last).cut().u.tolist() == list(wanted)
    else:
        with pytest.raises(ParameterError, match="give two numbers from 0"):
            record.only(first, last)

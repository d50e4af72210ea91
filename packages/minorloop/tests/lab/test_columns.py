import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import ParameterError, RecordError
from minorloop.lab import columns, tables, text_tables
from minorloop.lab.columns import opened, read_columns, read_headers, read_labels
from minorloop.lab.headers import split_header
from minorloop.lab.logs import read_log
from minorloop.lab.records import Quantity

PLAIN = "time [s],voltage [V],curvature [1/m]\n0,0.5,1\n1,0.6,2\n2,0.7,3\n"


@pytest.fixture
def table(tmp_path):
    def write(content, name="table.csv"):
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        return file

    return write


def test_labels_are_numbers_or_texts(table):
    numbers = read_labels(table("a,b\n1,2\n1,3\n2,4\n"), "a")
    np.testing.assert_array_equal(numbers, [1.0, 1.0, 2.0])
    assert read_labels(table("a,b\nw 1,2\n2,3\n"), "a").tolist() == ["w 1", "2"]
    for empty in ("", "nan"):
        with pytest.raises(RecordError, match=r"'a' of .* is empty in row 3; give every row"):
            read_labels(table(f"a,b\nx,2\n{empty},3\n"), "a")


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", "\t"),
        lambda text: text + "\n\n",
        lambda text: text.removesuffix("\n"),
        lambda text: text.replace("\n1", "\n\n1"),
        lambda text: text.replace(",", " , "),
        lambda text: text.replace("0.5", '"0.5"'),
    ],
)
def test_reads_what_other_programs_write(table, change):
    read = read_columns(table(change(PLAIN)), ["voltage", "time [s]"])
    np.testing.assert_array_equal(read["voltage"], [0.5, 0.6, 0.7])
    np.testing.assert_array_equal(read["time [s]"], [0, 1, 2])


def test_gaps_are_legal_only_where_asked(table):
    file = table("u,y\n1,2\n2,\n3,nan\n4, \n")
    read = read_columns(file, ["u", "y"], gaps=["y"])
    np.testing.assert_array_equal(read["y"], [2, np.nan, np.nan, np.nan])
    with pytest.raises(RecordError, match=r"column 'y' of .* is empty in row 3; give a number"):
        read_columns(table("u,y\n1,2\n2,\n3,4\n", "empty.csv"), ["u", "y"])
    with pytest.raises(RecordError, match=r"column 'y' of .* has 'nan' in row 2"):
        read_columns(table("u,y\n1,nan\n", "other.csv"), ["y"])
    record = read_log(file, input="u", output="y", time=None)
    assert np.isnan(record.y).sum() == 3
    record.to_csv(file, force=True)
    assert np.isnan(read_log(file, input="u", output="y", time=None).y).sum() == 3


@pytest.mark.parametrize("text", ["oops", "1_000", "1.2.3", "0x10", "--1", "1 2", "٣", "1𝟙"])
def test_text_among_the_numbers_is_named(table, text):
    file = table(f"t,u\n1,2\n2,{text}\n3,4\n")
    with pytest.raises(
        RecordError, match=rf"column 'u' of .*table\.csv has the text '{text}' in row 3"
    ):
        read_columns(file, ["t", "u"], gaps=["u"])


@pytest.mark.parametrize("delimiter", [";", "\t"])
@pytest.mark.parametrize("last", ["", "nan"])
def test_a_decimal_comma_is_recognised(table, delimiter, last):
    rows = ["t", "u"], ["0", "1,5"], ["1e0", "-2,5e-1"], ["2", "3"], ["3", last or "4"]
    file = table("\n".join(delimiter.join(row) for row in rows))
    read = read_columns(file, ["t", "u"], gaps=["u"])
    np.testing.assert_array_equal(read["t"], [0, 1, 2, 3])
    np.testing.assert_array_equal(read["u"], [1.5, -0.25, 3, float(last or 4)])


@pytest.mark.parametrize("text", ['t,u\n0,"1,5"\n', "t;u\n0;1,5\n1;2.5\n"])
def test_a_decimal_comma_beside_other_commas_or_points_is_refused(table, text):
    with pytest.raises(RecordError, match="'1,5' in row 2; write decimals with a point"):
        read_columns(table(text), ["u"])


@pytest.mark.parametrize(
    "text",
    [
        "# made by hand\n% 2026\n\n" + PLAIN,
        "// t,v\n" + PLAIN.replace("\n1", "\n# a pause\n1"),
        "# Time [s],voltage [V],curvature [1/m]\n0,0.5,1\n1,0.6,2\n2,0.7,3\n",
        "time,voltage,curvature\ns,V,1/m\n0,0.5,1\n1,0.6,2\n2,0.7,3\n",
        "time (s),voltage (V),curvature\n,[V],(1/m)\n0,0.5,1\n1,0.6,2\n2,0.7,3\n",
        "t_s,voltage_V,curvature [1/m]\n0,0.5,1\n1,0.6,2\n2,0.7,3\n",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le", "utf-16-be", "utf-8-sig"])
def test_comments_units_and_encodings_are_understood(table, text, encoding):
    file = table(text.encode(encoding))
    read = read_columns(file, ["voltage", "curvature"])
    np.testing.assert_array_equal(read["voltage"], [0.5, 0.6, 0.7])
    np.testing.assert_array_equal(read["curvature"], [1, 2, 3])
    np.testing.assert_array_equal(read_columns(file, ["voltage_V"])["voltage_V"], read["voltage"])
    units = [split_header(header)[1] for header in read_headers(file)]
    assert units == ["s", "V", "1/m"]


@given(
    st.lists(
        st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3),
        min_size=1,
        max_size=30,
    ),
    st.sampled_from([";", ",", "\t"]),
    st.sampled_from([1, 40, 10**6]),
)
def test_blocks_of_numbers_are_read_as_single_cells_are(tmp_path_factory, rows, delimiter, size):
    """The same float64, whatever the size of a block, and the same with a comma in decimals."""
    text = "\n".join([delimiter.join("abc"), *(delimiter.join(map(repr, row)) for row in rows)])
    file = tmp_path_factory.mktemp("blocks") / "table.csv"
    before, text_tables.BLOCK = text_tables.BLOCK, size
    try:
        file.write_text(text)
        found = read_columns(file, ["c", "a"])
        if delimiter != "," and "." in text:
            file.write_text(text.replace(".", ","))
            np.testing.assert_array_equal(read_columns(file, ["c"])["c"], found["c"])
    finally:
        text_tables.BLOCK = before
    np.testing.assert_array_equal(found["c"], [row[2] for row in rows])
    np.testing.assert_array_equal(found["a"], [row[0] for row in rows])


def test_a_gap_does_not_change_the_blocks_around_it(table, monkeypatch):
    monkeypatch.setattr(text_tables, "BLOCK", 50)
    cells = [str(k / 7) for k in range(100)]
    cells[50] = ""
    shares = []
    file = table("t,u\n" + "".join(f"{k},{cell}\n" for k, cell in enumerate(cells)))
    with opened(file, shares.append) as found:
        read = found.read(["t", "u"], gaps=["u"])
    np.testing.assert_array_equal(read["t"], np.arange(100))
    np.testing.assert_array_equal(read["u"], [float(cell or "nan") for cell in cells])
    assert shares[-1] == "100%"
    assert len(shares) > 10


@pytest.mark.parametrize(
    ("asked", "hint"),
    [("voltagee", "voltage [V]"), ("Voltage", "voltage [V]"), ("CURVATURE [1/m]", "curvature")],
)
def test_a_misspelt_column_is_answered_with_the_columns(table, asked, hint):
    with pytest.raises(RecordError) as caught:
        read_columns(table(PLAIN), [asked])
    message = str(caught.value)
    assert f"no column '{asked}', it has 'time [s]', 'voltage [V]', 'curvature [1/m]'" in message
    assert f"did you mean '{hint}" in message


def test_a_name_with_two_units_must_be_given_whole(table):
    file = table("voltage [V],voltage [mV]\n1,1000\n")
    assert read_columns(file, ["voltage [mV]"])["voltage [mV]"] == [1000]
    with pytest.raises(RecordError, match=r"'voltage' of .* could be any of 'voltage \[V\]'"):
        read_columns(file, ["voltage"])


@pytest.mark.parametrize(
    "table_below", ["u,y\n0,1\n2,3\n", "u;y\n0,0;1,0\n2;3\n", "u,y\nV,um\n0,1\n2,3\n"]
)
@pytest.mark.parametrize("above", ["", "Instrument: X\nDate: 2026-01-01\n\n", "Rate,Hz,10\n"])
def test_lines_above_the_header_are_left_out_and_said(table, above, table_below):
    file = table(above + table_below)
    found = read_columns(file, ["u", "y"])
    assert found["u"].tolist() == [0, 2]
    assert found["y"].tolist() == [1, 3]
    with opened(file) as one:
        assert bool(one.notes) == bool(above)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "is empty"),
        (b"u,v\n", "has a header and no rows"),
        (b"\x7fELF\0\0\0\n", "looks like a binary file"),
        (b"u\n\xff\x9d\n", "is neither UTF-8 nor Windows-1252 text"),
        (b"u,v\n1,2\n3\n", "row 3 of .* has 1 cell, the header has 2"),
        (b'u,v\n"1,234.5",2\n', "write numbers without separators of thousands"),
        (b"SQLite format 3\0 and more", "runs export --store .*table.csv --save points.csv"),
        (b"1,2\n3,4\n", "begins with numbers; it needs a header line"),
        (b'u,v\n"1,2\n' + b"3,4\n" * 40_000, "is not a table"),
        (b"u\n1\n\x00\n", "has the text"),
    ],
)
def test_what_is_no_table_is_refused_in_one_sentence(table, content, complaint):
    with pytest.raises(RecordError, match=complaint) as caught:
        read_columns(table(content), ["u"])
    assert "\n" not in str(caught.value)


def test_places_without_a_file_are_refused(tmp_path, table, monkeypatch):
    with pytest.raises(RecordError, match=r"absent\.csv does not exist"):
        read_columns(tmp_path / "absent.csv", ["u"])
    with pytest.raises(RecordError, match="is a folder"):
        read_columns(tmp_path, ["u"])
    with pytest.raises(RecordError, match="not a regular file"):
        read_columns("/dev/zero", ["u"])
    with pytest.raises(RecordError, match="cannot be read"):
        read_columns("a\0b", ["u"])
    monkeypatch.setattr(tables, "MAX_BYTES", 3)
    with pytest.raises(RecordError, match="has 4 bytes, more than the 3 that are read; split it"):
        read_columns(table("u\n1\n"), ["u"])


@pytest.mark.parametrize("letter", ["\x07", "\x1b", "\x7f", "\x9b", "\u2028", "\u202e"])
def test_headers_with_characters_that_are_obeyed_are_refused(letter, table):
    content = f"u,a{letter}b\n1,2\n".encode()
    with pytest.raises(RecordError, match=r"header 2 of .* leave out what cannot be printed"):
        read_headers(table(content))
    with pytest.raises(RecordError, match=r"cannot be printed"):
        read_columns(table(b"u,y\n1,2\n"), [f"u{letter}"])
    with pytest.raises(ParameterError, match="cannot be printed"):
        Quantity("u", f"V{letter}")


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"," * 60_000, "columns or more; give at most 10000"),
        (b"u,y\n" + b"," * 60_000 + b"\n", "line 2 of .* has more than 102 cells"),
        (b"u,y\n" + b'"\n",' * 5_000, "a quoted cell has more than 1000 lines"),
    ],
)
def test_floods_are_refused_before_they_are_kept(content, complaint, table):
    for read in (read_headers, columns.read_each):
        if read is read_headers and content.startswith(b"u,y"):
            continue
        with pytest.raises(RecordError, match=complaint):
            read(table(content))


@pytest.mark.parametrize(
    "cells",
    [
        ["01.03.2026 23:59:58.5", "01.03.2026 23:59:59,5", "2.3.2026 00:00:00"],
        ["2026-03-01 23:59:58.5", "2026-03-01T23:59:59.5", "2026-03-02"],
        ["23:59:58.5", "23:59:59,500", "24:00:00"],
        ["2026-03-01 23:59:58.5", "2026-03-02T00:59:59.5+01:00", "2026-03-02T00:00:00"],
    ],
)
def test_dates_and_times_of_day_are_read(cells, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("when;u\n" + "".join(f"{cell};1\n" for cell in cells))
    seconds = read_columns(path, ["when"], dates=["when"])["when"]
    np.testing.assert_allclose(np.diff(seconds), [1.0, 0.5])
    assert seconds[-1] % 86400 == 0


@pytest.mark.parametrize("cell", ["12:61:00", "32.01.2026 10:00:00", "03/01/2026 10:00:00", "noon"])
def test_other_times_are_refused_with_those_that_are_read(cell, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(f"when;u\n{cell};1\n")
    with pytest.raises(RecordError, match=f"text '{cell}' in row 2; .* or as 2026-03-01T12:00"):
        read_columns(path, ["when"], dates=["when"])

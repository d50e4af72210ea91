from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest
from scipy.io import savemat

from minorloop.errors import MissingExtraError, RecordError
from minorloop.lab import sheets
from minorloop.lab.columns import read_columns, read_each, read_headers
from minorloop.lab.logs import read_log
from minorloop.lab.tables import LARGEST


def test_vectors_of_a_matlab_file_are_columns(tmp_path):
    file = tmp_path / "run.mat"
    savemat(file, {"u": [1.0, 2.0, 3.0], "y": np.array([[4.0], [np.nan], [6.0]]), "note": "text"})
    assert read_headers(file) == ["u", "y"]
    record = read_log(file, input="u", output="y", time=None)
    np.testing.assert_array_equal(record.u, [1, 2, 3])
    np.testing.assert_array_equal(record.y, [4, np.nan, 6])
    np.testing.assert_array_equal(read_each(file)[1][1], [4, np.nan, 6])
    with pytest.raises(RecordError, match=r"run.mat has no column 'v', it has 'u', 'y'"):
        read_columns(file, ["v"])
    with pytest.raises(RecordError, match=r"column 'y' of .* has 'nan' in row 2"):
        read_columns(file, ["y"])


def test_a_column_without_a_unit_takes_the_one_that_is_given(tmp_path):
    file = tmp_path / "run.mat"
    savemat(file, {"u": np.arange(3.0), "d": np.arange(3.0), "t": np.arange(3.0)})
    log = read_log(file, input="u", output="d [mm]", time="t [ms]")
    assert [str(log.input), str(log.output)] == ["u", "d [mm]"]
    np.testing.assert_allclose(log.t, [0, 1e-3, 2e-3])
    assert str(read_log(file, input="u [V]", output="d", time=None).input) == "u [V]"


@pytest.mark.parametrize(
    ("content", "message"), [(b"MATLAB 7.3 no more", "is not a MATLAB file"), (b"", "MATLAB file")]
)
def test_another_file_of_that_name_is_refused(tmp_path, content, message):
    file = tmp_path / "run.mat"
    file.write_bytes(content)
    with pytest.raises(RecordError, match=message):
        read_headers(file)


class TestExcel:
    @pytest.fixture
    def workbook(self, tmp_path):
        openpyxl = pytest.importorskip("openpyxl")

        def write(rows):
            book, file = openpyxl.Workbook(), tmp_path / "run.xlsx"
            for row in rows:
                book.active.append(row)
            book.save(file)
            return file

        return write

    @pytest.mark.parametrize("unit", [[], [["s", "V", "um"]]])
    @pytest.mark.parametrize(
        "title",
        [
            [["Strip 7, annealed"], ["operator", "A. Smith", "room 3"], []],
            [["sample", 7], ["date", datetime(2026, 3, 1)], ["bench", "left"]],
        ],
    )
    def test_its_header_row_is_found_below_titles(self, workbook, title, unit):
        body = [["clock", "u", "y"], *unit, [0.0, 0.5, None], [1.0, 0.25, 2.0], [2.0, 0.5, 3.0]]
        file = workbook([*title, *body])
        assert [header.split()[0] for header in read_headers(file)] == ["clock", "u", "y"]
        found = read_columns(file, ["u", "y"], gaps=["y"])
        np.testing.assert_array_equal(found["u"], [0.5, 0.25, 0.5])
        np.testing.assert_array_equal(found["y"], [np.nan, 2.0, 3.0])

    def test_a_preamble_of_labview_is_skipped_also_where_it_has_numbers(self, workbook):
        end = ["***End_of_Header***"]
        preamble = [["LabVIEW Measurement"], ["Writer_Version", 2], ["Separator", "Tab"], end, []]
        channels = [
            ["Channels", 2],
            ["Samples", 3, 3],
            ["X0", 0.0, 0.0],
            ["Delta_X", 0.1, 0.1],
            end,
        ]
        body = [
            ["X_Value", "u", "y", "Comment"],
            [0.0, 0.5, 1.0],
            [0.1, 0.25, 2.0],
            [0.2, 0.5, 3.0],
        ]
        file = workbook([*preamble, *channels, *body])
        assert read_headers(file) == ["X_Value", "u", "y", "Comment"]
        np.testing.assert_array_equal(read_columns(file, ["y"])["y"], [1.0, 2.0, 3.0])

    def test_the_first_sheet_with_numbers_is_read_and_named(self, workbook):
        file = workbook([["Strip 7, annealed"], ["operator", "A. Smith"]])
        book = __import__("openpyxl").load_workbook(file)
        for name, column in (("run", "y"), ("later", "z")):
            for row in [["u", column], [1, 2], [2, 3], [3, 4]]:
                book[name].append(row) if name in book else book.create_sheet(name).append(row)
        book.save(file)
        assert read_headers(file) == ["u", "y"]
        log = read_log(file, input="u", output="y")
        assert "sheet 'run' is read" in log.notes[0]
        assert "the others are 'Sheet', 'later'" in log.notes[0]
        with pytest.raises(RecordError, match=r"no column 'z'.* the others are 'Sheet', 'later'"):
            read_log(file, input="u", output="z")

    @pytest.mark.parametrize("block", [7, 64])
    def test_a_row_that_is_too_wide_is_refused_before_it_is_read(
        self, workbook, monkeypatch, block
    ):
        monkeypatch.setattr(sheets, "_BLOCK", block)
        few = replace(LARGEST, columns=5)
        file = workbook([list("abcde"), *[[1, 2, 3, 4, 5]] * 50])
        assert sheets.read_sheet(file, few).headers == list("abcde")
        file = workbook([list("ab"), [1, 2], range(200), [1, 2]])
        monkeypatch.setattr("openpyxl.load_workbook", pytest.fail)
        with pytest.raises(RecordError, match=r"run.xlsx has \d+ columns or more; give at most 5"):
            sheets.read_sheet(file, few)


def test_without_openpyxl_the_message_says_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "openpyxl", None)
    file = tmp_path / "run.xlsx"
    file.write_bytes(b"PK")
    with pytest.raises(MissingExtraError, match=r"openpyxl is not installed.*minorloop\[excel\]"):
        read_headers(file)

import struct
import tracemalloc

import numpy as np
import pytest
from scipy.io import savemat

from benchmarks._floods import HEADERS, matlab, variable, workbook
from minorloop.errors import RecordError
from minorloop.lab import text_tables
from minorloop.lab.columns import read_each, read_headers, read_labels
from minorloop.lab.tables import LARGEST, Bounds

MOST = LARGEST.memory + 2**25
"""Bytes that a table at its bound may take, with what is needed to read it."""
SMALL = Bounds(rows=20, columns=3, advice=" here")


def refused(read, file, sentence):
    """Check that a file is refused with a sentence, and what memory this took."""
    tracemalloc.start()
    try:
        with pytest.raises(RecordError, match=sentence) as found:
            read(file)
        assert tracemalloc.get_traced_memory()[1] < MOST
    finally:
        tracemalloc.stop()
    assert str(found.value).count("\n") == 0


@pytest.mark.parametrize("bounds", [LARGEST, SMALL])
def test_a_compressed_variable_is_refused_by_its_header(tmp_path, bounds):
    file = matlab(tmp_path / "run.mat", variable(b"u", 480_000_000, [bytes(2**20)]))
    sentence = r"takes 3840 MB of memory or more; a file of 0\.00\d+ MB may take 268 MB: split it"
    refused(lambda each: read_each(each, bounds), file, sentence)


def test_many_compressed_variables_are_refused_together(tmp_path):
    parts = [variable(b"u%d" % k, 2**21) for k in range(17)]
    file = matlab(tmp_path / "run.mat", *parts)
    refused(read_headers, file, "takes 285 MB of memory or more")


@pytest.mark.parametrize(
    "element",
    [
        variable(b"u", 2, [bytes(8)]),
        variable(b"u", 2, [bytes(8)]) + variable(b"y", 2, [bytes(16)]),
        variable(b"u" * 5000, 2),
        variable(b"u", -2),
        struct.pack("<2I", 15, 2**31) + b"x",
    ],
)
def test_sizes_that_contradict_each_other_are_refused(tmp_path, element):
    sentence = "is not a MATLAB file|has no variable|of memory or more"
    refused(read_headers, matlab(tmp_path / "run.mat", element), sentence)


@pytest.mark.parametrize("version", ["4", "5"])
@pytest.mark.parametrize("packed", [False, True])
def test_variables_are_those_that_were_written(tmp_path, version, packed):
    rng, file = np.random.default_rng(1000), tmp_path / "run.mat"
    kinds = [np.int8, np.uint16, np.int32, np.float32, np.float64][2 if version == "4" else 0 :]
    content = {f"c{k}": rng.integers(0, 99, 50).astype(kind) for k, kind in enumerate(kinds)}
    content |= {"wide": rng.random((3, 40)), "tall": rng.random((40, 2)), "one": 3.0, "z": [1j, 2]}
    savemat(file, content, format=version, do_compression=packed and version == "5")
    found = dict(read_each(file))
    for k in range(len(kinds)):
        np.testing.assert_array_equal(found.pop(f"c{k}"), content[f"c{k}"].astype(float))
    for k in range(3):
        np.testing.assert_array_equal(found.pop(f"wide_{k + 1}"), content["wide"][k])
    for k in range(2):
        np.testing.assert_array_equal(found.pop(f"tall_{k + 1}"), content["tall"][:, k])
    assert found == {}


class TestExcel:
    @pytest.fixture(autouse=True)
    def excel(self, tmp_path):
        pytest.importorskip("openpyxl")
        self.file = tmp_path / "run.xlsx"

    @pytest.mark.parametrize("bounds", [LARGEST, SMALL])
    @pytest.mark.parametrize(
        ("row", "times", "sentence"),
        [
            ("<row><c><v>1</v></c><c r='XFD2'><v>1</v></c></row>", 100, "has 16384 columns or"),
            ("<row>" + "<c><v>1</v></c>" * 20_000 + "</row>", 1, r"has \d+ columns or more"),
            ("<row><c><v>1</v></c><c><v>1</v></c></row>", 300_000, "expands from .* 50 times"),
            ("<row><c t='s'><v>7</v></c></row>", 1, "is not an Excel workbook"),
        ],
    )
    def test_a_flood_is_refused(self, bounds, row, times, sentence):
        file = workbook(self.file, (HEADERS, 1), (row, times))
        refused(lambda each: read_each(each, bounds), file, sentence)

    def test_what_its_rows_take_is_counted(self, monkeypatch):
        bounds = Bounds(memory=2**18)
        monkeypatch.setattr("minorloop.lab.tables.LARGEST", bounds)
        row = "<row><c><v>0.5</v></c><c><v>1.25</v></c></row>"
        file = workbook(self.file, (HEADERS, 1), (row, 5_000))
        refused(lambda each: read_each(each, bounds), file, "of memory or more; a file of .* CSV")
        rows = 2**18 // 200
        assert len(read_each(workbook(self.file, (HEADERS, 1), (row, rows)), bounds)) == 2

    def test_its_texts_are_counted(self):
        file = workbook(self.file, (HEADERS, 1), strings=("a", 600_000))
        refused(read_headers, file, "expands from")

    @pytest.mark.parametrize("dimension", ["", "<dimension ref='A1:XFD1048576'/>"])
    def test_cells_count_and_not_what_the_sheet_says_of_its_size(self, dimension):
        row = "<row r='{0}'><c r='A{0}'><v>{0}</v></c><c r='B{0}'><v>1</v></c><c r='XFD{0}'/></row>"
        far = [(row.format(k), 1) for k in (7, 40_000)]
        file = workbook(self.file, (HEADERS, 1), *far)
        assert [column.tolist() for _, column in read_each(file)] == [[7, 40_000], [1, 1]]


def test_a_text_is_refused_as_soon_as_it_is_too_long_or_wide(tmp_path, monkeypatch):
    monkeypatch.setattr(text_tables, "BLOCK", 100)
    file = tmp_path / "run.csv"
    file.write_text("u,y\n" + "1,2\n" * 20)
    assert len(read_each(file, SMALL)[0][1]) == 20
    file.write_text("u,y\n" + "1,2\n" * 1000 + "x")
    with pytest.raises(RecordError, match=r"has \d\d rows or more; give at most 20 here"):
        read_each(file, SMALL)
    file.write_text("a,b,c,d\n1,2,3,4\n")
    with pytest.raises(RecordError, match="has 4 columns or more; give at most 3 here"):
        read_each(file, SMALL)


@pytest.mark.parametrize("label", ["a", "1"])
def test_a_long_cell_that_many_rows_share_is_not_copied(tmp_path, label):
    pytest.importorskip("openpyxl")
    row = "<row><c><v>1</v></c><c><v>2</v></c><c t='s'><v>1</v></c></row>"
    headers = HEADERS.replace("</row>", "<c t='s'><v>0</v></c></row>")
    long = f"wire</t></si><si><t>{label + ' ' * 30_000}"
    file = workbook(tmp_path / "run.xlsx", (headers, 1), (row, 4000), strings=(long, 1))
    if label == "a":
        refused(lambda each: read_labels(each, "wire"), file, "takes 480 MB of memory or more")
        return
    tracemalloc.start()
    try:
        assert read_labels(file, "wire").tolist() == [1.0] * 4000
        assert tracemalloc.get_traced_memory()[1] < 2**24
    finally:
        tracemalloc.stop()

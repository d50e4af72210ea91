import pytest

from minorloop.errors import RecordError
from minorloop.fleet.manifest import Specimen, read_manifest

HEADER = "specimen,file,input,output"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "lists no specimens"),
        ("specimen,path\na,b\n", "lists no specimens"),
        (f"{HEADER}\n", "lists no specimens"),
        (f"{HEADER},Specimen\na,a.csv,u,y,b\n", "has two columns specimen"),
        (f"{HEADER}\na,a.csv,u,y\na,b.csv,u,y\n", "line 3 of .* names 'a' again"),
        (f"{HEADER}\n,a.csv,u,y\n", "line 2 of .* has no specimen"),
        (f"{HEADER}\na,,u,y\n", "has no file"),
        (f'{HEADER}\n"a\nb",a.csv,u,y\n', "line 2 of .* leave out what cannot be"),
        (f"{HEADER}\na,a.csv,,y\n", "has no input"),
        (f"{HEADER}\na,a.csv,u,y,z\n", "more cells than the header"),
        (f'{HEADER}\n"a,a.csv,u,y\n', "is not a CSV file"),
        (f"{HEADER}\na,a.csv,u,u\n", "has 'u' for input and output; give two columns"),
    ],
)
def test_manifests_that_cannot_be_used(text, message, tmp_path):
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(RecordError, match=message):
        read_manifest(tmp_path / "m.csv")


def test_a_manifest_that_is_not_there_or_not_text(tmp_path):
    with pytest.raises(RecordError, match="cannot be read"):
        read_manifest(tmp_path / "nothing.csv")
    (tmp_path / "m.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordError, match="cannot be read"):
        read_manifest(tmp_path / "m.csv")


def test_columns_may_be_given_once_for_all(tmp_path):
    (tmp_path / "m.csv").write_text("specimen,file\na,x/a.csv\n")
    (one,) = read_manifest(tmp_path / "m.csv", input="u", output="y")
    assert (one.input, one.output, one.file) == ("u", "y", tmp_path / "x" / "a.csv")


@pytest.mark.parametrize(
    "text",
    [
        "Specimen, File, input, OUTPUT\na, a.csv, u, y\n",
        "specimen;file;input;output\na;a.csv;u;y\n",
        "specimen\tfile\tinput\toutput\na\ta.csv\tu\ty\n",
        "specimen,file,input,output\na,a.csv,u,y\n,,,,\n,,,\n",
        "specimen,file,input,output\na,a.csv,u,y,,\n",
    ],
)
def test_manifests_as_spreadsheets_write_them(text, tmp_path):
    (tmp_path / "m.csv").write_text(text)
    (one,) = read_manifest(tmp_path / "m.csv")
    assert (one.name, one.file, one.input, one.output) == ("a", tmp_path / "a.csv", "u", "y")


def test_names_that_are_no_file_names_stay_inside_the_folder():
    names = ["../../a", "/etc/a", "a b", "a_b", ".", "..", "ä", "a/b", "é" * 60, "n" * 300]
    names.append("n" * 299 + "m")
    keys = [Specimen(name, None, "u", "y").key for name in names]
    assert len(set(keys)) == len(names)
    for key in keys:
        assert "/" not in key
        assert key.strip(".")
        assert len(key) < 200

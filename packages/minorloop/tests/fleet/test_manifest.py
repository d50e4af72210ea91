import pytest

from minorloop.errors import RecordError
from minorloop.fleet._fitting import Task, identify_one
from minorloop.fleet.manifest import Specimen, read_manifest

HEADER = "specimen,file,input,output"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "lists no specimens"),
        (f"{HEADER}\n", "lists no specimens"),
        (f"{HEADER},Specimen\na,a.csv,u,y,b\n", "has two columns specimen"),
        (f"{HEADER}\na,a.csv,u,y\na,b.csv,u,y\n", "line 3 of .* names 'a' again"),
        (f"{HEADER}\n,a.csv,u,y\n", "line 2 of .* has no specimen"),
        (f"{HEADER}\na,,u,y\n", "has no file"),
        (f'{HEADER}\n"a\nb",a.csv,u,y\n', "line 2 of .* leave out what cannot be"),
        (f"{HEADER}\na,\u202eb,u,y\n", "leave out what cannot be printed"),
        (f"{HEADER}\na,a.csv,,y\n", "has no input"),
        (f'{HEADER}\n"a,a.csv,u,y\n', "is not a CSV file"),
        (f"{HEADER}\na,a.csv,u,u\n", "has 'u' for input and output; give two columns"),
    ],
)
def test_refuses_unusable_manifests(text, message, tmp_path):
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(RecordError, match=message):
        read_manifest(tmp_path / "m.csv")


def test_the_apostrophe_for_spreadsheets_is_removed_from_names(tmp_path):
    (tmp_path / "m.csv").write_text(f"{HEADER}\n'=1+1,a.csv,'@u,y\n")
    (one,) = read_manifest(tmp_path / "m.csv")
    assert (one.name, one.input) == ("=1+1", "@u")


@pytest.mark.parametrize("how", ["above", "absolute", "link"])
def test_messages_do_not_quote_files_outside_the_folder(how, tmp_path):
    secret, folder = tmp_path / "secret", tmp_path / "fleet"
    folder.mkdir()
    secret.write_text("root:x:0:0,password\n1,hunter2\n")
    (folder / "link.csv").symlink_to(secret)
    named = {"above": "../secret", "absolute": secret, "link": "link.csv"}[how]
    (folder / "m.csv").write_text(f"{HEADER}\na,{named},u,y\nb,{named},root:x:0:0,password\n")
    for one in read_manifest(folder / "m.csv"):
        said = identify_one(Task(one, one.read(), {}), tmp_path / "scratch")[0].error
        assert "outside the folder of the manifest" in said
        assert "hunter2" not in said
        assert "root:x" not in said or one.name == "b"  # whose row names the columns itself


def test_refuses_a_manifest_that_is_missing_or_not_text(tmp_path):
    with pytest.raises(RecordError, match=r"nothing.csv does not exist; give a table"):
        read_manifest(tmp_path / "nothing.csv")
    (tmp_path / "m.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordError, match="cannot be read"):
        read_manifest(tmp_path / "m.csv")


def test_a_column_of_time_is_found_named_or_left_out(tmp_path):
    (tmp_path / "m.csv").write_text(
        f"{HEADER},time\na,a.csv,u,y,\nb,a.csv,u,y,t\nc,a.csv,u,y,none\n"
    )
    found = [one.columns.get("time", "found") for one in read_manifest(tmp_path / "m.csv")]
    assert found == ["found", "t", None]


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


def test_names_with_slashes_stay_inside_the_folder():
    names = ["../../a", "/etc/a", "a b", "a_b", ".", "..", "ä", "a/b", "é" * 60, "n" * 300]
    names.append("n" * 299 + "m")
    keys = [Specimen(name, None, "u", "y").key for name in names]
    assert len(set(keys)) == len(names)
    for key in keys:
        assert "/" not in key
        assert key.strip(".")
        assert len(key) < 200

from minorloop import modelfile

LINE = "export c model.json --out firmware"


def line(options):
    return LINE.replace("export c", f"export c:{options}")


def test_c_is_written_and_described(run, tmp_path):
    status, out, err = run(line("float32=yes,memory=16"))
    assert (status, err) == (0, "")
    assert "./selftest" in out
    assert "length [um] against voltage [V]" in out
    assert {file.name for file in (tmp_path / "firmware").iterdir()} == {
        "minorloop.h",
        "minorloop.c",
        "minorloop_selftest.c",
    }
    assert "float" in (tmp_path / "firmware" / "minorloop.h").read_text()


def test_header_and_source_say_why_the_model_is_not_to_be_trusted(run, model, tmp_path):
    words = ["the output is clipped */ " + 12 * "everywhere ", "it lags"]
    modelfile.save(model, "model.json", warnings=words, force=True)
    assert run(LINE)[0] == 0
    for name in ("minorloop.h", "minorloop.c"):
        comment = (tmp_path / "firmware" / name).read_text().split("*/")[0]
        said = " ".join(comment.replace("\n *", " ").split())
        assert "WARNING: this model is not to be trusted: the output is clipped" in said
        assert "everywhere ; it lags" in said
        assert max(map(len, comment.splitlines())) <= 100


def test_force_replaces_files(run, refused, tmp_path):
    assert run(LINE)[0] == 0
    (tmp_path / "firmware" / "main.c").write_text("mine")
    (tmp_path / "firmware" / "minorloop.c").write_text("old")
    assert "is not empty" in refused(LINE)
    assert run(f"{LINE} --force")[0] == 0
    assert (tmp_path / "firmware" / "main.c").read_text() == "mine"
    assert "levels" in (tmp_path / "firmware" / "minorloop.c").read_text()

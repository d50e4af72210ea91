import re

HEADER = "specimen,file,input,output"


def test_a_fleet_of_two_and_one_that_is_missing(answer, run, tmp_path):
    rows = ["a,good.csv,voltage,length", "b,good.csv,voltage,length", "c,gone.csv,voltage,length"]
    (tmp_path / "manifest.csv").write_text("\n".join([HEADER, *rows]) + "\n")
    line = "fleet manifest.csv --out fleet --law levels=8 --prior smooth --workers 1"
    found = answer(line)
    assert 0 < found["figures"]["excited"]["min"] <= 1
    assert "nrmse_holdout" not in found["figures"]
    held = answer(f"{line.replace('--out fleet', '--out held')} --holdout 0.2")["figures"]
    assert 0 < held["nrmse_holdout"]["median"] < 1
    assert (found["specimens"], found["identified"], found["failed"]) == (3, 2, 1)
    assert (tmp_path / "fleet" / "models" / "a.json").exists()
    (tmp_path / "gone.csv").write_bytes((tmp_path / "good.csv").read_bytes())
    status, out, _ = run(line)
    assert status == 0
    assert "3 of 3 specimens identified" in out
    assert "three quarters" in out


def test_the_exit_status_is_1_if_nothing_is_identified(run, tmp_path):
    (tmp_path / "manifest.csv").write_text(f"{HEADER}\na,gone.csv,u,y\nb,lost.csv,u,y\n")
    status, out, said = run("fleet manifest.csv --out fleet --law levels=8")
    assert status == 1
    assert "0 of 2 specimens identified" in out
    assert "models" not in out
    assert re.fullmatch("1 of 2 specimens, last [ab]\n", said)


def test_refusals(refused, tmp_path):
    assert "no law of a fleet 'viscosity'" in refused("fleet m.csv --out f --law viscosity")
    assert "does not exist; give a table" in refused("fleet manifest.csv --out fleet")
    (tmp_path / "m.csv").write_text("specimen,file\na,good.csv\n")
    assert "has no input" in refused("fleet m.csv --out fleet")
    line = "fleet m.csv --out fleet --input voltage --output length"
    assert "there is no Dask scheduler at" in refused(f"{line} --workers tcp://127.0.0.1:1")
    assert "limit is -1.0 s; give a positive time" in refused(f"{line} --limit -1")
    assert "workers is 0" in refused(f"{line} --workers 0")
    assert "smoothness is 'much'" in refused(f"{line} --prior smooth:strength=much")
    assert "give one of 'bipolar'" in refused(f"{line} --law relay=foo")
    assert not (tmp_path / "fleet").exists()

import re

HEADER = "specimen,file,input,output"


def test_a_fleet_of_two_and_one_that_is_missing(answer, run, tmp_path):
    rows = ["a,good.csv,voltage,length", "b,good.csv,voltage,length", "c,gone.csv,voltage,length"]
    (tmp_path / "manifest.csv").write_text("\n".join([HEADER, *rows]) + "\n")
    line = "fleet manifest.csv --out fleet --law levels=8 --prior smooth --workers 1 --holdout 0.2"
    found = answer(line)
    assert 0 < found["figures"]["excited"]["min"] <= 1
    assert 0 < found["figures"]["nrmse_holdout"]["median"] < 1
    assert (found["specimens"], found["identified"], found["failed"]) == (3, 2, 1)
    assert (tmp_path / "fleet" / "models" / "a.json").exists()
    (tmp_path / "gone.csv").write_bytes((tmp_path / "good.csv").read_bytes())
    status, out, _ = run(line)
    assert status == 0
    assert "3 of 3 specimens identified" in out
    assert "quarters" in out


def test_the_exit_status_is_1_if_nothing_is_identified(run, tmp_path):
    (tmp_path / "manifest.csv").write_text(f"{HEADER}\na,gone.csv,u,y\nb,lost.csv,u,y\n")
    status, out, said = run("fleet manifest.csv --out fleet --law levels=8")
    assert status == 1
    assert "0 of 2 specimens identified" in out
    assert "models" not in out
    assert re.fullmatch("1 of 2 specimens, last [ab]\n", said)

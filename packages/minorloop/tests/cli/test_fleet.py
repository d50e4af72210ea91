import re

HEADER = "specimen,file,input,output"


def test_the_exit_status_is_1_if_nothing_is_identified(run, tmp_path):
    (tmp_path / "manifest.csv").write_text(f"{HEADER}\na,gone.csv,u,y\nb,lost.csv,u,y\n")
    status, out, said = run("fleet manifest.csv --out fleet --law levels=8")
    assert status == 1
    assert "0 of 2 specimens identified" in out
    assert "models" not in out
    assert re.fullmatch("1 of 2 specimens, last [ab]\n", said)

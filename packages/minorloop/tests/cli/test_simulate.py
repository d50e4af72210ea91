from pathlib import Path

import numpy as np

from minorloop import modelfile


def test_time_is_found_as_by_identify(answer, model):
    times, u = 0.5 * np.arange(6), [0.0, 0.3, 1.0, 0.6, 0.2, 0.4]
    rows = [f"{t},{x}\n" for t, x in zip(times, u, strict=True)]
    Path("timed.csv").write_text("t [s],voltage [V]\n" + "".join(rows))
    modelfile.save(model, "late.json", lag=1, force=True)
    found = answer("simulate late.json timed.csv --input voltage --save out.csv")
    assert Path("out.csv").read_text().startswith("t [s],input,output")
    assert found["notes"] == [
        "time: column 't [s]'; name another one, or none, with time= (--time)"
    ]
    Path("timed.csv").write_text("t [s],voltage [V]\n1,0\n0,1\n")
    (said,) = answer("simulate model.json timed.csv")["notes"]
    assert said.startswith("time: none, because column 't [s]'")


def test_another_prefix_is_converted_and_another_unit_refused(answer, refused, model):
    Path("other.csv").write_text("voltage [mV]\n300\n")
    assert answer("simulate model.json other.csv")["y"] == model.simulate([0.3]).tolist()
    Path("other.csv").write_text("voltage [A]\n300\n")
    assert "is in A and the model in V" in refused("simulate model.json other.csv")


def test_times_may_begin_anew_with_each_curve_and_not_within_one(answer, refused):
    rows = [f"{t},{0.1 * (t % 7)},{name}\n" for name in "ab" for t in range(20)]
    Path("anew.csv").write_text("time [s],voltage [V],curve\n" + "".join(rows))
    line = "simulate model.json anew.csv --time time"
    found = answer(f"{line} --record curves=curve")["y"]
    assert found == answer("simulate model.json anew.csv --record curves=curve")["y"]
    assert "runs backwards in row 22" in refused(line)
    saved = answer(f"{line} --record curves=curve --save saved.csv")
    assert "--record start_of_curve" in saved["notes"][0]
    header, first = Path("saved.csv").read_text().splitlines()[:2]
    assert header.startswith("time [s],curve,voltage [V],")
    assert first.startswith("0.0,a,0.0,")
    assert "notes" not in answer(f"{line} --record curves=curve,start_of_curve=negative")

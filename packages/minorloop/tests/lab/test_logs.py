import numpy as np
import pytest

from fixed_options import Options
from minorloop import ParameterError, Preisach, Record, RecordError
from minorloop.lab.columns import read_headers
from minorloop.lab.logs import read_log
from minorloop.lab.timebase import time_column

MODEL = Preisach(np.linspace(-1, 1, 7), np.tril(np.ones((6, 6))))
T = 0.01 * np.arange(2000)
U = np.exp(-T / 20) * np.sin(T * 4)


def write(path, t, u, y, header="time [s],u [V],y [um]"):
    np.savetxt(path, np.column_stack([t, u, y]), delimiter=",", header=header, comments="")
    return path


@pytest.fixture
def file(tmp_path):
    return tmp_path / "log.csv"


def test_a_lag_in_seconds_is_taken_out_of_uneven_samples(file):
    """The lag is 25 ms, and rows are 5 to 15 ms apart."""
    t = np.cumsum(np.random.default_rng(1000).uniform(0.005, 0.015, 1900))
    u = np.interp(t, T, U)
    y = MODEL.simulate(np.interp(t - 0.025, t, u))
    log = read_log(write(file, t, u, y), input="u", output="y", time="time")
    assert "samples are uneven" in log.notes[0]
    options = {"levels": MODEL.levels, "smoothness": 0.0}
    right = Options.of(options).identify(Record(*_columns(log.without_lag(0.025))))
    wrong = Options.of(options).identify(Record(log.u, log.y))
    assert right.nrmse < 0.2 * wrong.nrmse
    found = Options.of({"lag": "auto", **options}).identify(Record(*_columns(log.evenly_sampled())))
    assert found.lag * log.check.interval == pytest.approx(0.025, abs=0.006)


def _columns(record):
    return record.u, record.y


def test_dates_and_units_give_seconds(file):
    stamps = [f"2026-03-01T12:00:{k:02d}.500" for k in range(30)]
    file.write_text("when,u,y\n" + "".join(f"{s},{k},{k}\n" for k, s in enumerate(stamps)))
    record = read_log(file, input="u", output="y", time="when")
    np.testing.assert_allclose(record.t, np.arange(30.0))
    for header in ("t [ms]", "t_ms"):
        write(file, 1000.0 * np.arange(30), np.arange(30), np.arange(30), f"{header},u,y")
        record = read_log(file, input="u", output="y", time=header)
        np.testing.assert_allclose(record.t, np.arange(30.0))


def test_a_column_cannot_be_used_twice_or_have_another_unit(file):
    write(file, T, U, U)
    with pytest.raises(ParameterError, match=r"input .* and time \(--time\) are both 'u \[V\]'"):
        read_log(file, input="u", output="y", time="u [V]")
    with pytest.raises(RecordError, match=r"'y \[um\]' must be in one of s, ms, us, ns, min, h, d"):
        read_log(file, input="u", output="time", time="y")


def test_a_file_in_another_encoding_is_read_and_said(tmp_path):
    file = tmp_path / "log.csv"
    rows = "".join(f"{k},{k % 7},{k}\n" for k in range(20))
    text = f"# 20 °C, Öffnung\nt [s],u [V],y [µm]\n{rows}"
    for encoding in ("cp1252", "utf-8"):
        file.write_bytes(text.encode(encoding))
        log = read_log(file, input="u", output="y", time="t")
        assert str(log.output) == "y [µm]"
        assert ["Windows-1252" in note for note in log.notes] == [True] * (encoding == "cp1252")


@pytest.mark.parametrize("header", ["Datum;Uhrzeit", "date;time [hh:mm:ss.f]"])
def test_the_time_of_day_is_the_time_and_continues_after_midnight(header, tmp_path):
    path = tmp_path / "log.csv"
    clock = [f"23:59:{50 + k:02d}.0" for k in range(10)] + [f"00:00:{k:02d}.0" for k in range(10)]
    rows = "".join(f"1.3.2026;{cell};{k};{k}\n" for k, cell in enumerate(clock))
    path.write_text(f"{header};u;y\n{rows}")
    name = time_column(read_headers(path))
    found = read_log(path, input="u", output="y", time=name)
    np.testing.assert_allclose(np.diff(found.t), 1.0)
    assert not found.breaks.size
    assert "time of day at midnight" in found.notes[0]


def test_the_input_of_another_logger_is_interpolated_at_the_times_of_the_output(tmp_path):
    path = tmp_path / "merged.csv"
    inputs = [f"{0.2 * k:.6f},{np.sin(0.1 * k):.9f}," for k in range(200)]
    outputs = [f"{0.2 * k + 0.07:.6f},,{0.2 * k + 0.07:.6f}" for k in range(198)]
    del inputs[100:120]
    rows = sorted(inputs + outputs, key=lambda row: float(row.split(",")[0]))
    path.write_text("time [s],u [V],y\n" + "\n".join(rows) + "\n")
    found = read_log(path, input="u", output="y", time="time")
    np.testing.assert_allclose(found.u, np.sin(0.5 * found.t), atol=2e-3)
    measured = np.isfinite(found.y)
    np.testing.assert_allclose(found.y[measured], found.t[measured])
    assert measured.sum() == 198 - 21
    assert found.check.gaps.size == 1
    assert "u [V] is empty in 198 of 378 rows, as if two loggers were merged" in found.notes[0]
    assert "21 rows without readings near are left out" in found.notes[0]
    with pytest.raises(RecordError, match=r"name the column of time \(--time\)"):
        read_log(path, input="u", output="y", time=None)
    path.write_text("time [s],u [V],y\n" + "\n".join(rows[::-1]) + "\n")
    with pytest.raises(RecordError, match="order of time: sort them"):
        read_log(path, input="u", output="y", time="time")

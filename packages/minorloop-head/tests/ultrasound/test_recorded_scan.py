import json
import math
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.io import savemat

from minorloop.errors import ParameterError, RecordError
from minorloop_head.ultrasound.recorded_scan import RecordedScan, read_scan
from minorloop_head.ultrasound.scan_flaws import scan_flaws

h5py = pytest.importorskip("h5py")
RNG = np.random.default_rng(1)
LINE = RecordedScan(
    RNG.normal(size=(120, 9, 1)), 4e-8, 1e-5, (1e-3, math.nan), (1480.0, 5900.0), (0.02, 0.01),
    (1e6, 4e6), 6e-3, 30.0,
)  # fmt: skip
RASTER = replace(LINE, traces=RNG.normal(size=(120, 7, 5)), steps=(1e-3, 2e-3))


def mat(scan, path):
    savemat(path, scan.fields())


def npz(scan, path):
    np.savez(path, **scan.fields())


def hdf(scan, path):
    with h5py.File(path, "w") as file:
        group = file.create_group("measurement")
        group["traces"] = scan.traces
        for name, value in scan.fields().items():
            if name != "traces":
                group.attrs[name] = value


def mat73(scan, path):
    """As MATLAB writes it: HDF5 behind a user block of 512 bytes, axes in the other order."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in scan.fields().items():
            file[name] = np.atleast_2d(value).T if np.ndim(value) < 3 else value.T
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(512))


def csv(scan, path):
    head = [
        f"# {name}: {', '.join(map(repr, np.atleast_1d(value).tolist()))}"
        for name, value in scan.fields().items()
        if name != "traces"
    ]
    rows = [",".join(map(repr, row)) for row in scan.traces[:, :, 0].tolist()]
    path.write_text("\n".join([*head, *rows]))


def nde(scan, path):
    lengths = dict(zip(("UCoordinate", "VCoordinate"), scan.steps, strict=True))
    axes = [
        {"axis": name, "quantity": n, "resolution": 1.0 if math.isnan(step) else step}
        for (name, step), n in zip(lengths.items(), scan.traces.shape[1:], strict=True)
    ]
    axes.append({"axis": "Ultrasound", "resolution": scan.interval, "offset": scan.start})
    data = {"dataClass": "AScanAmplitude", "path": "/Public/Groups/0/Datasets/0-AScanAmplitude"}
    wave = {"longitudinalWave": {"nominalVelocity": 5900.0}}
    setup = {
        "version": "4.1.0",
        "groups": [{"datasets": [{**data, "dimensions": axes}]}],
        "specimens": [{"plateGeometry": {"material": wave}}],
    }
    with h5py.File(path, "w") as file:
        file[data["path"]] = np.moveaxis(scan.traces, 0, -1)
        file["Public/Setup"] = json.dumps(setup)


@pytest.mark.parametrize("scan", [LINE, RASTER], ids=["line", "raster"])
@pytest.mark.parametrize("write", [mat, mat73, hdf, npz, csv, nde], ids=lambda one: one.__name__)
def test_a_scan_is_read_as_it_was_written(tmp_path, write, scan):
    if write is csv and scan is RASTER:
        pytest.skip("a table has lines only")
    path = tmp_path / ("scan.npz" if write is npz else "scan")
    write(scan, path)
    found = read_scan(path)
    assert np.array_equal(found.traces, scan.traces)
    for field in fields(RecordedScan)[1:]:
        if write is nde and field.name not in ("interval", "start", "steps"):
            continue
        value, wanted = (np.asarray(getattr(one, field.name), dtype=float) for one in (found, scan))
        assert value == pytest.approx(wanted, nan_ok=True), field.name
    assert write is not nde or found.speeds == (5900.0,)


def test_fields_have_the_names_that_people_give_them_or_that_are_named(tmp_path):
    path = tmp_path / "a.npz"
    places, times = 1e-3 * np.arange(9), 1e-5 + 4e-8 * np.arange(120)
    np.savez(path, b_scan=LINE.traces[:, :, 0].T, Time=times, X_pos=places, v=[1480.0])
    found = read_scan(path, names={"speeds": "v"})
    assert np.array_equal(found.traces, LINE.traces)
    assert (found.interval, found.start) == pytest.approx((4e-8, 1e-5))
    assert found.steps[0] == pytest.approx(1e-3)
    assert read_scan(path, speeds=[1500, 2700]).speeds == (1500, 2700)
    with pytest.raises(ParameterError, match="--field speed=v: fields are traces"):
        read_scan(path, names={"speed": "v"})


def text(path):
    path.write_text("the quick brown fox\n")


def nothing(path):
    np.savez(path.with_suffix(".npz"), name=np.array(["a"]))
    path.with_suffix(".npz").rename(path)


def damaged(path):
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))


def without(name, **others):
    def write(path):
        content = {k: v for k, v in {**LINE.fields(), **others}.items() if k != name}
        savemat(path, content)

    return write


def holed(path):
    traces = LINE.traces.copy()
    traces[3, 2] = np.nan
    savemat(path, {**LINE.fields(), "traces": traces})


def cut(path):
    savemat(path, LINE.fields())
    path.write_bytes(path.read_bytes()[:100])


REFUSED = [
    (text, "is no scan"),
    (lambda path: path.touch(), "is no scan .it has no samples"),
    (cut, "is no scan"),
    (without("", traces=np.zeros((90, 9))), "all its samples are 0"),
    (without("dt", rate=0.0), "give the sampling rate with --given rate=MHZ"),
    (without("dt", rate=1e15), "in which this band does not fit"),
    (without("", fLow=1e6, fHigh=20e6), "the band of the pulse is 1 to 20 MHz"),
    (damaged, "cannot be read"),
    (nothing, "has no A-scans, but name"),
    (holed, "1 of 1080 samples are not finite, the first at sample 3 of the A-scan at 2, 0"),
    (without("", traces=LINE.traces[:, :1]), "one A-scan"),
    (without("traces", ptx=LINE.traces[:, 0, 0]), "it is one A-scan"),
    (without("", fLow=20e6, fHigh=30e6), "the band of the pulse is 20 to 30 MHz"),
    (without("dx"), "give the distance between A-scans with --given step=MM, up to 100"),
    (without("", dx=1.0), "give the distance between A-scans with --given step=MM, up to 100"),
    (without("", disc=-1e-3), "give more than 0, up to 100 mm, with --given disc=MM"),
    (without("dx", x=[0, 1, 2, 4, 5, 6, 7, 8, 9.0]), "give a scan with equal ones"),
    (without("dt"), "give the sampling rate with --given rate=MHZ"),
    (without("speeds"), "give those of the layers with --speeds"),
    (without("speeds", cc=[1.48, 5.9]), "give those of the layers with --speeds"),
    (without("traces", ptpz=LINE.traces, phiStep=0.1), "a scan of a cylinder"),
    (without("", traces=np.full((3, 4, 5, 6), 1.0)), "give samples by places"),
]


@pytest.mark.parametrize(("write", "said"), REFUSED, ids=[said for _, said in REFUSED])
def test_what_is_no_scan_is_refused_in_one_sentence(tmp_path, write, said):
    path = tmp_path / "scan"
    write(path)
    with pytest.raises(RecordError, match=said) as caught:
        scan_flaws(read_scan(path))
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_the_band_of_a_pulse_is_found_in_its_spectrum(noise):
    t = 4e-8 * np.arange(900)
    burst = np.exp(-(((t - 8e-6) / 4e-7) ** 2)) * np.cos(2 * np.pi * 2.5e6 * t)
    traces = np.repeat(burst[:, None, None], 40, axis=1)
    traces += noise * np.random.default_rng(2).normal(size=traces.shape)
    low, high = replace(LINE, traces=traces, band=(np.nan, np.nan)).pulse_band
    assert 1.0e6 < low < 2.0e6
    assert 3.0e6 < high < 4.0e6

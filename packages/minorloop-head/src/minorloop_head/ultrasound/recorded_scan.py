"""Third-party recordings of A-scans on a line or a raster, and their files.

Files are MATLAB files of any version, HDF5, NDE, NPZ and CSV. The content shows the kind of a file.
A field is recognised by its usual names: `NAMES`.
"""

from __future__ import annotations

import json
import math
import os
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, RecordError

NAMES = {
    "traces": "ptx ptxy ascans ascan traces bscan cscan amplitude signals signal data rf p",
    "rate": "fs samplingfrequency samplingrate samplerate rate",
    "interval": "dt sampleinterval interval tstep timestep",
    "times": "t time times tvec",
    "start": "tdelay t0 delay start tstart",
    "x_step": "xstep dx stepx scanstep step pitch",
    "y_step": "ystep dy stepy indexstep",
    "x": "x xpos xpositions positions",
    "y": "y ypos ypositions",
    "speeds": "cc c speeds speed velocity velocities soundspeed wavevel",
    "thicknesses": "thick thickness thicknesses layerthick",
    "frequency": "fc frequency centrefrequency centerfrequency f0",
    "low": "flow",
    "high": "fhigh",
    "disc": "transdiam disc discdiameter diameter elementdiameter",
    "gain": "gain gaindb",
}
"""Names of each field, in the order of the search, without capitals and underscores.
All are in SI units, and the gain in dB."""
_TIME_FIRST = ("ptx", "ptxy")
"""Names of arrays whose first axis is time; of others it is the longest."""
_SPEEDS, _LONGEST = (100.0, 15_000.0), 1e-3
"""Plausible speeds of sound in m/s, and longest plausible interval between samples in s."""
_WIDEST = 0.1
"""Largest step between A-scans and largest disc in metres: both are some mm."""
_UNEVEN = 0.05
"""Largest relative deviation of a step from the mean step."""
_EDGE, _SMOOTHED = 0.2, 50
"""Least height of a spectrum over its median in the band of the pulse, as a share of that of the
top; and parts over which the spectrum is smoothed."""
_CLIPPED = 3
"""Fewest equal samples at the largest value of a clipped A-scan."""
_ROUND = 0.5
"""Half bandwidth of a pulse with a known centre only, as a share of the centre."""


@dataclass(frozen=True, eq=False)
class RecordedScan:
    """A-scans at equal steps along a line or in a raster.

    Raises
    ------
    RecordError
        If it is one A-scan, has no steps or no speeds, or a sample is not finite.
    """

    traces: FloatArray
    """Shape (T, X, Y); Y is 1 for a line."""
    interval: float
    """Between samples, in seconds."""
    start: float
    """Time of the first sample since the pulse was fired, in seconds."""
    steps: tuple[float, float]
    """Between places along x and y, in metres; that along y is NaN for a line."""
    speeds: tuple[float, ...]
    """Speeds of sound in the layers from the probe on, in m/s; the first is that of water, if
    present."""
    thicknesses: tuple[float, ...] = ()
    """Known thicknesses of the layers, in metres; may have fewer, and NaN."""
    band: tuple[float, float] = (math.nan, math.nan)
    """Lowest and highest frequency of the pulse, in Hz; those of the spectrum if not known."""
    disc: float = math.nan
    """Diameter of the disc of the probe, in metres."""
    gain: float = math.nan
    """In dB."""
    start_known: bool = True
    """Whether the time of the first sample is known, instead of assumed as 0."""

    def __post_init__(self) -> None:
        traces, (dx, dy) = self.traces, self.steps
        if traces.ndim != 3 or traces.shape[1] * traces.shape[2] < 2:
            raise RecordError(
                "it is one A-scan, which shows no places of flaws; give a scan of two or more"
            )
        bad = ~np.isfinite(traces)
        if bad.any():
            place = np.argwhere(bad)[0]
            raise RecordError(
                f"{bad.sum()} of {traces.size} samples are not finite, the first at sample "
                f"{place[0]} of the A-scan at {place[1]}, {place[2]}; leave these A-scans out"
            )
        if not np.ptp(traces) > 0:
            raise RecordError(
                f"all its samples are {traces.flat[0]:g}, so that it shows nothing; check the "
                "digitiser, and which field has the A-scans"
            )
        if not (0 < dx <= _WIDEST and (traces.shape[2] == 1 or 0 < dy <= _WIDEST)):
            raise RecordError(
                f"its steps are {dx} and {dy} m; give the distance between A-scans with --given "
                f"step=MM, up to {1e3 * _WIDEST:g}"
            )
        if not (math.isnan(self.disc) or 0 < self.disc <= _WIDEST):
            raise RecordError(
                f"the disc is {self.disc} m wide; give more than 0, up to {1e3 * _WIDEST:g} mm, "
                "with --given disc=MM, or leave it out"
            )
        if not 0 < self.interval < _LONGEST or not math.isfinite(self.start):
            raise RecordError(
                f"the interval between samples is {self.interval} s, and the first is at "
                f"{self.start} s; give the sampling rate with --given rate=MHZ,start=US"
            )
        slow, fast = _SPEEDS
        if not self.speeds or not all(slow <= each <= fast for each in self.speeds):
            raise RecordError(
                f"speeds of sound are {list(self.speeds)}; give those of the layers with --speeds, "
                f"{slow:g} to {fast:g} m/s"
            )
        low, high = self.pulse_band
        long = len(traces) * self.interval
        if not 1 / long < low < high <= 0.5 / self.interval:
            raise RecordError(
                f"the band of the pulse is {1e-6 * low:.3g} to {1e-6 * high:.3g} MHz, the sampling "
                f"rate {1e-6 / self.interval:.3g} MHz, and an A-scan {1e6 * long:.3g} us long, in "
                "which this band does not fit; give --given rate=MHZ,low=MHZ,high=MHZ"
            )

    @cached_property
    def pulse_band(self) -> tuple[float, float]:
        """The known band, or the part of the spectrum around its top that is above the noise."""
        if all(np.isfinite(self.band)):
            return self.band
        flat = self.traces.reshape(len(self.traces), -1)
        power = (np.abs(np.fft.rfft(flat - flat.mean(axis=0), axis=0)) ** 2).mean(axis=1)
        width = max(len(power) // _SMOOTHED, 1)
        smooth = np.sqrt(np.convolve(power, np.full(width, 1 / width), mode="same"))
        over = smooth - np.median(smooth)
        top = int(over.argmax())
        low = np.flatnonzero(over < _EDGE * over[top])
        first, last = low[low < top].max(initial=0) + 1, low[low > top].min(initial=len(over))
        unit = 1 / (len(flat) * self.interval)
        return float(first * unit), float(last * unit)

    @cached_property
    def clipped(self) -> bool:
        """Whether most A-scans stay at their largest value for several samples."""
        size = np.abs(self.traces)
        return bool(np.median((size >= size.max(axis=0)).sum(axis=0)) >= _CLIPPED)

    @cached_property
    def resolution(self) -> float:
        """The smallest difference of two samples: that of the digitiser, unless it is finer."""
        return float(np.diff(np.unique(self.traces)).min(initial=np.inf))

    def fields(self) -> dict[str, Any]:
        """Return the scan as fields whose names `read_scan` knows."""
        return {
            "traces": self.traces,
            "dt": self.interval,
            "t0": self.start,
            "dx": self.steps[0],
            "dy": self.steps[1],
            "speeds": np.array(self.speeds),
            "thicknesses": np.array(self.thicknesses),
            "fLow": self.band[0],
            "fHigh": self.band[1],
            "disc": self.disc,
            "gain": self.gain,
        }


def read_scan(
    path: str | os.PathLike[str],
    *,
    names: Mapping[str, str] | None = None,
    **values: Any,
) -> RecordedScan:
    """Read a scan.

    Parameters
    ----------
    path : path
        A MATLAB, HDF5, NDE, NPZ or CSV file. A CSV file has a row for each sample and a column for
        each place, and before them lines such as ``# fs: 25e6`` or ``# speeds: 1480, 5900``.
    names : mapping, optional
        Name in the file of each field of `NAMES`.
    **values
        Fields of `NAMES` that the file lacks, or that replace those of the file, in SI units.

    Raises
    ------
    RecordError
        If the file is of another kind, or has no scan.
    ParameterError
        If a name is not of a field, or is not in the file.
    """
    place = Path(path)
    found, ordered = _content(place)
    fields = _fields(found, dict(names or {}), place) | values
    if "traces" not in fields:
        raise RecordError(
            f"{place} has no A-scans, but {', '.join(sorted(found)) or 'nothing'}; name them with "
            "--field traces=NAME"
        )
    if any(key.lower().startswith("phistep") for key in found):
        raise RecordError(f"{place} is a scan of a cylinder; give one of a plane")
    called = next((key for key, value in found.items() if value is fields["traces"]), "")
    try:
        return _scan(fields, time_first=ordered or called.lower() in _TIME_FIRST)
    except RecordError as error:
        raise RecordError(f"{place}: {error}") from None


def _scan(fields: Mapping[str, Any], *, time_first: bool) -> RecordedScan:
    """Return the scan of known fields."""
    traces = np.asarray(fields["traces"])
    if traces.dtype.kind not in "iuf" or not 1 <= traces.ndim <= 3 or not traces.size:
        raise RecordError(
            f"A-scans have the shape {traces.shape} of {traces.dtype}; give samples by places"
        )
    traces = np.atleast_2d(traces.T).T.astype(np.float64)
    if traces.ndim == 2 and 1 in traces.shape:
        traces = traces.reshape(-1, 1)
    times = _vector(fields, "times")
    if not time_first and (times.size < 2 or traces.shape[0] != times.size):
        wanted = times.size if times.size in traces.shape else max(traces.shape)
        traces = np.moveaxis(traces, traces.shape.index(wanted), 0)
    traces = traces.reshape(*traces.shape[:2], -1)
    rate = _number(fields, "rate")
    interval = _number(fields, "interval", 1 / rate if rate > 0 else math.nan)
    start = _number(fields, "start")
    if times.size == len(traces) > 1:
        interval, start = float(times[-1] - times[0]) / (times.size - 1), float(times[0])
    steps = tuple(_step(fields, axis) for axis in "xy")
    band = _number(fields, "low"), _number(fields, "high")
    middle = _number(fields, "frequency")
    if not all(np.isfinite(band)) and middle > 0:
        band = (1 - _ROUND) * middle, (1 + _ROUND) * middle
    return RecordedScan(
        traces,
        interval,
        start if math.isfinite(start) else 0.0,
        (steps[0], steps[1] if traces.shape[2] > 1 else math.nan),
        tuple(_vector(fields, "speeds").tolist()),
        tuple(_vector(fields, "thicknesses").tolist()),
        band,
        _number(fields, "disc"),
        _number(fields, "gain"),
        start_known=math.isfinite(start),
    )


def _vector(fields: Mapping[str, Any], name: str) -> FloatArray:
    return np.asarray(fields.get(name, ()), dtype=np.float64).ravel()


def _number(fields: Mapping[str, Any], name: str, default: float = math.nan) -> float:
    values = _vector(fields, name)
    return float(values[0]) if values.size else default


def _step(fields: Mapping[str, Any], axis: str) -> float:
    """Return the step along an axis, by itself or by the places."""
    places = _vector(fields, axis)
    if f"{axis}_step" in fields or places.size < 2:
        return _number(fields, f"{axis}_step", float(places[0]) if places.size else math.nan)
    steps = np.diff(np.unique(places))
    if np.ptp(steps) > _UNEVEN * steps.mean():
        raise RecordError(
            f"steps along {axis} are {1e3 * steps.min():.3g} to {1e3 * steps.max():.3g} mm; give a "
            "scan with equal ones"
        )
    return float(steps.mean())


def _fields(found: Mapping[str, Any], names: dict[str, str], place: Path) -> dict[str, Any]:
    """Return the fields of `NAMES` in a file."""
    for name, called in names.items():
        if name not in NAMES or called not in found:
            raise ParameterError(
                f"--field {name}={called}: fields are {', '.join(NAMES)}, and {place} has "
                f"{', '.join(sorted(found))}"
            )
    plain = {key.lower().replace("_", ""): key for key in reversed(list(found))}
    known = {}
    for name, usual in NAMES.items():
        called = names.get(name) or next((plain[n] for n in usual.split() if n in plain), "")
        if called and np.asarray(found[called]).dtype.kind in "iufb":
            known[name] = found[called]
    if np.ndim(known.get("traces", 0)) < 2 and "traces" not in names:
        known.pop("traces", None)
        arrays = [value for value in found.values() if np.ndim(value) in (2, 3)]
        large = max(arrays, key=np.size, default=np.empty(0))
        if np.size(large) > 100 and np.asarray(large).dtype.kind in "iuf":
            known["traces"] = large
    return known


def _content(place: Path) -> tuple[dict[str, Any], bool]:
    """Return the arrays of a file by their names, and whether time is their first axis."""
    try:
        with place.open("rb") as file:
            begin = file.read(1024)
        if begin.startswith(b"\x89HDF") or begin[512:516] == b"\x89HDF":
            return _hdf(place, matlab=begin.startswith(b"MATLAB"))
        if begin.startswith(b"MATLAB"):
            from scipy.io import loadmat

            content = loadmat(place, squeeze_me=False)
            return {k: v for k, v in content.items() if not k.startswith("__")}, False
        if begin.startswith(b"PK"):
            with np.load(place, allow_pickle=False) as archive:
                return dict(archive), False
        return _text(place), True
    except OSError as error:
        raise RecordError(f"{place} cannot be read: {error.strerror or error}") from None
    except (ValueError, LookupError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise RecordError(
            f"{place} is no scan ({str(error).splitlines()[0] if str(error) else 'damaged'}); give "
            "a MATLAB, HDF5, NDE, NPZ or CSV file"
        ) from None


def _text(place: Path) -> dict[str, Any]:
    """Read a CSV file: lines ``# name: value, ...``, then a row for each sample."""
    found: dict[str, Any] = {}
    lines = place.read_text(encoding="utf-8").splitlines()
    for line in lines:
        name, colon, numbers = line.lstrip("# ").partition(":")
        if line.startswith("#") and colon:
            found[name.strip()] = np.array([float(x) for x in numbers.split(",") if x.strip()])
    rows = [line for line in lines if line.strip() and not line.startswith("#")]
    if not rows:
        raise ValueError("it has no samples")
    return {**found, "traces": _table(rows)}


def _table(rows: Iterable[str]) -> FloatArray:
    return np.loadtxt(rows, delimiter=",", ndmin=2)


def _hdf(place: Path, *, matlab: bool) -> tuple[dict[str, Any], bool]:
    """Read the arrays and attributes of an HDF5 file, which MATLAB writes with axes reversed."""
    import h5py

    found: dict[str, Any] = {}
    with h5py.File(place, "r") as file:
        if "Public/Setup" in file:
            return _nde(file, json.loads(file["Public/Setup"][()])), True

        def visit(name: str, item: Any) -> None:
            found.update({key: np.asarray(value) for key, value in item.attrs.items()})
            if isinstance(item, h5py.Dataset):
                found[name.rpartition("/")[2]] = np.asarray(item).T if matlab else np.asarray(item)

        visit("", file)
        file.visititems(visit)
    return found, False


def _nde(file: Any, setup: Mapping[str, Any]) -> dict[str, Any]:
    """Read the first A-scans of an NDE file, version 4: its ``Setup`` describes the axes."""
    for group in setup["groups"]:
        for data in group.get("datasets", ()):
            if data.get("dataClass") != "AScanAmplitude":
                continue
            axes = {axis["axis"]: axis for axis in data["dimensions"]}
            if not set(axes) <= {"UCoordinate", "VCoordinate", "Ultrasound"}:
                raise ValueError(f"its A-scans have the axes {', '.join(axes)}, of an array")
            order = [list(axes).index(a) for a in ("Ultrasound", "UCoordinate", "VCoordinate")
                     if a in axes]  # fmt: skip
            time = axes["Ultrasound"]
            found = {"traces": np.transpose(np.asarray(file[data["path"]]), order)}
            found |= {"dt": time["resolution"], "t0": time.get("offset", 0.0)}
            for name, axis in (("dx", "UCoordinate"), ("dy", "VCoordinate")):
                if axis in axes:
                    found[name] = axes[axis]["resolution"]
            for shape in [v for one in setup.get("specimens", ())[:1] for v in one.values()]:
                if isinstance(shape, Mapping) and "material" in shape:
                    wave = shape["material"].get("longitudinalWave", {})
                    found["speeds"] = np.array([wave["nominalVelocity"]])
            return found
    raise ValueError("it has no A-scans")

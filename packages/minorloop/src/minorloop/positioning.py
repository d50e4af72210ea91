"""Positioning without a sensor: the experiment of Chen, Tan and Shahinpoor (2005), on the twin.

The settled curvature of an ionic polymer strip is measured along a decaying staircase of voltages.
A Preisach model and a single-valued quadratic are fitted to the same points. Both are inverted for
the same target curvatures, and the two voltage sequences are applied to the strip.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from minorloop import modelfile
from minorloop.arrays import FloatArray, uniform_levels
from minorloop.connect import connect
from minorloop.errors import NotInvertibleError, ParameterError, RecordError
from minorloop.files import check_writable, table_text, write_atomically
from minorloop.identification import Identification, Plane, Smooth, excitation, identify
from minorloop.identification.bands import BAND, Prediction
from minorloop.lab.actuator import Actuator
from minorloop.lab.conversion import LaserCurvature
from minorloop.lab.records import Record
from minorloop.lab.reduction import reduce
from minorloop.lab.settled_holds import FURTHER, hold_each
from minorloop.lab.wrapped_actuator import SingleChannel
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.preisach import Diagonal
from minorloop.twins.ipmc_laser import DISTANCE, HEIGHT, HEIGHT_SD


@dataclass(frozen=True)
class ExperimentProtocol:
    """Parameters of the experiment."""

    voltage: float = 1.2
    """Largest voltage, in V; the staircase runs over plus and minus this."""
    bands: int = 10
    """Number of steps of the staircase and of bands of the model."""
    hold: float = 200.0
    """Duration of a hold, in seconds; the curvature is measured at its end."""
    saturation_hold: float = 400.0
    """Duration of the saturation before the targets, in seconds."""
    targets: int = 14
    """Number of target curvatures."""
    reach: float = 7.5
    """The targets are uniform between minus and plus this, in 1/m."""
    sample_interval: float = 1.0
    """Time between samples, in seconds."""
    diagonal: Diagonal = "reversible"
    """Content of the cells on the diagonal, as in `identify`: ``uniform`` is the model of the
    paper; with ``reversible``, part of the bending follows the smallest reversal, as in a strip."""
    laser: bool = False
    """Whether the strip is measured with a laser and its raw log reduced, as in the paper.
    Otherwise a sensor measures the curvature."""


@dataclass(frozen=True, eq=False)
class AppliedSequence:
    """A voltage sequence applied to the strip.

    ``voltages`` (n,) in V; ``achieved`` (n,) settled curvatures in 1/m; ``errors`` (n,) achieved
    minus target; ``record`` with every sample.
    """

    voltages: FloatArray
    achieved: FloatArray
    errors: FloatArray
    record: Record

    @property
    def rms(self) -> float:
        """Root-mean-square error, in 1/m."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def worst(self) -> float:
        """Largest error, in 1/m."""
        return float(np.max(np.abs(self.errors)))


@dataclass(frozen=True, eq=False)
class Positioning:
    """Results of the experiment.

    ``staircase`` is the record of the identification; ``settled`` (n,) are its curvatures at
    ``voltages`` (n,); ``preisach`` and ``quadratic`` are the sequences of the two inverses.
    """

    protocol: ExperimentProtocol
    seed: int
    noise: float
    staircase: Record
    voltages: FloatArray
    settled: FloatArray
    identification: Identification
    polynomial: Polynomial
    targets: FloatArray
    preisach: AppliedSequence
    quadratic: AppliedSequence

    @cached_property
    def bands(self) -> Prediction:
        """90 % bands of the curvatures for the voltages of the Preisach inverse.

        Their width is the error of the model in the run of the quadratic inverse, to which it was
        not fitted. A staircase shows neither the error between its levels nor, as it closes no
        loop, what the strip remembers of closed loops but an operator forgets.
        """
        model, low = self.identification.model, -self.protocol.voltage
        other, y = (
            model.simulate(np.append(low, drive.voltages))[1:]
            for drive in (self.quadratic, self.preisach)
        )
        off = float(np.sqrt(np.mean((self.quadratic.achieved - other) ** 2)))
        return Prediction(self.preisach.voltages, y, np.full(y.size, off), BAND)

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """A row of a table for each target: target, and voltage and curvature of both inverses."""
        one, other = self.preisach, self.quadratic
        columns = one.voltages, one.achieved, other.voltages, other.achieved
        return [
            (f"{target:.2f}", f"{a:.3f}", f"{ya:.2f}", f"{b:.3f}", f"{yb:.2f}")
            for target, a, ya, b, yb in zip(self.targets, *columns, strict=True)
        ]

    def save(self, folder: Path) -> None:
        """Write the staircase and the model into a folder.

        Raises an `OutputError` if that fails.
        """
        data = folder / "staircase.csv"
        table = {"voltage [V]": self.voltages, "curvature [1/m]": self.settled}
        rows = zip(*(values.tolist() for values in table.values()), strict=True)
        write_atomically(check_writable(data, force=False), table_text(table, rows))
        modelfile.save(
            self.identification.model,
            folder / "model.json",
            input=self.staircase.input,
            output=self.staircase.output,
            provenance=modelfile.Provenance.of(data),
        )

    @property
    def coverage(self) -> float:
        """Share of the targets at which the curvature is within its band."""
        return self.bands.covers(self.preisach.achieved)

    @property
    def summary(self) -> dict[str, Any]:
        """The figures of merit, in 1/m, by the names under which they are printed."""
        return {
            "rms_preisach": self.preisach.rms,
            "rms_quadratic": self.quadratic.rms,
            "rms_ratio": self.quadratic.rms / self.preisach.rms,
            "max_preisach": self.preisach.worst,
            "max_quadratic": self.quadratic.worst,
            "seed": self.seed,
            "noise": self.noise,
            "measurements": int(self.settled.size),
            "unknowns": self.identification.unknowns,
            "quadratic": list(self.polynomial.coefficients),
            "protocol": asdict(self.protocol),
        }


def run_positioning(
    seed: int = 0,
    noise: float = 0.0,
    protocol: ExperimentProtocol | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> Positioning:
    """Run the experiment on one specimen of the twin.

    Raises a `ParameterError` if the seed is not a whole number of at least 0, or the noise is
    negative or too large for a fit.

    ``seed``: seed of the specimen, its noise, and the targets; ``noise``: standard deviation of the
    sensor: in 1/m, with a laser in mm; ``protocol``: parameters of the paper if not given;
    ``progress``: called with the name of each stage when it begins.
    """
    if isinstance(seed, bool) or int(seed) != seed or seed < 0:
        raise ParameterError(f"seed is {seed!r}; give a whole number of at least 0")
    setup = protocol or ExperimentProtocol()
    if not 0 <= noise <= setup.reach:
        raise ParameterError(
            f"noise is {noise} {_unit(setup)}; give 0 to {setup.reach:g}, the largest target"
        )
    grid = uniform_levels(-setup.voltage, setup.voltage, setup.bands)
    voltages = excitation.decaying_staircase(grid)

    progress("measuring the decaying staircase")
    staircase, settled = _staircase(seed, noise, setup, voltages)

    progress("identifying")
    law = Plane(grid, diagonal=setup.diagonal, slope=False, lag=0)
    identification = identify(voltages, settled, law, prior=Smooth(0.0))
    polynomial = Polynomial.fit(voltages, settled, degree=2, low=-setup.voltage, high=setup.voltage)

    targets = np.random.default_rng(seed).uniform(-setup.reach, setup.reach, setup.targets)
    inverses = {
        "Preisach": identification.model.invert(targets, unreachable="clip").u,
        "quadratic": _inverted(polynomial, targets, f"{noise} {_unit(setup)}"),
    }
    drives = {}
    for experiment, (name, inputs) in enumerate(inverses.items(), start=1):
        progress(f"driving with the {name} inverse")
        drives[name] = drive(seed, noise, setup, inputs, targets, experiment)
    return Positioning(
        protocol=setup,
        seed=seed,
        noise=noise,
        staircase=staircase,
        voltages=voltages,
        settled=settled,
        identification=identification,
        polynomial=polynomial,
        targets=targets,
        preisach=drives["Preisach"],
        quadratic=drives["quadratic"],
    )


def _unit(setup: ExperimentProtocol) -> str:
    return "mm" if setup.laser else "1/m"


def _staircase(
    seed: int, noise: float, setup: ExperimentProtocol, voltages: FloatArray
) -> tuple[Record, FloatArray]:
    """Measure the staircase; return the record and the settled curvature at each voltage.

    The record of a laser is reduced like any raw log, by finding its holds.
    """
    strip = _strip(seed, noise, setup)
    if not setup.laser:
        return hold_each(strip, voltages, setup.hold, setup.sample_interval)
    holds = [strip.apply(float(u), setup.hold, setup.sample_interval) for u in voltages]
    reduction = reduce(Record.joined(holds), conversion=_laser())
    found = reduction.record(unsettled=True)
    if found.u.size != voltages.size:
        raise RecordError(f"{found.u.size} holds were found in a log of {voltages.size}")
    return reduction.log, found.y


def _laser() -> LaserCurvature:
    return LaserCurvature(DISTANCE, HEIGHT, sd_h0=HEIGHT_SD, unit="mm")


def _inverted(polynomial: Polynomial, targets: FloatArray, noise: str) -> FloatArray:
    """Return the inputs of the single-valued model, which noise can make non-invertible."""
    try:
        return polynomial.invert(targets, unreachable="clip").u
    except NotInvertibleError:
        raise ParameterError(
            f"noise is {noise}, which makes the quadratic non-monotone within the voltages; "
            "give less"
        ) from None


def _strip(seed: int, noise: float, setup: ExperimentProtocol, experiment: int = 0) -> Actuator:
    """Return a specimen; every experiment has different noise."""
    address = "twin:ipmc-laser" if setup.laser else "twin:ipmc"
    return connect(address, specimen=seed, noise=noise, seed=seed + FURTHER * experiment)


def drive(
    seed: int,
    noise: float,
    setup: ExperimentProtocol,
    inputs: FloatArray,
    targets: FloatArray,
    experiment: int = 1,
) -> AppliedSequence:
    """Saturate a specimen, apply inputs (n,) in V, and compare with the targets (n,) in 1/m."""
    strip = _strip(seed, noise, setup, experiment)
    if setup.laser:
        strip = SingleChannel(strip, conversion=_laser())
    strip.apply(-setup.voltage, setup.saturation_hold, setup.sample_interval)
    voltages = np.clip(inputs, -setup.voltage, setup.voltage)
    record, achieved = hold_each(strip, voltages, setup.hold, setup.sample_interval)
    strip.safe()
    return AppliedSequence(voltages, achieved, achieved - targets, record)

"""One record gives one model, whoever reads it."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.signal import lfilter

import minorloop as ml
from benchmarks import one_model
from minorloop import ParameterError, Record, RecordError, SignalError, modelfile
from minorloop.fleet._fitting import Task, identify_one
from minorloop.fleet.manifest import Specimen

pytestmark = pytest.mark.usefixtures("without_pictures")


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """Ten records, each with something of its own, by what that is."""
    folder = tmp_path_factory.mktemp("records")
    return {table.what: table for table in one_model.own_records(folder, 1000)}


def _by_fleet(table, folder):
    """As a worker does, without its process."""
    one = Specimen("one", table.file, **table.columns)
    options = {"holdout": one_model.HOLDOUT, **table.options}
    _, content = identify_one(Task(one, one.read(), options), folder / "scratch")
    (folder / "fleet.json").write_bytes(content)
    return modelfile.read(folder / "fleet.json")


ALIKE = ("late", "uneven", "gap", "even", "uneven and late", "groups", "empty cells")
"""Records like others here: with the whole tests."""


@pytest.mark.parametrize(
    "what",
    [
        pytest.param(what, marks=pytest.mark.whole) if what in ALIKE else what
        for what in one_model.MADE
    ],
)
def test_command_line_python_page_and_fleet_find_the_same_model(what, tables, tmp_path):
    table = replace(tables[what], options={"levels": 8})
    known, _ = one_model.by_command(table, tmp_path)
    python, _ = one_model.by_python(table, tmp_path)
    page, _ = one_model.by_page(table, tmp_path)
    for other in (python, page, _by_fleet(table, tmp_path)):
        assert other.model == known.model
        assert (other.lag, other.lag_seconds) == (known.lag, known.lag_seconds)
        assert other.warnings == known.warnings
        assert msgspec.to_builtins(other.bands) == msgspec.to_builtins(known.bands)


def test_arrays_are_identified_as_their_file_is(tables, tmp_path):
    table = tables["even"]
    known, _ = one_model.by_command(table, tmp_path)
    u, y = np.loadtxt(table.file, delimiter=",", skiprows=1).T
    found = ml.identify(u, y, holdout=one_model.HOLDOUT)
    assert found.model == known.model
    read = ml.identify(ml.read(table.file, **table.columns), holdout=one_model.HOLDOUT)
    assert found.advice == read.advice
    assert found.chosen == read.chosen


def test_a_record_of_arrays_has_its_times_checked():
    t = np.delete(0.01 * np.arange(400), slice(100, 200))
    u = np.sin(7 * t)
    found = ml.identify(Record(u, u + 0.1 * u**2, t), ml.Plane(4, lag=0))
    assert any("1 gap in column 'time [s]'" in said for said in found.advice)
    assert found.samples < 300


def uneven(late=0.0):
    """A record of which rows are 5 to 15 ms apart."""
    t = np.cumsum(np.random.default_rng(1000).uniform(0.005, 0.015, 900))
    u = np.exp(-t / 8) * np.sin(4 * t)
    model = ml.Preisach(np.linspace(-1, 1, 7), np.tril(np.ones((6, 6))))
    return Record(u, model.simulate(np.interp(t - late, t, u)), t)


def test_uneven_samples_are_named_where_a_lag_in_rows_needs_even_ones():
    for lag in (0, 3):
        law = ml.Plane(6, lag=lag, diagonal="uniform", slope=False)
        advice = " ".join(ml.identify(uneven(), law).advice)
        assert ("samples are uneven" in advice) == (lag > 0)


def test_a_lag_in_seconds_needs_no_even_samples():
    prompt, late = (ml.identify(uneven(0.025), ml.Plane(6, lag=lag)) for lag in ("0 s", "25 ms"))
    assert late.nrmse < 0.65 * prompt.nrmse


def test_with_dynamics_the_advice_on_lost_rows_can_be_followed():
    t = 0.01 * np.delete(np.arange(900), slice(150, 450))
    u = np.exp(-t / 8) * np.sin(4 * t)
    law = ml.Dynamics(ml.Plane(4, diagonal="uniform"), first="operator", poles=1, creep=False)
    said = ml.identify(Record(u, u + 0.1 * u**2, t), law).warnings[0]
    assert "--record rows=A:B" in said
    assert "--time" not in said
    assert "--curves" not in said


def test_a_raw_log_is_not_to_be_trusted():
    u = np.repeat(np.random.default_rng(1000).uniform(-1, 1, 12), 60)
    y = lfilter([1 / 12], [1, -11 / 12], u)
    said = ml.identify(u, y, ml.Plane(6, lag=0)).warnings[0]
    assert "this looks like a raw log: 720 samples with 12 holds of about 60" in said


def test_what_cannot_be_is_refused(tables):
    record = ml.read(tables["even"].file, **tables["even"].columns)
    y = record.y
    for law in (y, ml.Plane, "thermal", ml.Gaussian()):
        with pytest.raises(ParameterError, match=r"the law is .*; give Plane"):
            ml.identify(record, law)
    for prior in ("gaus", None, ml.Gaussian):
        with pytest.raises(ParameterError, match=r"prior is .*; give"):
            ml.identify(record, prior=prior)
    with pytest.raises(ParameterError, match="plane is 'foo'; give a Plane"):
        ml.identify(record.replace(t=0.1 * record.t, time=None), ml.Dynamics("foo"))
    with pytest.raises(ParameterError, match="rows -5 to None are given"):
        record.replace(first=-5)
    with pytest.raises(ParameterError, match="the record has no time"):
        ml.identify(record, ml.Plane(lag="3 ms"))
    with pytest.raises(ParameterError, match="y is missing; give the outputs, or a record"):
        ml.identify(y)
    with pytest.raises(ParameterError, match="dynamics need times"):
        ml.identify(record, ml.Dynamics())
    with pytest.raises(ParameterError, match="creep and rate need times"):
        ml.identify(record, ml.Viscosity())
    back = ml.read(tables["clock set back"].file, **tables["clock set back"].columns)
    with pytest.raises(RecordError, match="set back after sample 199"):
        ml.identify(back, ml.Viscosity())
    with pytest.raises(SignalError, match="the input is 1 throughout"):
        ml.identify(Record(np.ones(9), np.arange(9.0), np.arange(9)))

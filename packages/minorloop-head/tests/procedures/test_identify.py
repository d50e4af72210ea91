from contextlib import contextmanager, nullcontext
from dataclasses import replace

import numpy as np
import pytest

from minorloop import InstrumentError, SignalError, StoreError, connect, run
from minorloop_head.procedures.identify import HeadExcitation, HeadMeasurement

QUICK = HeadExcitation(bands=2, hold=12.0)
SETUP = {"address": "twin:head", "specimen": 1000, "seed": 7, "options": {"noise": 0.05}}


class Stopped(Exception):
    pass


@contextmanager
def opened(seed):
    yield connect("twin:head", specimen=1000, noise=0.05, seed=seed)


def measurement(folder, stop_after=None, how=QUICK):
    """A measurement that stops after a number of points."""
    measured = []

    def watch(progress):
        if progress.point is not None:
            measured.append(progress.point)
        if len(measured) == stop_after:
            raise Stopped

    def carry_out(plant, store):
        return run(plant, store.plan, store, watch=watch)

    return HeadMeasurement(folder, SETUP, how, opened, carry_out)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def found(folder):
    """A head identified in one go."""
    return measurement(folder).identified()


def test_wires_and_coupling_are_those_of_the_head(found):
    for wire in found.wires:
        assert wire.operator.bands == 2
        assert 3.0 < wire.lag < 4.5
        assert wire.operator.range[1] == pytest.approx(58.0, abs=12.0)
    assert found.coupling[0, 1] == pytest.approx(0.05, abs=0.03)
    assert found.coupling[1, 0] == pytest.approx(0.05, abs=0.03)


def test_the_check_is_on_inputs_that_were_not_fitted(found):
    for axis in found.check:
        assert 0.5 < axis.rms < 12.0  # two bands are rough, but no fit to their own data
        assert axis.largest >= axis.rms


def test_a_stopped_identification_continues_to_the_same_head(found, tmp_path):
    for points in (3, 9, 17):
        with pytest.raises(Stopped):
            measurement(tmp_path, stop_after=points).identified()
    again = measurement(tmp_path).identified()
    for one, other in zip(found.wires, again.wires, strict=True):
        np.testing.assert_array_equal(one.operator.weights, other.operator.weights)
        assert (one.lag, one.latent) == (other.lag, other.latent)
    np.testing.assert_array_equal(found.coupling, again.coupling)
    assert found.check == again.check


def test_a_finished_identification_needs_no_head(found, folder):
    def absent(seed):
        raise AssertionError("it was connected")

    again = replace(measurement(folder), connect=absent).identified()
    assert (again.check, again.on) == (found.check, found.on)


@pytest.mark.parametrize(
    ("how", "error", "says"),
    [
        ({"hold": 2.0}, InstrumentError, "in every reading of holds 1 to 3, .* or hold longer"),
        (
            {"hold": 12.0, "highest": 0.05},
            SignalError,
            r"pan moves by 0 degrees in its first step .* longer",
        ),
    ],
)
def test_a_wire_that_does_not_move_is_named_in_its_first_run(tmp_path, how, error, says):
    quiet = replace(
        measurement(tmp_path, how=replace(QUICK, **how)),
        connect=lambda seed: nullcontext(connect("twin:head", specimen=1000, noise=0.0)),
    )
    with pytest.raises(error, match=says):
        quiet.identified()
    assert [path.name for path in tmp_path.iterdir()] == ["pan-loop.sqlite"]


def test_a_folder_of_another_specimen_is_refused_before_the_head_is_opened(found, folder):
    other = replace(measurement(folder), setup={**SETUP, "specimen": 1001})
    with pytest.raises(StoreError, match="specimen"):
        other.left()
    with pytest.raises(StoreError, match="belongs to another run"):
        measurement(folder, how=HeadExcitation(bands=2, hold=12.0, highest=0.3)).left()
    assert measurement(folder).left() == {}

from pathlib import Path

import numpy as np
import pytest

from minorloop import (
    Apparatus,
    ParameterError,
    Preisach,
    Store,
    StoreError,
    drive_to,
    measure,
    modelfile,
    resume,
)
from minorloop.measurement import Approach, HoldEnds, _doubts

STRIP = Apparatus("twin:ipmc,specimen=1001,noise=0.02,seed=4")


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_plan_is_measured_and_kept():
    Path("plan.csv").write_text("voltage [V],hold [s]\n-1,40\n1,40\n0,40\n")
    found = measure(STRIP, "plan.csv", "a.sqlite", HoldEnds(shortest=20.0))
    assert (found.figures["points"], found.mode, found.drive) == (3, "fresh", None)
    with Store.open("a.sqlite") as store:
        assert store.setup.options == {"noise": 0.02}
        assert (store.setup.specimen, store.setup.seed) == (1001, 4)
        assert store.plan.shortest.tolist() == [20.0] * 3
    assert resume("a.sqlite").mode == "finished"
    with pytest.raises(StoreError, match="continue it with minorloop resume"):
        measure(STRIP, "plan.csv", "a.sqlite")


def test_an_actuator_is_driven_and_its_sensor_converted():
    plane = Preisach(np.linspace(-1.2, 1.2, 5), np.tril(np.full((4, 4), 900.0)))
    modelfile.save(plane, "m.json", input="voltage [V]", output="curvature [1/km]")
    said, apparatus = [], Apparatus(STRIP.address, conversion="linear:1000,unit=1/km")
    approach = Approach(corrections=2, within=500.0, hold=30.0)
    model = modelfile.read("m.json")
    found = drive_to(model, [2000.0], apparatus, "d.sqlite", approach, say=said.append)
    assert found.drive.missed == []
    assert len(found.to_dict()["targets"]) == 1
    assert found.figures["output"] == "curvature [1/km]"
    assert resume("d.sqlite").drive == found.drive
    with pytest.raises(ParameterError, match="identify a model in um, or convert the readings"):
        drive_to(model, [0.0], Apparatus("twin:fibre"), "e.sqlite")


def test_warns_of_points_that_did_not_settle():
    known = {"points": 4, "sample_interval_s": 1.0, "longest_interval_s": None}
    (said,) = _doubts(known | {"unsettled": 2})
    assert "2 of 4 points had not settled" in said
    assert not [*_doubts(known | {"unsettled": 1})]

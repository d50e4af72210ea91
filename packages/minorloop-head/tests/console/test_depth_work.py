import math
import pickle
from itertools import count

import numpy as np
import pytest

from console_rig import PIT, request, tip, view
from minorloop_head.console import depth_work
from minorloop_head.console.perception import Perception
from minorloop_head.console.scan_echoes import ScanEchoes
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.sweep import ProbeSweep
from minorloop_head.twins.surroundings import Sway
from minorloop_head.ultrasound.pits import PITCH


def fitted():
    """Reports of the fit of a raster over the pit, with the joints exactly at its targets.

    The base sways by a degree once there is a picture of it at rest.
    """
    probe, known = tip()
    probe.flood(True)
    probe.expose(0.01, 4.0)
    echoes, scan = ScanEchoes(known, 1, PIT[:2], PIT[2]), RasterScan(calibration=known)
    step = PITCH / known.radius
    advance, roll = scan.rolled(PIT[0] - 2.5 * step, (PIT[1], 0.0)).tolist()
    targets = scan.targets(PIT[:2], (advance, roll))
    for k, wanted in enumerate([targets[0], *targets]):
        t, row = 0.5 * k, max(k - 1, 0) // scan.points
        here = (*wanted.tolist(), advance, roll + row * step)
        turned = wanted + (Sway().at(t) if k else 0.0)
        probe.move_to(request((*turned.tolist(), *here[2:])).stance)
        echoes.read(t, here)
        if k:
            echoes.fire(probe, t, here, tuple(wanted.tolist()))
            assert echoes.arrived(t) is None
        echoes.see(probe.frame().image, t)
        if k:
            assert not echoes.arrived(t)
    return list(depth_work.depth(**echoes.job()))


def test_the_echoes_of_a_scan_give_depth_map_and_mesh():
    *stages, last = fitted()
    assert len(stages) == 2
    result = last["result"]
    assert result["verdict"] == "measured"
    assert result["depth"] == pytest.approx(PIT[3], abs=4 * result["depth_sd"])
    grid = np.array(result["patch"]["depth"], dtype=float)
    assert np.nanmax(grid) == pytest.approx(1e3 * PIT[3], abs=0.05)
    assert abs(np.nanmedian(grid)) < 0.02
    assert last["meshes"]["ply"].startswith(b"ply")
    assert last["meshes"]["glb"].startswith(b"glTF")


@pytest.mark.whole
def test_the_bursts_of_a_sweep_give_a_map_with_the_pit():
    """Lines over the pit, by the commands of a sweep."""
    camera, sweep = Perception(tip()[0], view()), ProbeSweep(calibration=view())
    z = PIT[1] - 1.1e-3, PIT[1] + 1.1e-3
    phi, (pan, tilt) = (PIT[0] - 0.14, PIT[0] + 0.14), sweep.point.perpendicular
    numbers = count(1, 5)  # of ticks for which no picture is drawn
    reports = [camera.tick(request((pan, tilt, z[0], 0.0), ("fire_on", []), number=1))]
    assert reports[0].events == [{"what": "unscanned", "text": "the camera was started anew"}]
    camera.tick(request((pan, tilt, z[0], 0.0), ("begin_sweep", [*phi, *z]), number=1))
    for advance in np.arange(*z, sweep.pitch):
        for angle in np.arange(*phi, sweep.pitch / view().radius):
            roll = float(sweep.point.rolled(angle, (advance, 0.0))[1])
            here = pan, tilt, float(advance), roll
            camera.tick(request(here, number=next(numbers)))
            camera.tick(request(here, ("fire_on", []), number=next(numbers)))
    camera.tick(request(here, ("end_sweep", [0.0]), number=next(numbers)))
    (job,) = camera.jobs
    *stages, last = depth_work.sweep(**pickle.loads(pickle.dumps(job)))
    assert stages == [{"stage": "mapping the wall"}]
    (find,) = (one for one in last["finds"] if one["kind"] == "pit")
    assert find["phi"] == pytest.approx(PIT[0], abs=0.03)
    assert find["z"] == pytest.approx(PIT[1], abs=0.3e-3)
    assert find["depth"] == pytest.approx(PIT[3], abs=0.03e-3)
    assert last["mapped"] > 0.9
    assert last["whole"] is False
    assert last["files"]["png"].startswith(b"\x89PNG")
    header, *rows = last["files"]["csv"].decode().splitlines()
    assert header == "phi [deg],z [mm],amplitude [1],depth [mm],depth_sd [mm]"
    deepest = max(rows, key=lambda row: float(row.split(",")[3] or 0.0)).split(",")
    assert float(deepest[0]) == pytest.approx(math.degrees(PIT[0]), abs=3.0)
    # One burst has no surface: a map, and nothing in it.
    empty = list(depth_work.sweep(**{**job, "bursts": job["bursts"][:1]}))[-1]
    assert (empty["finds"], empty["mapped"] < 0.1) == ([], True)
    camera.tick(request(here, ("begin_sweep", [*phi, *z]), number=1))
    none = camera.tick(request(here, ("end_sweep", [0.0]), number=1))
    assert "the sweep has no bursts yet" in none.events[0]["text"]
    assert camera.jobs == [job]

import numpy as np
import pytest

from console_rig import PIT, request, tip
from minorloop_head.console import depth_work
from minorloop_head.console.scan_echoes import ScanEchoes
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.reconstruction.depth_map import Patch
from minorloop_head.reconstruction.fusion import fuse
from minorloop_head.twins.surroundings import Sway
from minorloop_head.ultrasound.pits import PitDepth


def fitted(flooded):
    """Reports of the fit of a raster over the pit, with the joints exactly at its targets.

    The base sways by a degree once there is a picture of it at rest.
    """
    probe, known = tip()
    probe.flood(flooded)
    probe.expose(0.01, 4.0)
    echoes, scan, sway = (
        ScanEchoes(known, 1, PIT[:2], PIT[2]),
        RasterScan(calibration=known),
        Sway(),
    )
    step = scan.pitch / known.radius
    advance, roll = scan.rolled(PIT[0] - 2.5 * step, (PIT[1], 0.0)).tolist()
    targets = scan.targets(PIT[:2], (advance, roll))
    for k, wanted in enumerate([targets[0], *targets]):
        t, row = 0.5 * k, max(k - 1, 0) // scan.points
        here = (*wanted.tolist(), advance, roll + row * step)
        turned = wanted + (sway.at(t) if k else 0.0)
        probe.move_to(request((*turned.tolist(), *here[2:])).stance)
        echoes.read(t, here)
        if k:
            echoes.fire(probe, t, here, tuple(wanted.tolist()))
            assert echoes.arrived(t) is None
        echoes.see(probe.frame().image, t)
        if k:
            assert not echoes.arrived(t) or not flooded
    return list(depth_work.depth(**echoes.job()))


def test_the_echoes_of_a_scan_give_depth_map_and_mesh():
    *stages, last = fitted(True)
    assert len(stages) == 2
    result = last["result"]
    assert result["verdict"] == "measured"
    assert result["depth"] == pytest.approx(PIT[3], abs=4 * result["depth_sd"])
    grid = np.array(result["patch"]["depth"], dtype=float)
    assert np.nanmax(grid) == pytest.approx(1e3 * PIT[3], abs=0.05)
    assert abs(np.nanmedian(grid)) < 0.02
    assert last["meshes"]["ply"].startswith(b"ply")
    assert last["meshes"]["glb"].startswith(b"glTF")


def test_no_depth_is_made_up_where_there_is_no_floor():
    patch = Patch.around(*PIT[:2], size=0.2e-3)
    pit = PitDepth("through-hole", *PIT[:2], diameter=PIT[2])
    shown = depth_work._result(pit, fuse(pit, None, patch))["patch"]
    assert len(shown["through"]) > 5
    assert all(shown["depth"][i][j] is None for i, j in shown["through"])
    known = [depth for row in shown["depth"] for depth in row if depth is not None]
    assert max(known, default=0.0) == 0.0


def test_a_dry_pipe_gives_no_depth_and_says_why():
    *_, last = fitted(False)
    assert last["result"]["depth"] is None
    assert last["result"]["verdict"] not in ("measured", "")

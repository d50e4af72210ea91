import pytest

from minorloop_head.console.reports import NO_ECHOES, camera_finding, with_depth

HOLE = {"phi": -0.1, "z": 0.03, "diameter": 1e-3, "evidence": 1.234}
FINDING = camera_finding(7, 2.0, HOLE, 10e-3)
RESULT = {
    "phi": 0.2, "z": 0.031, "diameter": 1.1e-3, "depth": 0.5e-3, "place_sd": 20e-6,
    "diameter_sd": 30e-6, "depth_sd": 4e-6, "verdict": "measured",
}  # fmt: skip


def test_a_finding_by_its_outline_is_in_degrees_and_millimetres():
    assert (FINDING.phi, FINDING.z, FINDING.diameter) == (354.27, 30.0, 1.0)
    assert (FINDING.kind, FINDING.verdict, FINDING.depth) == ("hole or pit", NO_ECHOES, None)
    assert FINDING.z_sd == pytest.approx(0.085)


def test_echoes_add_depth_place_and_size():
    found = with_depth(FINDING, RESULT, 10e-3)
    assert (found.kind, found.verdict) == ("pit", "measured")
    assert (found.depth, found.depth_sd, found.diameter, found.z) == (0.5, 0.004, 1.1, 31.0)
    assert found.phi_sd == pytest.approx(0.1146)

"""Every controller has the same runs by the camera alone, and its own figures."""

from types import SimpleNamespace

import pytest

from papers.catheter import head, head_camera
from papers.catheter.control.laws import LAWS
from papers.catheter.head_loop import constant, run_loop
from papers.claims import claim_table
from wires import identified_head

SEED = 1001


@pytest.fixture
def by_sensors(monkeypatch):
    """Loops of a second on sensors at the joints, in place of pictures."""
    ran = []

    def short(seed, law, control, target, camera, surroundings=None):
        ran.append((law, target, surroundings))
        return run_loop(
            law, control, constant(target), 1.0, specimen=seed, seed=seed, surroundings=surroundings
        )

    def identified(seed):
        wires, coupling = identified_head(seed)
        return SimpleNamespace(wires=wires, coupling=coupling, view=None)

    circled = lambda seed, control, circle, camera: SimpleNamespace(rms=circle.period)  # noqa: E731
    monkeypatch.setattr(head_camera, "identify_seen", identified)
    monkeypatch.setattr(head_camera, "run_step", short)
    monkeypatch.setattr(head_camera, "run_circle", circled)
    return ran


def test_all_controllers_with_readings_have_the_same_runs(by_sensors):
    found = head_camera.run_study(SEED)
    assert set(found["rivals"]) == set(LAWS) - {"feedforward"}
    of = [
        {(target, around) for law, target, around in by_sensors if law == each}
        for each in found["rivals"]
    ]
    assert all(each == of[0] for each in of)
    assert len(of[0]) == 3 + len(head.DISTURBED)
    own = [each["energy_A2s"] for each in found["rivals"].values()]
    assert 0.0 < min(own) < max(own)
    assert {each["circle_rms_mm"] for each in found["rivals"].values()} == {30.0}
    table = claim_table(head_camera.STUDY.claims, found)
    assert len(table.rows) == len(head_camera.STUDY.claims)

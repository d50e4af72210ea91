import numpy as np

from minorloop.identification import refinement


def test_refinement_that_runs_out_of_rounds_is_not_settled(monkeypatch):
    monkeypatch.setattr(refinement, "_ROUNDS", 1)
    monkeypatch.setattr(refinement, "_STEPS", 2)
    values = np.geomspace(1, 1e-3, 20)
    rows = refinement.Rows(lambda z: values * z, lambda r: values * r, np.ones(20))
    scaling = refinement.Preconditioner(np.arange(20), np.ones(20))
    z, settled = refinement.refine(rows, np.zeros(20), scaling)
    assert not settled
    monkeypatch.undo()
    z, settled = refinement.refine(rows, z, scaling)
    assert settled
    np.testing.assert_allclose(values * z, 1.0, atol=1e-12)

"""A Dask cluster in this process, whose scheduler and workers are lost."""

import pytest

import fleet_faults
from fleet_records import OPTIONS, write_fleet
from later import Later
from minorloop.errors import ParameterError
from minorloop.fleet import _cluster, _worker, identification
from minorloop.fleet.identification import identify_fleet

distributed = Later("distributed", reason="needs Dask: minorloop[fleet]")
pytestmark = pytest.mark.filterwarnings("ignore")  # what Dask warns of is not ours
LOCAL = {"processes": False, "protocol": "tcp://", "dashboard_address": None}


@pytest.fixture
def cluster(monkeypatch):
    """A cluster with a worker, which has a thread for what waits and one for others."""
    monkeypatch.setattr(identification, "identify_one", fleet_faults.work)
    with distributed.LocalCluster(n_workers=1, threads_per_worker=2, **LOCAL) as cluster:
        yield cluster


@pytest.fixture(autouse=True)
def _workers(monkeypatch):
    """Processes of the worker that end with the test."""
    workers = _worker.FitProcesses()
    monkeypatch.setattr(_cluster, "_workers", workers)
    yield
    workers.close()


def test_a_cluster_needs_no_shared_files_and_ends_what_hangs(cluster, tmp_path):
    specimens = write_fleet(tmp_path, ["a", "hang", "b"])
    summary = identify_fleet(
        specimens,
        tmp_path / "out",
        workers=cluster.scheduler_address,
        limit=5,
        **OPTIONS,
    )
    assert [one.specimen for one in summary.identified] == ["a", "b"]
    failed = {one.specimen: one.error for one in summary.failures}
    assert "no model within the limit of 5 s" in failed["hang"]


def test_refuses_addresses_without_a_scheduler(tmp_path):
    pytest.importorskip("distributed", reason="needs Dask: minorloop[fleet]")
    specimens = write_fleet(tmp_path, ["a"])
    with pytest.raises(ParameterError, match="no Dask scheduler at"):
        identify_fleet(specimens, tmp_path / "out", workers="tcp://127.0.0.1:1", **OPTIONS)
    for address in ("nonsense", "nonsense://x", "tcp://127.0.0.1"):
        with pytest.raises(ParameterError, match="give that of a Dask scheduler"):
            identify_fleet(specimens, tmp_path / "out", workers=address, **OPTIONS)
    assert not (tmp_path / "out").exists()

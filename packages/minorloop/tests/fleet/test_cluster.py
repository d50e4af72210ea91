"""A Dask cluster in this process, whose scheduler and workers are lost."""

import pytest

import fleet_faults
from fleet_records import OPTIONS, write_fleet
from later import Later
from minorloop.errors import FleetError, ParameterError
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


def on(cluster, work):
    """Call a function in the event loop of the scheduler and the workers."""
    cluster.loop.add_callback(work)


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


@pytest.mark.whole
@pytest.mark.parametrize("what", ["scheduler", "left"])
def test_results_are_kept_when_a_cluster_is_lost_and_the_rest_follows_later(
    what, cluster, tmp_path, monkeypatch
):
    async def leave():
        for worker in cluster.workers.values():
            await worker.close()

    async def hang_up():
        clients[0].status = "connecting"  # what it is when its connection was closed

    clients, connect = [], _cluster._connect
    monkeypatch.setattr(
        _cluster, "_connect", lambda address: clients.append(connect(address)) or clients[0]
    )
    faults = {"scheduler": hang_up, "left": leave}
    ends = {"scheduler": "the scheduler at tcp.* is gone", "left": "no worker at tcp.* within 2 s"}
    (tmp_path / "wait.closed").touch()
    specimens, seen = write_fleet(tmp_path, ["a", "b", "wait"]), []

    def watch(done, of, last):
        seen.append(last.specimen)
        if len(seen) == 2:
            on(cluster, faults[what])

    def go_on(**options):
        return identify_fleet(specimens, tmp_path / "out", watch=watch, **options, **OPTIONS)

    with pytest.raises(FleetError, match=ends[what] + ".*2 of 3 specimens are done and kept"):
        go_on(workers=cluster.scheduler_address, patience=2.0)
    (tmp_path / "wait.closed").unlink()
    assert len(go_on(workers=1).identified) == 3
    assert sorted(seen) == ["a", "b", "wait"]


@pytest.mark.whole
def test_a_specimen_whose_worker_leaves_is_given_to_another(cluster, tmp_path):
    (tmp_path / "wait.closed").touch()
    specimens = write_fleet(tmp_path, ["wait", "a", "b"])
    cluster.scale(2)
    with distributed.Client(cluster) as client:
        client.wait_for_workers(2)

    async def leave():
        busy = next(one for one in cluster.workers.values() if one.state.executing_count)
        await busy.close()
        (tmp_path / "wait.closed").unlink()

    def watch(done, of, last):
        if done == 2:
            on(cluster, leave)

    summary = identify_fleet(
        specimens, tmp_path / "out", workers=cluster.scheduler_address, watch=watch, **OPTIONS
    )
    assert len(summary.identified) == 3


def test_refuses_addresses_without_a_scheduler(tmp_path):
    pytest.importorskip("distributed", reason="needs Dask: minorloop[fleet]")
    specimens = write_fleet(tmp_path, ["a"])
    with pytest.raises(ParameterError, match="no Dask scheduler at"):
        identify_fleet(specimens, tmp_path / "out", workers="tcp://127.0.0.1:1", **OPTIONS)
    for address in ("nonsense", "nonsense://x", "tcp://127.0.0.1"):
        with pytest.raises(ParameterError, match="give that of a Dask scheduler"):
            identify_fleet(specimens, tmp_path / "out", workers=address, **OPTIONS)
    assert not (tmp_path / "out").exists()

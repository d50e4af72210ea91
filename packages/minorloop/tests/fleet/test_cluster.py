"""A Dask cluster in this process, whose scheduler and workers are lost."""

import asyncio
import threading

import pytest

import fleet_faults
from fleet_records import OPTIONS, write_fleet
from later import Later
from minorloop.errors import FleetError, ParameterError
from minorloop.fleet import _cluster, _worker, identification
from minorloop.fleet.identification import identify_fleet

distributed = Later("distributed", reason="needs Dask: minorloop[fleet]")
pytestmark = pytest.mark.filterwarnings("ignore")  # what Dask warns of is not ours
WHOLE = pytest.mark.whole
LOCAL = {"processes": False, "protocol": "tcp://", "dashboard_address": None}


@pytest.fixture
def cluster(monkeypatch):
    """A cluster with a worker, which has a thread for what waits and one for others."""
    monkeypatch.setattr(identification, "identify_one", fleet_faults.work)
    monkeypatch.setattr(_cluster, "SILENT", 1.5)
    monkeypatch.setattr(_worker, "NOTICE", 0.3)
    monkeypatch.setattr(_worker, "APART", 0.0)
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
    done = threading.Event()

    async def doing():
        await work()
        done.set()

    cluster.loop.add_callback(doing)
    return done


def two_workers(cluster):
    """Start a second worker."""
    cluster.scale(2)
    with distributed.Client(cluster) as client:
        client.wait_for_workers(2)


def test_a_cluster_needs_no_shared_files_and_ends_what_hangs(cluster, tmp_path):
    specimens, said = write_fleet(tmp_path, ["a", "hang", "b"]), []
    summary = identify_fleet(
        specimens,
        tmp_path / "out",
        workers=cluster.scheduler_address,
        limit=5,
        say=said.append,
        **OPTIONS,
    )
    assert [one.specimen for one in summary.identified] == ["a", "b"]
    failed = {one.specimen: one.error for one in summary.failures}
    assert "no model within the limit of 5 s" in failed["hang"]
    assert any("specimen hang has run for" in sentence for sentence in said)


@pytest.mark.parametrize(
    "what", ["scheduler", *(pytest.param(what, marks=WHOLE) for what in ("left", "silent"))]
)
def test_results_are_kept_when_a_cluster_is_lost_and_the_rest_follows_later(
    what, cluster, tmp_path, monkeypatch
):
    async def silence():
        for worker in cluster.workers.values():
            worker.periodic_callbacks["heartbeat"].stop()

    async def leave():
        for worker in cluster.workers.values():
            await worker.close()

    async def hang_up():
        clients[0].status = "connecting"  # what it is when its connection was closed

    clients, connect = [], _cluster._connect
    monkeypatch.setattr(
        _cluster, "_connect", lambda address: clients.append(connect(address)) or clients[0]
    )
    faults = {"scheduler": hang_up, "left": leave, "silent": silence}
    ends = {"scheduler": "the scheduler at tcp.* is gone: it closed the connection"}
    (tmp_path / "wait.closed").touch()
    specimens, seen, said = write_fleet(tmp_path, ["a", "b", "wait"]), [], []

    def watch(done, of, last):
        seen.append(last.specimen)
        if len(seen) == 2:
            on(cluster, faults[what])

    def go_on(**options):
        return identify_fleet(specimens, tmp_path / "out", watch=watch, **options, **OPTIONS)

    address = cluster.scheduler_address
    end = ends.get(what, "no worker at tcp.* answers within 5 s")
    with pytest.raises(FleetError, match=end + ".*2 of 3 specimens are done and kept"):
        go_on(workers=address, patience=5.0, say=said.append)
    waiting = f"no worker at {address} answers; waiting" in said
    assert waiting == (what != "scheduler")
    (tmp_path / "wait.closed").unlink()
    assert len(go_on(workers=1).identified) == 3
    assert sorted(seen) == ["a", "b", "wait"]


@WHOLE
def test_specimens_of_a_silent_worker_go_to_the_others(cluster, tmp_path):
    (tmp_path / "wait.closed").touch()
    specimens, said = write_fleet(tmp_path, ["wait", "a", "b"]), []
    two_workers(cluster)

    async def silence():
        worker = next(one for one in cluster.workers.values() if one.state.executing_count)
        worker.periodic_callbacks["heartbeat"].stop()

    def watch(done, of, last):
        if done == 2:
            on(cluster, silence)

    def say(sentence):
        said.append(sentence)
        if "has not answered" in sentence:
            (tmp_path / "wait.closed").unlink()

    summary = identify_fleet(
        specimens,
        tmp_path / "out",
        workers=cluster.scheduler_address,
        watch=watch,
        say=say,
        **OPTIONS,
    )
    assert len(summary.identified) == 3
    assert any("its specimens go to others" in sentence for sentence in said)


@WHOLE
def test_a_result_that_its_worker_takes_away_is_computed_again(cluster, tmp_path, monkeypatch):
    two_workers(cluster)
    gather, lost = _cluster._gathered, []

    async def lose(client, future):
        await future._state.wait()
        if not lost:
            lost.append(next(one for one in cluster.workers.values() if future.key in one.data))
            await asyncio.to_thread(on(cluster, lost[0].close).wait, 60)
        return await gather(client, future)

    monkeypatch.setattr(_cluster, "_gathered", lose)
    summary = identify_fleet(
        write_fleet(tmp_path, ["a", "b"]),
        tmp_path / "out",
        workers=cluster.scheduler_address,
        **OPTIONS,
    )
    assert lost
    assert len(summary.identified) == 2


def test_a_scheduler_without_workers_is_reported_and_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(_cluster, "SILENT", 1.0)
    said = []
    with distributed.LocalCluster(n_workers=0, **LOCAL) as cluster:
        address = cluster.scheduler_address
        with pytest.raises(FleetError, match=r"no worker at .* answers within 3 s; start one"):
            identify_fleet(
                write_fleet(tmp_path, ["a"]),
                tmp_path / "out",
                workers=address,
                patience=3.0,
                say=said.append,
                **OPTIONS,
            )
    assert said == [f"no worker at {address} answers; waiting"]


def test_refuses_addresses_without_a_scheduler(tmp_path):
    pytest.importorskip("distributed", reason="needs Dask: minorloop[fleet]")
    specimens = write_fleet(tmp_path, ["a"])
    with pytest.raises(ParameterError, match="no Dask scheduler at"):
        identify_fleet(specimens, tmp_path / "out", workers="tcp://127.0.0.1:1", **OPTIONS)
    for address in ("nonsense", "nonsense://x", "tcp://127.0.0.1"):
        with pytest.raises(ParameterError, match="give that of a Dask scheduler"):
            identify_fleet(specimens, tmp_path / "out", workers=address, **OPTIONS)
    assert not (tmp_path / "out").exists()

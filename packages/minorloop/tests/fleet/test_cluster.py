"""A Dask cluster in this process, whose scheduler and workers are lost."""

import threading

import pytest

import fleet_faults
from fleet_records import write_manifest, write_record
from later import Later
from minorloop.errors import FleetError, ParameterError
from minorloop.fleet import _cluster, _cluster_watch, _pool, identification
from minorloop.fleet.identification import identify_fleet

distributed = Later("distributed", reason="needs Dask: minorloop[fleet]")
pytestmark = pytest.mark.filterwarnings("ignore")  # what Dask warns of is not ours
OPTIONS = {"levels": 6, "prior": "none", "smoothness": 0.0}


@pytest.fixture
def cluster(monkeypatch):
    """A cluster with a worker."""
    monkeypatch.setattr(identification, "identify_one", fleet_faults.work)
    monkeypatch.setattr(_cluster_watch, "SILENT", 1.5)
    monkeypatch.setattr(_pool, "NOTICE", 0.3)
    monkeypatch.setattr(_pool, "APART", 0.0)
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        protocol="tcp://",
        dashboard_address=None,
    ) as cluster:
        yield cluster


@pytest.fixture(scope="module", autouse=True)
def _idle():
    yield
    _cluster._close_idle()


@pytest.fixture
def fleet(tmp_path):
    """Return a function that makes a fleet with these names."""

    def make(*names):
        for k, name in enumerate(names):
            write_record(tmp_path / f"{name}.csv", k)
        return write_manifest(tmp_path, names)

    return make


def on(cluster, work):
    """Call a function in the event loop of the scheduler and the workers."""
    done = threading.Event()

    async def doing():
        await work()
        done.set()

    cluster.loop.add_callback(doing)
    return done


def test_a_cluster_needs_no_shared_files_and_ends_what_hangs(cluster, fleet, tmp_path):
    specimens, said = fleet("a", "hang", "b"), []
    summary = identify_fleet(
        specimens,
        tmp_path / "out",
        address=cluster.scheduler_address,
        limit=1.5,
        say=said.append,
        **OPTIONS,
    )
    assert [one.specimen for one in summary.identified] == ["a", "b"]
    failed = {one.specimen: one.error for one in summary.failures}
    assert "no model within the limit of 1.5 s" in failed["hang"]
    assert any("specimen hang has run for" in sentence for sentence in said)


@pytest.mark.parametrize("what", ["scheduler", "left", "silent"])
def test_results_are_kept_when_a_cluster_is_lost_and_the_rest_follows_later(
    what, cluster, fleet, tmp_path, monkeypatch
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
    says = {"left": "no worker is left at", "silent": "none of the workers at"}
    (tmp_path / "wait.closed").touch()
    specimens, seen, said = fleet("a", "b", "wait"), [], []

    def watch(done, of, last):
        seen.append(last.specimen)
        if len(seen) == 2:
            on(cluster, faults[what])

    def go_on(**options):
        return identify_fleet(specimens, tmp_path / "out", watch=watch, **options, **OPTIONS)

    address = cluster.scheduler_address
    end = ends.get(what, "no worker at tcp.* has answered for 2 s")
    with pytest.raises(FleetError, match=end + ".*2 of 3 specimens are done and kept"):
        go_on(address=address, patience=2.0, say=said.append)
    said = [sentence for sentence in said if not sentence.startswith("specimen")]
    assert [says[what] in sentence for sentence in said] == [True] * (what in says)
    (tmp_path / "wait.closed").unlink()
    assert len(go_on(workers=1).identified) == 3
    assert sorted(seen) == ["a", "b", "wait"]


def test_specimens_of_a_silent_worker_go_to_the_others(cluster, fleet, tmp_path):
    (tmp_path / "wait.closed").touch()
    specimens, said = fleet("wait", "a", "b"), []
    cluster.scale(2)
    with distributed.Client(cluster) as client:
        client.wait_for_workers(2)

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
        address=cluster.scheduler_address,
        watch=watch,
        say=say,
        **OPTIONS,
    )
    assert len(summary.identified) == 3
    assert any("its specimens are sent to others" in sentence for sentence in said)


def test_a_result_that_its_worker_takes_away_is_computed_again(
    cluster, fleet, tmp_path, monkeypatch
):
    fetch, lost = _cluster.Cluster._fetch, []

    def lose(self, future):
        if lost:
            return fetch(self, future)
        lost.append(future.key)
        future._state.lose()  # as it is when the worker has left, until another has done it
        return fetch(self, future)

    monkeypatch.setattr(_cluster.Cluster, "_fetch", lose)
    summary = identify_fleet(
        fleet("a", "b"), tmp_path / "out", address=cluster.scheduler_address, **OPTIONS
    )
    assert lost
    assert len(summary.identified) == 2


def test_a_scheduler_without_workers_is_reported_and_given_up(fleet, tmp_path):
    specimens, said = fleet("a"), []
    with distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        with pytest.raises(ParameterError, match=r"no worker came to .* within 0.2 s"):
            identify_fleet(
                specimens,
                tmp_path / "out",
                address=address,
                patience=0.2,
                say=said.append,
                **OPTIONS,
            )
    assert said == [f"no workers at {address}; waiting"]


def test_refuses_addresses_without_a_scheduler(fleet, tmp_path):
    specimens = fleet("a")
    with pytest.raises(ParameterError, match="no Dask scheduler at"):
        identify_fleet(specimens, tmp_path / "out", address="tcp://127.0.0.1:1", **OPTIONS)
    for address in ("nonsense", "nonsense://x", "tcp://127.0.0.1"):
        with pytest.raises(ParameterError, match="give that of a Dask scheduler"):
            identify_fleet(specimens, tmp_path / "out", address=address, **OPTIONS)
    assert not (tmp_path / "out").exists()

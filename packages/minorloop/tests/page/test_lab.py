import asyncio
import json
import tempfile

import numpy as np
import pytest
from starlette.requests import Request

from minorloop import Preisach, modelfile
from minorloop.page import lab as lab_page
from minorloop.page.auth import Authentication
from minorloop.page.lab import LabPage, _name, application
from minorloop.page.uploads import Quota
from page_rig import TestClient

BASE = "http://127.0.0.1:8765"
ORIGIN = {"origin": BASE}


@pytest.fixture(scope="module")
def client():
    authentication = Authentication("127.0.0.1")
    app = application(authentication, LabPage(workers=1))
    with TestClient(app, base_url=BASE, headers=ORIGIN) as found:
        found.get("/", params={"key": authentication.key}, follow_redirects=False)
        yield found


def csv(rows=400):
    rng = np.random.default_rng(1)
    u = np.concatenate([[0, 1], rng.uniform(0, 1, rows - 2)])
    levels = np.linspace(0, 1, 7)
    model = Preisach(levels, np.tril(rng.uniform(size=(6, 6))))
    columns = np.column_stack([np.arange(rows), u, model.simulate(u)])
    lines = "\n".join(",".join(f"{x:.8g}" for x in row) for row in columns)
    return f"time [s],voltage [V],length [um]\n{lines}\n".encode()


def drop(client, content=None, name="run.csv"):
    return client.post("/api/lab", params={"name": name}, content=content or csv())


def identify(client, user, **options):
    choice = {"input": "voltage [V]", "output": "length [um]", "levels": 6, **options}
    answer = client.post(f"/api/lab/{user}/identify", content=json.dumps(choice))
    if answer.status_code != 200:
        return [answer.json()]
    return [json.loads(line) for line in answer.text.splitlines()]


@pytest.fixture(scope="module")
def identified(client):
    """The key of a user, and what came while the model was identified."""
    dropped = drop(client).json()
    return dropped["user"], identify(client, dropped["user"], holdout=0.2, lag=0)


@pytest.fixture
def user(identified):
    return identified[0]


def test_a_model_comes_in_stages(identified):
    _, reply = identified
    assert reply[-1] == {"report": True}
    assert "reading" in reply[0]["stage"]
    (result,) = (t["result"] for t in reply if "result" in t)
    assert result["scores"]["holdout"] < 0.01
    assert len(result["weights"]) == 6
    assert len(result["u"]) == len(result["y"]) == len(result["fit"])


def test_model_report_and_inputs_are_downloaded(client, user, tmp_path):
    file = tmp_path / "model.json"
    file.write_bytes(client.get(f"/api/lab/{user}/model.json").content)
    assert modelfile.read(file).input.name == "voltage"
    assert "<html" in client.get(f"/api/lab/{user}/report.html").text
    client.post(f"/api/lab/{user}/invert", content=json.dumps({"targets": [1.0, 0.5]}))
    lines = client.get(f"/api/lab/{user}/inputs.csv").text.splitlines()
    assert lines[0] == "voltage [V],target length [um],predicted length [um],reachable"
    assert len(lines) == 3


@pytest.mark.parametrize(
    ("content", "sentence"),
    [(b"a,b\n1,x\n2,y\n", "must be a number"), (b"a\n1\n2\n", "one column")],
)
def test_a_file_that_is_no_table_is_answered_in_a_sentence(client, content, sentence):
    answer = drop(client, content, "bad.csv")
    assert answer.status_code == 422
    assert sentence in answer.json()["error"]
    assert "/tmp" not in answer.json()["error"]


def test_users_do_not_meet(client, user):
    other = drop(client, b"a,b\n1,2\n2,3\n3,5\n").json()["user"]
    assert other != user
    answer = client.post(f"/api/lab/{other}/move", content='{"u": 0.5}')
    assert "no model yet" in answer.json()["error"]
    assert client.get(f"/api/lab/{other}/model.json").status_code == 404
    assert client.get("/api/lab/nobody/model.json").status_code == 404
    assert client.get(f"/api/lab/{user}/run.csv").status_code == 404


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("run.csv", "run.csv"),
        ("../../etc/passwd", "passwd"),
        ("C:\\data\\run.csv", "run.csv"),
        ("", "data.csv"),
        ("..", "data.csv"),
        ("model.json", "data.csv"),
        ("a\x00b.csv", "a_b.csv"),
        ("x" * 300 + ".csv", "x" * 76 + ".csv"),
        ("\N{GRINNING FACE}" * 5000 + ".csv", "_" * 76 + ".csv"),
        ("語" * 5000 + ".csv", "語" * 38 + ".csv"),
    ],
)
def test_names_of_files_stay_in_their_folder(given, kept):
    assert _name(given) == kept


def test_a_request_that_is_too_long_is_refused(client, user):
    answer = client.post(f"/api/lab/{user}/invert", content=b" " * 600_000)
    assert answer.status_code == 413
    assert "larger than 512 KiB" in answer.json()["error"]


class Pool:
    """Workers that wait until ``free`` is set, and keep the names of their tasks."""

    def __init__(self):
        self.asked, self.ended, self.free = [], 0, asyncio.Event()

    async def start(self):
        pass

    async def stop(self):
        pass

    async def ask(self, task, **options):
        last = {}
        async for reply in self.run(task, **options):
            last = reply
        return last

    async def run(self, task, **options):
        self.asked.append(task)
        try:
            await self.free.wait()
            yield {"name": options["name"], "columns": []}
        finally:
            self.ended += 1


class Page:
    """A page that posts a file and stays connected until ``gone`` is set."""

    def __init__(self, *parts, length=None):
        self.parts, self.gone = list(parts), asyncio.Event()
        self.length = sum(map(len, parts)) if length is None else length

    async def receive(self):
        if self.parts:
            body, more = self.parts.pop(0), bool(self.parts)
            return {"type": "http.request", "body": body, "more_body": more}
        await self.gone.wait()
        return {"type": "http.disconnect"}

    def request(self):
        headers = [(b"content-length", b"%d" % self.length)]
        scope = {"type": "http", "method": "POST", "headers": headers, "query_string": b""}
        return Request(scope, self.receive)


FILE = b"x" * 2000


def at_work(work, **quota):
    """The result of some work with a lab whose two pools a test controls."""

    async def run():
        lab = LabPage(workers=2, quota=Quota(**{"file": 4000, **quota}))
        lab._workers, lab._quick = Pool(), Pool()
        await lab.start()
        try:
            async with asyncio.timeout(30.0):
                return await work(lab)
        finally:
            await lab.stop()

    return asyncio.run(run())


async def until(holds):
    while not holds():
        await asyncio.sleep(0.001)


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def files(scratch):
    return [path.name for path in scratch.glob("*/*/*")]


def test_requests_on_their_way_are_counted(scratch, monkeypatch):
    monkeypatch.setattr(lab_page, "_MOST_JOBS", 2)

    async def work(lab):
        waiting = [Page(FILE[:-1], FILE[-1:]) for _ in range(3)]
        first = [asyncio.create_task(lab._drop(page.request())) for page in waiting[:2]]
        await until(lambda: lab._quick.asked)
        refused = await lab._drop(waiting[2].request())
        lab._quick.free.set()
        await asyncio.gather(*first)
        return refused

    refused = at_work(work)
    assert refused.status_code == 503
    assert "lab is busy" in json.loads(refused.body)["error"]


def test_what_has_no_room_is_refused_before_it_comes(scratch):
    async def work(lab):
        page = Page(FILE)
        return await lab._drop(page.request()), page.parts

    refused, unread = at_work(work, disk=1024)
    assert refused.status_code == 507
    assert unread == [FILE]
    assert files(scratch) == []


def test_a_page_that_goes_ends_its_identification(scratch):
    async def work(lab):
        lab._quick.free.set()
        user = json.loads((await lab._drop(Page(b"small").request())).body)["user"]
        page = Page(b'{"input": "u", "output": "y"}')
        request = page.request()
        request.scope.update(path_params={"user": user}, asgi={"spec_version": "2.3"})
        response = await lab._identify(request)

        async def send(message):
            pass

        answered = asyncio.create_task(response(request.scope, page.receive, send))
        await until(lambda: lab._workers.asked)
        page.gone.set()
        await answered
        return lab._workers.ended

    assert at_work(work) == 1


def test_half_a_file_leaves_nothing(scratch):
    async def work(lab):
        page = Page(FILE[:500], b"", length=len(FILE))
        page.parts[1:] = []
        receive = page.receive

        async def cut():
            if page.parts:
                return {**await receive(), "more_body": True}
            return {"type": "http.disconnect"}

        page.receive = cut
        answer = await lab._drop(page.request())
        assert not list(scratch.glob("*/*"))
        return answer

    assert at_work(work).status_code == 422


def test_a_body_longer_than_announced_is_refused(scratch):
    async def work(lab):
        return await lab._drop(Page(FILE, FILE, FILE, length=10).request())

    assert at_work(work).status_code == 413

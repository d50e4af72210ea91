import json
import pickle
import time

import pytest
from msgspec.structs import asdict, replace
from starlette.websockets import WebSocketDisconnect

from console_rig import STILL, SilentLoop, text
from minorloop.page import workers
from minorloop.page.auth import Authentication
from minorloop_head.console import messages
from minorloop_head.console.clients import SILENCE
from minorloop_head.console.loop import LoopSettings
from minorloop_head.console.recording import PICTURE, TEXT, Recorder
from minorloop_head.console.reports import camera_finding, with_depth
from minorloop_head.console.server import Console
from page_rig import Running, TestClient

BASE = "http://127.0.0.1:8765"
ORIGIN = {"origin": BASE}
ADMITTED = "127.0.0.1"


class Served:
    """A server without a control loop, and a browser that has sent the key."""

    def __init__(self, folder, workers=0):
        self.authentication = Authentication(ADMITTED)
        settings = LoopSettings(folder=str(folder))
        console = Console(
            authentication=self.authentication, loop=settings, link=self.linked, workers=workers
        )
        self.client = TestClient(console.app(), base_url=BASE)
        self.folder = folder

    def linked(self, *options):
        self.link = SilentLoop(*options)
        return self.link

    def page(self, headers=ORIGIN, path="/ws"):
        return self.client.websocket_connect(BASE.replace("http", "ws") + path, headers=headers)


@pytest.fixture
def served(tmp_path):
    found = Served(tmp_path / "sessions")
    with found.client:
        found.client.get("/", params={"key": found.authentication.key}, follow_redirects=False)
        yield found


class Page:
    """A page with its connection, message number and grant."""

    def __init__(self, socket):
        self.socket, self.seq, self.grant = socket, 0, 0

    def send(self, kind, **content):
        self.seq += 1
        self.socket.send_text(
            json.dumps({"type": kind, "seq": self.seq, "t": float(self.seq), **content})
        )

    def until(self, kind):
        while True:
            message = self.socket.receive()
            if message["type"] == "websocket.close":
                raise WebSocketDisconnect(message["code"], message["reason"])
            if message.get("text"):
                told = json.loads(message["text"])
                if told["type"] == kind:
                    return told

    def take(self):
        self.send("take")
        while not (seats := self.until("controls"))["grant"]:
            pass
        self.grant = seats["grant"]
        return self

    def refusal(self):
        with pytest.raises(WebSocketDisconnect) as caught:
            self.until("no kind of message")
        return caught.value.reason


HOLE = {"phi": 0.05, "z": 0.03, "diameter": 1e-3, "evidence": 1.0}
FINDING = camera_finding(3, 2.0, HOLE, 10e-3)


def test_the_key_opens_and_is_taken_out_of_the_address(served):
    stranger = TestClient(served.client.app, base_url=BASE)
    assert stranger.get("/").status_code == 403
    assert stranger.get("/", params={"key": "wrong"}).status_code == 403
    answer = stranger.get("/", params={"key": served.authentication.key}, follow_redirects=False)
    assert answer.status_code == 303
    assert answer.headers["location"] == "/"
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "samesite=lax" in cookie.lower()
    assert served.authentication.key not in cookie
    assert stranger.get("/api/recordings").status_code == 200


def test_other_names_are_not_served(served):
    assert served.client.get("/", headers={"host": "evil.example"}).status_code == 421


def test_other_pages_may_not_post(served):
    for origin in ({}, {"origin": "http://evil.example"}, {"origin": "null"}):
        assert served.client.post("/api/lab", content=b"", headers=origin).status_code == 403


def test_every_answer_forbids_foreign_scripts(served):
    for path in ("/", "/nothing", "/api/recordings"):
        headers = served.client.get(path).headers
        policy = [each.split() for each in headers["content-security-policy"].split(";")]
        told = {name: sources for name, *sources in policy}
        assert told["default-src"] == told["form-action"] == ["'self'"]
        assert told["frame-ancestors"] == told["base-uri"] == told["object-src"] == ["'none'"]
        assert told["connect-src"] == ["'self'", "ws://127.0.0.1:8765", "wss://127.0.0.1:8765"]
        assert headers["cross-origin-resource-policy"] == "same-origin"


def test_a_key_leads_to_no_other_host(served):
    path = f"{BASE}//evil.example/?key={served.authentication.key}"
    answer = served.client.get(path, follow_redirects=False)
    assert answer.headers["location"] == "/evil.example/"


@pytest.mark.parametrize("origin", [{}, {"origin": "http://evil.example"}, {"origin": "null"}])
def test_a_connection_from_elsewhere_is_closed_with_a_reason(served, origin):
    with served.page(headers=origin) as socket:
        assert "another page" in Page(socket).refusal()
    assert served.link.orders == []


def test_a_connection_without_the_key_is_closed_with_a_reason(served):
    served.client.cookies.clear()
    with served.page() as socket:
        assert "key" in Page(socket).refusal()


def test_a_pilot_steers(served):
    with served.page() as socket:
        page = Page(socket).take()
        page.send("drive", grant=page.grant, **STILL)
        page.send("mode", grant=page.grant, mode="HEAD")
        page.send("release", grant=page.grant)
        while page.until("controls")["pilot"]:
            pass
    assert served.link.kinds() == ["ControlsTaken", "Drive", "SetMode", "Release"]


def test_watchers_see_and_may_not_steer(served):
    with served.page() as one, served.page() as other:
        pilot, watcher = Page(one).take(), Page(other)
        served.client.portal.call(served.link.received, text("state", seq=1))
        assert watcher.until("state")["seq"] == 1
        assert pilot.until("state")["seq"] == 1
        watcher.send("take")
        assert "has the controls" in watcher.until("notice")["text"]
        watcher.send("drive", grant=pilot.grant, **STILL)
        assert "only the pilot steers" in watcher.refusal()
    assert all(not isinstance(order, messages.Drive) for order in served.link.orders)


HOSTILE = [
    "[" * 1500,
    "x" * 5000,
    json.dumps({"type": "take", "seq": -1, "t": 0}),
    json.dumps({"type": "mode", "seq": 1, "t": 0, "grant": 0, "mode": "HEAD"}),
    json.dumps({"type": "record", "seq": 1, "t": 0, "grant": 9, "on": True}),
    b"{}",
]


@pytest.mark.parametrize("content", HOSTILE)
def test_a_hostile_message_ends_its_connection_with_a_reason(served, content):
    with served.page() as socket:
        if isinstance(content, bytes):
            socket.send_bytes(content)
        else:
            socket.send_text(content)
        assert Page(socket).refusal()
    assert served.link.orders == []


def test_numbers_that_do_not_rise_end_the_connection(served):
    with served.page() as socket:
        page = Page(socket).take()
        page.seq = 0
        page.send("drive", grant=page.grant, **STILL)
        assert "must rise" in page.refusal()
    assert served.link.kinds() == ["ControlsTaken", "Release"]


def test_a_silent_pilot_loses_the_controls(served, monkeypatch):
    with served.page() as socket:
        page = Page(socket).take()
        began = time.monotonic()
        monkeypatch.setattr(
            "minorloop_head.console.server.time.monotonic", lambda: began + SILENCE + 1.0
        )
        assert "sent nothing" in page.until("notice")["text"]
    assert isinstance(served.link.orders[-1], messages.Release)


def test_findings_are_exported(served):
    rows = [asdict(replace(FINDING, number=1))]
    for number, verdict in enumerate(("no coupling", "through-hole", "measured", "no pit"), 5):
        told = {"verdict": verdict, "diameter": None, "depth": None}
        rows.append(asdict(with_depth(replace(FINDING, number=number), told, 10e-3)))
    served.client.portal.call(served.link.received, text("findings", findings=rows))
    assert served.client.get("/api/findings.json").json()["findings"] == rows
    lines = served.client.get("/api/findings.csv").text.splitlines()
    kinds = ["1,hole or pit", "5,hole or pit", "6,hole", "7,pit", "8,mark"]
    assert [",".join(line.split(",")[:2]) for line in lines[1:]] == kinds
    row = dict(zip(lines[0].split(","), lines[1].split(","), strict=True))
    assert (row["verdict"], row["depth [mm]"]) == ("no echoes yet", "")
    assert float(row["z [mm]"]) == 30.0
    assert float(row["phi [deg]"]) == pytest.approx(2.865)
    missing = served.client.get("/api/findings/1.ply")
    assert missing.status_code == 404
    assert "measure its depth" in missing.json()["error"]
    assert served.client.get("/api/map.png").content.startswith(b"\x89PNG")


def send(served, kind, content):
    """Send the server a message of the loop."""
    served.client.portal.call(
        served.link.received, content if kind is None else text(kind, **content)
    )


def test_a_dropped_finding_takes_its_fit_and_its_mesh_with_it(served):
    job = bytes([messages.JOB]) + pickle.dumps({"finding": 7})
    with served.page() as socket:
        page = Page(socket)
        send(served, None, job)  # of a finding that nobody knows any more
        send(served, "findings", {"findings": [asdict(replace(FINDING, number=7))]})
        send(served, None, job)
        told = page.until("depth")
        assert (told["finding"], told["stage"]) == (7, "waiting for others to finish")
        send(served, "findings", {"findings": []})
        assert page.until("depth")["stage"] == ""
    assert served.link.orders == []


def test_the_map_of_a_sweep_is_shown_and_downloaded_and_its_finds_go_to_the_loop(
    served, monkeypatch
):
    async def mapped(self, task, **options):
        found = {"finds": [{"kind": "pit"}], "files": {"png": b"picture", "csv": b"table"}}
        found |= {"mapped": 0.3456, "whole": False}
        return found if (task, options) == ("sweep", {"z": 1.0}) else {"error": "no echo"}

    monkeypatch.setattr(workers.Workers, "ask", mapped)
    job = bytes([messages.JOB])
    with served.page() as socket:
        page = Page(socket)
        assert served.client.get("/api/sweep.png").status_code == 404
        send(served, None, job + pickle.dumps({"z": 1.0}))
        assert (page.until("depth")["finding"], page.until("depth")["stage"]) == (0, "")
        figures = {"number": 1, "finds": 1, "mapped": 0.346, "whole": False}
        assert page.until("swept") == {"type": "swept", **figures}
        said = "the sweep was cut off: 35% of its area is mapped, with 1 find"
        assert page.until("notice")["text"] == said
        for kind, content in (("png", b"picture"), ("csv", b"table")):
            assert served.client.get(f"/api/sweep.{kind}").content == content
        assert served.client.get("/api/sweep.exe").status_code == 404
        (order,) = served.link.orders
        assert order == messages.SweepFitted(finds=[{"kind": "pit"}])
        send(served, None, job + pickle.dumps({"z": 2.0}))
        assert "there is no map of the sweep: no echo" in page.until("notice")["text"]
    with served.page() as socket:  # a page that comes later
        assert Page(socket).until("swept")["number"] == 1


def test_no_worker_takes_time_and_memory_before_it_is_needed(tmp_path, monkeypatch):
    begun = []

    class Idle:
        def __init__(self, work):
            begun.append(work.tasks.rpartition(".")[2])

        def end(self):
            pass

    monkeypatch.setattr(workers, "_Worker", Idle)
    served = Served(tmp_path, workers=2)
    with served.client:
        served.client.get("/", params={"key": served.authentication.key}, follow_redirects=False)
        assert begun == []
        send(served, "findings", {"findings": [asdict(FINDING)]})
        assert begun == ["depth_work"]
        served.client.get("/lab")
        served.client.get("/lab")
        assert begun == ["depth_work"] + 3 * ["lab_work"]


def test_a_recording_is_replayed(served):
    recorder = Recorder(served.folder, "one")
    said = text("state", seq=5)
    recorder.write(TEXT, 10.0, said)
    recorder.write(PICTURE, 10.01, b"\x01picture")
    recorder.close()
    assert served.client.get("/api/recordings").json() == ["one"]
    with served.page(path="/ws?replay=one") as socket:
        assert socket.receive_text() == said.decode()
        assert socket.receive_bytes() == b"\x01picture"
        assert json.loads(socket.receive_text())["type"] == "ended"


def told(page, kind):
    while True:
        content = page.recv(timeout=20.0)
        if isinstance(content, str) and json.loads(content)["type"] == kind:
            return json.loads(content)


def test_a_pilot_continues_and_another_connects_during_a_flood_of_strangers(tmp_path):
    def application(authentication):
        loop = LoopSettings(folder=str(tmp_path))
        console = Console(authentication=authentication, loop=loop, link=SilentLoop, workers=0)
        return console.app()

    running = Running(application)
    begun = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    with running.page() as pilot:
        pilot.send(json.dumps({"type": "take", "seq": 1, "t": 1.0}))
        while not told(pilot, "controls")["grant"]:
            pass
        strangers = [running.raw(begun if k % 2 else b"") for k in range(100)]
        with running.page() as other:
            assert told(other, "controls")["pilot"] == 1
        pilot.send(json.dumps({"type": "ping", "seq": 2, "t": 2.0}))
        assert told(pilot, "pong")["seq"] == 2
        for each in strangers:  # all of them are closed by the server
            try:
                assert each.recv(1) == b""
            except ConnectionResetError:
                pass
            finally:
                each.close()
    running.stop()

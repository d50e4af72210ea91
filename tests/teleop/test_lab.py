import json

import numpy as np
import pytest

from minorloop import modelfile
from minorloop.operators.preisach import Preisach
from minorloop.teleop.doors import Doors
from minorloop.teleop.lab import _name
from minorloop.teleop.server import Console
from seats import SilentLoop, TestClient

BASE = "http://127.0.0.1:8765"
ORIGIN = {"origin": BASE}


@pytest.fixture(scope="module")
def client():
    doors = Doors("127.0.0.1")
    app = Console(doors=doors, link=SilentLoop, workers=1).app()
    with TestClient(app, base_url=BASE, headers=ORIGIN) as found:
        found.get("/", params={"key": doors.key}, follow_redirects=False)
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
def user(client):
    dropped = drop(client).json()
    told = identify(client, dropped["user"])
    assert told[-1] == {"report": True}
    return dropped["user"]


def test_columns_are_told(client):
    told = drop(client).json()
    assert told["name"] == "run.csv"
    assert [c["header"] for c in told["columns"]] == ["time [s]", "voltage [V]", "length [um]"]
    assert [c["time"] for c in told["columns"]] == [True, False, False]
    assert told["columns"][1]["rows"] == 400


def test_a_model_comes_in_stages(client):
    user = drop(client).json()["user"]
    told = identify(client, user, holdout=0.2, lag=0)
    assert "reading" in told[0]["stage"]
    (result,) = (t["result"] for t in told if "result" in t)
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
    assert lines[0] == "target,input,output"
    assert len(lines) == 3


def test_moves_and_inversions_are_the_librarys_own(client, user, tmp_path):
    file = tmp_path / "model.json"
    file.write_bytes(client.get(f"/api/lab/{user}/model.json").content)
    model = modelfile.load(file)
    inputs, memory, outputs = [0.8, 0.3, 0.5], None, []
    for u in inputs:
        answer = client.post(
            f"/api/lab/{user}/move", content=json.dumps({"u": u, "memory": memory})
        )
        memory = answer.json()["memory"]
        outputs.append(answer.json()["y"])
    np.testing.assert_allclose(outputs, model.simulate(inputs), atol=1e-12)
    found = client.post(f"/api/lab/{user}/invert", content=json.dumps({"targets": outputs})).json()
    np.testing.assert_allclose(found["y"], outputs, atol=1e-9)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"\x00\x01\x02", "binary file"),
        (b"a,b\n", "no rows"),
        (b"a,b\n1,x\n2,y\n", "must be a number"),
        (b"a\n1\n2\n", "one column"),
        (b"a,b\n1,2,3\n", "cell"),
    ],
)
def test_a_file_that_is_no_table_is_answered_in_a_sentence(client, content, sentence):
    answer = drop(client, content, "bad.csv")
    assert answer.status_code == 422
    assert sentence in answer.json()["error"]
    assert "/tmp" not in answer.json()["error"]


def test_what_cannot_be_identified_is_answered_in_a_sentence(client):
    user = drop(client, b"a,b\n1,2\n1,3\n1,4\n1,5\n").json()["user"]
    told = identify(client, user, input="a", output="b", lag=0, holdout=0)
    assert "constant identifies nothing" in told[-1]["error"]
    assert "same column" in identify(client, user, input="a", output="a")[-1]["error"]
    assert "no column" in identify(client, user, input="z", output="a")[-1]["error"]


@pytest.mark.parametrize("choice", [{"levels": 0}, {"levels": 1e9}, {"holdout": 2}, {"more": 1}])
def test_options_out_of_range_are_refused(client, user, choice):
    assert "cannot be read" in identify(client, user, **choice)[0]["error"]


def test_targets_that_are_out_of_reach_are_marked(client, user):
    found = client.post(f"/api/lab/{user}/invert", content=json.dumps({"targets": [1e6, 0.0]}))
    assert found.json()["reachable"][0] is False


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
    ],
)
def test_names_of_files_stay_in_their_folder(given, kept):
    assert _name(given) == kept

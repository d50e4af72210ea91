"""The verb of the lab page."""

import socket
from urllib.error import HTTPError
from urllib.request import HTTPCookieProcessor, build_opener

import pytest

pytest.importorskip("uvicorn", reason="needs starlette and uvicorn: minorloop[page]")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--port 70000", "give 0 to 65535"),
        ("--port x", "not a whole number"),
        ("--certificate good.csv", "together"),
        ("--certificate none.pem --private-key none.key", "none.pem is not a file"),
        (
            "--certificate good.csv --private-key good.csv",
            "good.csv and good.csv are not a certificate",
        ),
        ("--folder good.csv", "give one that exists"),
        ("--host no.such.host.invalid --port 0", "cannot listen"),
        ("--name https://a.example", "give a host name such as lab.example.org"),
    ],
)
def test_refuses_wrong_options_in_one_sentence(refused, options, sentence):
    assert sentence in refused(f"lab {options}")


def test_a_port_in_use_is_refused_in_a_sentence(refused):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"port {port}" in refused(f"lab --port {port}")


def test_it_serves_until_a_signal_ends_it_and_leaves_no_file(tmp_path):
    from page_rig import printed_address

    folder = tmp_path / "dropped"
    folder.mkdir()
    with printed_address("lab", "--folder", str(folder)) as address:
        browser = build_opener(HTTPCookieProcessor())
        with pytest.raises(HTTPError, match="404") as found:
            browser.open(address.replace("?", "api/lab/nobody/model.json?"))
        with found.value as answer:
            assert "removed" in answer.read().decode()
        assert [path.name[:14] for path in folder.iterdir()] == ["minorloop-lab-"]
    assert [*folder.iterdir()] == []

import socket

import pytest


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--port 70000", "give 0 to 65535"),
        ("--port x", "not a whole number"),
        ("--plant twin:ipmc", "nothing to steer"),
        ("--plant twin:head", "needs --camera, and --head with a file"),
        ("--plant bench:none.toml", "needs --camera, and --head with a file"),
        ("--plant bench:none.toml --head h.json --camera camera:0", "h.json"),
        ("--timeout 0", "0.05 to 5"),
        ("--certificate good.csv", "together"),
        ("--certificate none.pem --private-key none.key", "none.pem is not a file"),
        (
            "--certificate good.csv --private-key good.csv",
            "good.csv and good.csv are not a certificate",
        ),
        ("--specimen -1", "--specimen is -1; give 0 or more"),
        ("--seed -1", "--seed is -1; give 0 or more"),
        ("--folder good.csv", "give a folder"),
        ("--host no.such.host.invalid --port 0", "cannot listen"),
        ("--camera camera:ftp://a", "give camera:0"),
        ("--tracker tcp:4242", "give udp:PORT"),
        ("--name https://a.example", "give a host name such as console.example.org"),
    ],
)
def test_refuses_wrong_options_in_one_sentence(run, options, sentence):
    status, out, error = run(f"console {options}")
    assert (status, out) == (2, "")
    assert sentence in error
    assert error.count("\n") == 1


def test_a_port_in_use_is_refused_in_a_sentence(run):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        status, _, error = run(f"console --port {port}")
    assert status == 2
    assert f"port {port}" in error
    assert "--port" in error

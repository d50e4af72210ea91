import pytest


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--port 70000", "give 0 to 65535"),
        ("--plant twin:ipmc", "nothing to steer"),
        ("--plant twin:head", "needs --camera, and --head with a file"),
        ("--plant bench:none.toml --head h.json --camera camera:0", "h.json"),
        ("--certificate none.pem --private-key none.key", "none.pem is not a file"),
        ("--camera camera:ftp://a", "give camera:0"),
        ("--tracker tcp:4242", "give udp:PORT"),
    ],
)
def test_refuses_wrong_options_in_one_sentence(run, options, sentence):
    status, out, error = run(f"console {options}")
    assert (status, out) == (2, "")
    assert sentence in error
    assert error.count("\n") == 1

import pytest

from minorloop.page.auth import Authentication


def test_every_start_has_its_own_key_and_token():
    one, other = Authentication("127.0.0.1"), Authentication("127.0.0.1")
    assert len({one.key, one.token, other.key, other.token}) == 4
    assert one.is_key(one.key)
    for key in (None, "", other.key, one.token, one.key + "x", "\N{SNOWMAN}"):
        assert not one.is_key(key)


def test_a_cookie_is_known_by_its_token():
    authentication = Authentication("127.0.0.1")
    assert authentication.has_token(f"a=b; {authentication.cookie}={authentication.token}")
    for cookies in (
        None,
        "",
        f"{authentication.cookie}=",
        f"other={authentication.token}",
        "{{;;=\x00",
        authentication.token,
    ):
        assert not authentication.has_token(cookies)


FOREIGN = [
    "bad name=1",
    '{"json": [1, 2]}',
    "=empty",
    "x",
    'q="un;closed',
    "a=\x01\x7f",
    "ü=é",
    "[x]=1,,=",
]


@pytest.mark.parametrize("foreign", FOREIGN)
def test_a_foreign_cookie_stops_nothing(foreign):
    authentication = Authentication("127.0.0.1", port=8765)
    own = f"{authentication.cookie}={authentication.token}"
    assert authentication.has_token(f"{foreign}; {own}")
    assert authentication.has_token(f"{own}; {foreign}; {authentication.cookie}=planted")
    assert not authentication.has_token(f"{foreign}; {authentication.cookie}=planted")


@pytest.mark.parametrize("host", ["127.0.0.1:8765", "localhost:8765", "[::1]:8765", "localhost"])
def test_a_page_of_this_server_is_its_own(host):
    authentication = Authentication("127.0.0.1")
    assert authentication.is_own_host(host)
    assert authentication.is_own_page(f"http://{host}", host)


@pytest.mark.parametrize(
    ("origin", "host"),
    [
        (None, "127.0.0.1:8765"),
        ("null", "127.0.0.1:8765"),
        ("http://evil.example", "127.0.0.1:8765"),
        ("http://evil.example:8765", "evil.example:8765"),
        ("http://127.0.0.1:9999", "127.0.0.1:8765"),
        ("http://127.0.0.1:8765.evil.example", "127.0.0.1:8765"),
        ("file://127.0.0.1:8765", "127.0.0.1:8765"),
        ("http://10.0.0.1:8765", "10.0.0.1:8765"),
        ("http://[", "["),
        ("http://localhost:1;script-src *", "localhost:1;script-src *"),
        ("http://localhost evil", "localhost evil"),
    ],
)
def test_other_pages_and_other_names_are_not(origin, host):
    assert not Authentication("127.0.0.1").is_own_page(origin, host)


def test_who_listens_everywhere_is_reached_by_address():
    authentication = Authentication("0.0.0.0")
    assert authentication.is_own_page("https://10.0.0.1:8765", "10.0.0.1:8765")
    assert not authentication.is_own_page("https://evil.example:8765", "evil.example:8765")


def test_a_proxy_is_reached_by_its_name():
    authentication = Authentication("127.0.0.1", name="console.example.org")
    assert authentication.is_own_page("https://console.example.org", "console.example.org")
    assert authentication.is_own_page(
        "https://Console.Example.org:8443", "Console.Example.org:8443"
    )
    assert not authentication.is_own_page("https://evil.example", "evil.example")
    assert not Authentication("127.0.0.1").is_own_host("console.example.org")

import pytest

from minorloop.head.console.auth import Authentication, is_loopback


def test_every_start_has_its_own_key_and_token():
    one, other = Authentication("127.0.0.1"), Authentication("127.0.0.1")
    assert len({one.key, one.token, other.key, other.token}) == 4
    assert one.opens(one.key)
    for key in (None, "", other.key, one.token, one.key + "x", "\N{SNOWMAN}"):
        assert not one.opens(key)


def test_a_cookie_is_known_by_its_token():
    doors = Authentication("127.0.0.1")
    assert doors.known(f"a=b; {doors.cookie}={doors.token}")
    for cookies in (None, "", f"{doors.cookie}=", f"other={doors.token}", "{{;;=\x00", doors.token):
        assert not doors.known(cookies)


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
    doors = Authentication("127.0.0.1", port=8765)
    own = f"{doors.cookie}={doors.token}"
    assert doors.known(f"{foreign}; {own}")
    assert doors.known(f"{own}; {foreign}; {doors.cookie}=planted")
    assert not doors.known(f"{foreign}; {doors.cookie}=planted")


def test_two_consoles_on_a_host_have_two_cookies():
    one, other = Authentication("127.0.0.1", port=8765), Authentication("127.0.0.1", port=8766)
    assert one.cookie != other.cookie
    both = f"{one.cookie}={one.token}; {other.cookie}={other.token}"
    assert one.known(both)
    assert other.known(both)


@pytest.mark.parametrize("host", ["127.0.0.1:8765", "localhost:8765", "[::1]:8765", "localhost"])
def test_a_page_of_this_server_is_its_own(host):
    doors = Authentication("127.0.0.1")
    assert doors.serves(host)
    assert doors.own(f"http://{host}", host)


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
    assert not Authentication("127.0.0.1").own(origin, host)


def test_who_listens_everywhere_is_reached_by_address():
    doors = Authentication("0.0.0.0")
    assert doors.own("https://10.0.0.1:8765", "10.0.0.1:8765")
    assert not doors.own("https://evil.example:8765", "evil.example:8765")


def test_a_proxy_is_reached_by_its_name():
    doors = Authentication("127.0.0.1", name="console.example.org")
    assert doors.own("https://console.example.org", "console.example.org")
    assert doors.own("https://Console.Example.org:8443", "Console.Example.org:8443")
    assert not doors.own("https://evil.example", "evil.example")
    assert not Authentication("127.0.0.1").serves("console.example.org")


@pytest.mark.parametrize("address", ["127.0.0.1", "127.3.2.1", "::1", "::ffff:127.0.0.1"])
def test_own_addresses_are_known(address):
    assert is_loopback(address)


@pytest.mark.parametrize("address", ["10.0.0.1", "::ffff:10.0.0.1", "fe80::1%eth0", "", "name"])
def test_other_addresses_are_not_own(address):
    assert not is_loopback(address)

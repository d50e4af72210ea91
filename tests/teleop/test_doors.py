import pytest

from minorloop.teleop.doors import Doors


def test_every_start_has_its_own_key_and_token():
    one, other = Doors("127.0.0.1"), Doors("127.0.0.1")
    assert len({one.key, one.token, other.key, other.token}) == 4
    assert one.opens(one.key)
    for key in (None, "", other.key, one.token, one.key + "x", "\N{SNOWMAN}"):
        assert not one.opens(key)


def test_a_cookie_is_known_by_its_token():
    doors = Doors("127.0.0.1")
    assert doors.known(f"a=b; {doors.cookie}={doors.token}")
    for cookies in (None, "", f"{doors.cookie}=", f"other={doors.token}", "{{;;=\x00", doors.token):
        assert not doors.known(cookies)


@pytest.mark.parametrize("host", ["127.0.0.1:8765", "localhost:8765", "[::1]:8765", "localhost"])
def test_a_page_of_this_server_is_its_own(host):
    doors = Doors("127.0.0.1")
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
    ],
)
def test_other_pages_and_other_names_are_not(origin, host):
    assert not Doors("127.0.0.1").own(origin, host)


def test_who_listens_everywhere_is_reached_by_address():
    doors = Doors("0.0.0.0")
    assert doors.own("https://10.0.0.1:8765", "10.0.0.1:8765")
    assert not doors.own("https://evil.example:8765", "evil.example:8765")

"""Cursor-on-Target events are well-formed, and reach UDP and TCP receivers."""

import socket
from xml.etree import ElementTree

import pytest

from streamkit_tracks.cursor_on_target import EventSender, InvalidAddress, events

PLACE = {"lat": 48.125, "lon": 11.5}
RECORD = {
    "source": 'uav "1"',
    "capture_ns": 1_763_690_000_123_456_789,
    "tracks": [
        {"id": 7, "state": "confirmed", "geo": {**PLACE, "error_m": 3.5}},
        {"id": 8, "state": "tentative", "geo": PLACE},
        {"id": 9, "state": "confirmed"},
    ],
}


def test_an_event_per_target_with_coordinates() -> None:
    """Uid, type, times and point; tentative targets and those without coordinates are left out."""
    (found,) = events(RECORD, "a-u-G", 5.0)
    event = ElementTree.fromstring(found)
    assert event.attrib == {
        "version": "2.0", "uid": 'streamkit.uav."1".7', "type": "a-u-G", "how": "m-f",
        "time": "2025-11-21T01:53:20.123Z", "start": "2025-11-21T01:53:20.123Z",
        "stale": "2025-11-21T01:53:25.123Z",
    }  # fmt: skip
    point = event.find("point")
    assert point is not None
    assert (point.attrib["lat"], point.attrib["lon"], point.attrib["ce"]) == (
        "48.12500000",
        "11.50000000",
        "3.5",
    )
    contact = event.find("detail/contact")
    assert contact is not None
    assert contact.attrib["callsign"] == 'uav "1" 7'
    (without_time,) = events({**RECORD, "capture_ns": 10**25}, "a-u-G", 5.0)
    assert b'time="1970-01-01T00:00:00.000Z"' in without_time


def test_udp_sends_a_datagram_per_event() -> None:
    """Each event is a datagram."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5)
        sender = EventSender(f"udp://127.0.0.1:{receiver.getsockname()[1]}")
        sender.send([b"one"])
        sender.send([b"two"])
        assert [receiver.recv(100), receiver.recv(100)] == [b"one", b"two"]
        sender.close()


def test_tcp_connects_again() -> None:
    """A closed connection is one error; the next event opens a new one."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(5)
        sender = EventSender(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        link, _ = server.accept()
        sender.send([b"one"])
        assert link.recv(100) == b"one"
        link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        link.close()
        refused = 0
        for _ in range(100):
            try:
                sender.send([b"two"])
            except OSError:
                refused += 1
                break
        assert refused == 1
        sender.send([b"three"])
        link, _ = server.accept()
        assert link.recv(100) == b"three"
        link.close()
        sender.close()


@pytest.mark.parametrize("address", ["", "udp://", "http://a:1", "tcp://a", "udp://a:0", "udp://a:70000"])
def test_malformed_addresses_are_refused(address: str) -> None:
    """The error shows the two valid forms."""
    with pytest.raises(InvalidAddress, match="udp://HOST:PORT or tcp://HOST:PORT"):
        EventSender(address)

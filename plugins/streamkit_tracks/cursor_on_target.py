"""Cursor-on-Target events, which TAK clients and servers show on their maps, over UDP or TCP."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator, Mapping
from datetime import timedelta
from typing import Any
from xml.sax.saxutils import quoteattr

from typing_extensions import override

from streamkit_tracks.file_formats import EPOCH, RecordFormat, iso_text, located, utc_time, xml_text

ADDRESS = re.compile(r"(?P<protocol>udp|tcp)://(?P<host>\[[0-9a-fA-F:]+\]|[^/:\s]+):(?P<port>\d{1,5})/?")
# The schema's value for an unknown length.
UNKNOWN_M = 9_999_999.0
SEND_LIMIT_S = 1.0
KIND, STALE_S = "a-u-G", 5.0  # of the events in files


class InvalidAddress(ValueError):
    """A text is not udp://HOST:PORT or tcp://HOST:PORT."""


def events(record: Mapping[str, Any], kind: str, stale_s: float) -> Iterator[bytes]:
    """One event for each shown target (confirmed or coasting) with ground coordinates.

    An event must have a time: that of publishing where that of capture is unknown.

    Args:
        record: a record with the fields of its JSON.
        kind: the event's type in the CoT hierarchy, `a-u-G` for something unknown on the ground.
        stale_s: how long it is valid.

    Source: Kristan, Cursor-on-Target Message Router User's Guide, MITRE MP090284 (Event.xsd).
    """
    time = utc_time(record.get("capture_ns", record.get("published_ns"))) or EPOCH
    began, stale = iso_text(time), iso_text(time + timedelta(seconds=stale_s))
    for track in located(record):
        position = track["geo"]
        name = xml_text(f"{record['source']} {track['id']}")
        uid = quoteattr(f"streamkit.{name.replace(' ', '.')}")
        yield (
            f'<?xml version="1.0" encoding="UTF-8"?><event version="2.0" uid={uid} type={quoteattr(kind)} '
            f'how="m-f" time="{began}" start="{began}" stale="{stale}">'
            f'<point lat="{position["lat"]:.8f}" lon="{position["lon"]:.8f}" hae="{UNKNOWN_M}" '
            f'ce="{position.get("error_m", UNKNOWN_M)}" le="{UNKNOWN_M}"/>'
            f"<detail><contact callsign={quoteattr(name)}/></detail></event>"
        ).encode()


class CotFormat(RecordFormat):
    """An event a line, for programs that replay them."""

    @override
    def record(self, record: Mapping[str, Any]) -> bytes:
        return b"".join(event + b"\n" for event in events(record, KIND, STALE_S))


class EventSender:
    """Sends events over UDP, one per datagram, or TCP; every call ends within about a second.

    Args:
        address: `udp://239.2.3.1:6969` or `tcp://tak.example.org:8087`.

    Raises:
        InvalidAddress: the address is malformed.
        OSError: a TCP server does not answer.
    """

    def __init__(self, address: str) -> None:
        match = ADDRESS.fullmatch(address)
        if match is None or not 0 < int(match["port"]) < 65536:
            raise InvalidAddress(f"an address must be udp://HOST:PORT or tcp://HOST:PORT, got {address!r}")
        self._target = (match["host"].strip("[]"), int(match["port"]))
        self._is_tcp = match["protocol"] == "tcp"
        self._socket: socket.socket | None = None
        self._connect()

    def send(self, events: list[bytes]) -> None:
        """Sends events; a lost TCP connection is opened again.

        Raises:
            OSError: an event was not sent, nor those after it.
        """
        if self._socket is None:
            self._connect()
        assert self._socket is not None
        try:
            for event in events:
                self._socket.sendall(event)
        except OSError:
            self.close()
            raise

    def close(self) -> None:
        """Closes the socket."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def _connect(self) -> None:
        if self._is_tcp:
            self._socket = socket.create_connection(self._target, SEND_LIMIT_S)
            return
        family, kind, protocol, _, destination = socket.getaddrinfo(*self._target, type=socket.SOCK_DGRAM)[0]
        link = socket.socket(family, kind, protocol)
        try:
            link.settimeout(SEND_LIMIT_S)
            link.connect(destination)
        except OSError:
            link.close()
            raise
        self._socket = link

"""Where an RTSP server is reached."""

from __future__ import annotations

from urllib.parse import urlsplit

DEFAULT_PORTS = {"rtsp": 554, "rtsps": 322}


def port_of(location: str) -> int:
    """The TCP port a URL leads to.

    Raises:
        ValueError: the URL's port is no number from 0 to 65535.
    """
    parts = urlsplit(location)
    return parts.port or DEFAULT_PORTS.get(parts.scheme, 554)

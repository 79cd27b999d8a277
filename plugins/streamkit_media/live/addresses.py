"""Schemes and ports of the addresses of servers."""

from __future__ import annotations

from urllib.parse import urlsplit

DEFAULT_PORTS = {"rtsp": 554, "rtsps": 322, "http": 80, "https": 443, "rtmp": 1935, "rtmps": 443}
RTSP_SCHEMES = ("rtsp", "rtsps")
LIVE_SCHEMES = ("udp", "tcp", "srt", "rtmp", "rtmps")  # never a file, which http may lead to
PLAIN_OF = {"rtsps": "rtsp", "https": "http", "rtmps": "rtmp"}  # schemes with TLS, and the same without


def port_of(location: str) -> int:
    """The port a URL leads to; 0 where neither it nor its scheme has one.

    Raises:
        ValueError: the URL's port is no number from 0 to 65535; the text may be a password.
    """
    try:
        parts = urlsplit(location)
        return parts.port or DEFAULT_PORTS.get(parts.scheme, 0)
    except ValueError:
        raise ValueError(
            "the port must be a number from 0 to 65535, and / ? # @ in a password %2F %3F %23 %40"
        ) from None

"""Where an RTSP server is reached."""

from __future__ import annotations

from urllib.parse import urlsplit

DEFAULT_PORTS = {"rtsp": 554, "rtsps": 322}


def port_of(location: str) -> int:
    """The TCP port a URL leads to.

    Raises:
        ValueError: the URL's port is no number from 0 to 65535; what stands there may be a password.
    """
    try:
        parts = urlsplit(location)
        return parts.port or DEFAULT_PORTS.get(parts.scheme, 554)
    except ValueError:
        raise ValueError(
            "the port must be a number from 0 to 65535, and / ? # @ in a password %2F %3F %23 %40"
        ) from None

"""Zenoh endpoints as users write them: parsed, and classified as local or secure."""

import ipaddress
import re

from streamkit import mask_secrets

PROTOCOLS = ("tcp", "tls", "quic", "udp", "ws")
ENDPOINT = re.compile(
    rf"(?P<protocol>{'|'.join(PROTOCOLS)})/(?P<host>\[[0-9a-fA-F:.%a-z]+\]|[^/:\s?#\[\]]+):(?P<port>\d{{1,5}})"
    r"(?P<metadata>\?[^#\s]*)?(?P<config>#\S*)?"
)
SOCKET_FILE = re.compile(r"(unixsock-stream|unixpipe)/[^\s?#]+")


class InvalidEndpoint(ValueError):
    """A text is not an endpoint; the message masks its secrets."""


def endpoints(text: str | None) -> tuple[str, ...]:
    """Splits a list of endpoints at commas and checks each.

    Args:
        text: for example `tcp/192.168.0.7:7447,tcp/[::1]:7448`; None and blanks give none.

    Raises:
        InvalidEndpoint: one is not PROTOCOL/HOST:PORT.
    """
    parts = tuple(part.strip() for part in (text or "").split(",") if part.strip())
    for part in parts:
        match = ENDPOINT.fullmatch(part)
        if (match is None or int(match["port"]) > 65535) and not SOCKET_FILE.fullmatch(part):
            raise InvalidEndpoint(
                f"an endpoint must be PROTOCOL/HOST:PORT with one of {', '.join(PROTOCOLS)}, "
                f"got {mask_secrets(part)!r}; write for example tcp/192.168.0.7:7447"
            )
    return parts


def is_local(endpoint: str) -> bool:
    """Whether an endpoint stays on this machine: loopback addresses, `localhost` and socket files."""
    match = ENDPOINT.fullmatch(endpoint)
    if match is None:
        return SOCKET_FILE.fullmatch(endpoint) is not None
    return is_loopback(match["host"].strip("[]"))


def is_loopback(host: str) -> bool:
    """Whether only processes of this machine reach an address or name."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_secure(endpoint: str) -> bool:
    """Whether its link is encrypted."""
    return endpoint.startswith(("tls/", "quic/"))

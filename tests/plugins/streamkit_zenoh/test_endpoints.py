"""Endpoints are validated before zenoh gets them, and shown without their secrets."""

import pytest

from streamkit import mask_secrets
from streamkit_zenoh.configuration import InvalidEndpoint, endpoints, is_local


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, ()),
        ("", ()),
        (" , ", ()),
        ("tcp/127.0.0.1:7447", ("tcp/127.0.0.1:7447",)),
        ("tcp/[::1]:7447, tls/drone.local:7448", ("tcp/[::1]:7447", "tls/drone.local:7448")),
        ("tcp/10.0.0.1:1?prio=6-7;rel=0#iface=eth0", ("tcp/10.0.0.1:1?prio=6-7;rel=0#iface=eth0",)),
        ("unixsock-stream//tmp/zenoh.sock", ("unixsock-stream//tmp/zenoh.sock",)),
    ],
)
def test_lists_are_split(text: str | None, expected: tuple[str, ...]) -> None:
    """Commas separate endpoints; blanks around them are ignored."""
    assert endpoints(text) == expected


@pytest.mark.parametrize(
    "text",
    ["127.0.0.1:7447", "tcp/127.0.0.1", "tcp/host:99999", "foo/host:1", "tcp/:1", "tcp:host:1", "tcp/a b:1"],
)
def test_malformed_endpoints_are_refused(text: str) -> None:
    """Zenoh accepts some of these and retries silently for ever."""
    with pytest.raises(InvalidEndpoint, match="PROTOCOL/HOST:PORT"):
        endpoints(text)


@pytest.mark.parametrize(
    ("endpoint", "expected"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tcp/127.8.9.1:7447", True),
        ("tcp/[::1]:7447", True),
        ("tcp/localhost:7447", True),
        ("unixsock-stream//tmp/zenoh.sock", True),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/192.168.0.7:7447", False),
        ("tcp/localhost.example.org:7447", False),
    ],
)
def test_local_endpoints_are_known(endpoint: str, expected: bool) -> None:
    """Loopback addresses, localhost and socket files stay on the machine; any-addresses do not."""
    assert is_local(endpoint) is expected


@pytest.mark.parametrize(
    "text",
    [
        "tls/host:1#connect_private_key_base64=SECRET",
        "tcp/me:SECRET@host:1",
        "cannot open tls/host:1#root=a;key=SECRET, tcp/you:SECRET@other:2 and so on",
    ],
)
def test_secrets_are_masked(text: str) -> None:
    """Link configuration and user information never appear."""
    assert "SECRET" not in mask_secrets(text)
    assert "host" in mask_secrets(text)


def test_the_refusal_shows_no_secret() -> None:
    """A refused endpoint may hold a secret."""
    with pytest.raises(InvalidEndpoint) as caught:
        endpoints("tcp/me:SECRET@host")
    assert "SECRET" not in str(caught.value)

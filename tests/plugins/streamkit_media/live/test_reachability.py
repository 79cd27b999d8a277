import socket

import pytest

from streamkit_media.live.reachability import connection_failure, port_of, server_failure


def test_refusal_names_the_reason() -> None:
    """An unknown host and a closed port give a reason in plain words; an open port gives none."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert connection_failure("127.0.0.1", port, 1) == ""
    refused = f"no connection to 127.0.0.1 port {port}: Connection refused"
    assert connection_failure("127.0.0.1", port, 1) == refused
    unknown = "the host name 'no-such-host.invalid' is not known here"
    assert connection_failure("no-such-host.invalid", 554, 1) == unknown


@pytest.mark.parametrize("password", ["s3@cr/et", "1@secret/x", "12?se@cret"])
def test_no_part_of_a_password_is_taken_for_the_host(password: str) -> None:
    """An @ or / in it that is not written %40 or %2F."""
    reason = server_failure(f"rtsp://user:{password}@127.0.0.1:9/live", 1)
    assert reason.startswith("no connection to the host; slash, ?, # and at sign in a password must be %2F")


def test_refusal_is_bounded() -> None:
    """A host that does not answer is reported within the limit."""
    with socket.create_server(("127.0.0.1", 0), backlog=0) as server:
        address = server.getsockname()
        waiting = [socket.socket() for _ in range(3)]
        for connection in waiting:
            connection.setblocking(False)
            connection.connect_ex(address)
        try:
            expected = f"no connection to 127.0.0.1 port {address[1]} within 0.2 s"
            assert connection_failure(*address, 0.2) == expected
        finally:
            for connection in waiting:
                connection.close()


def test_ports() -> None:
    """The port is the URL's own or its scheme's; one that is not a number is refused."""
    assert port_of("rtsp://cam/live") == 554
    assert port_of("rtsps://cam/live") == 322
    assert port_of("rtsp://u:p@cam:8554/live") == 8554
    with pytest.raises(ValueError, match="the port must be a number"):
        port_of("rtsp://cam:abc/live")

import socket
import threading
import time

import pytest

from streamkit_media.live.sockets import ConnectionSockets


def test_a_cut_connection_ends_a_wait() -> None:
    """A thread that waits on a connection comes back at once when it is cut."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        sockets = ConnectionSockets(port)
        with socket.create_connection(("127.0.0.1", port), 20) as connection:
            counts: list[int] = []
            timer = threading.Timer(0.05, lambda: counts.append(sockets.cut()))
            timer.start()
            began = time.monotonic()
            assert connection.recv(10) == b""
            assert time.monotonic() - began < 5
            timer.join()
    assert counts == [1]


def test_known_and_other_connections_stay() -> None:
    """Connections made before, to other ports, and listening sockets are left alone."""
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_server(("127.0.0.1", 0)) as other:
        port, other_port = server.getsockname()[1], other.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port), 5) as before:
            sockets = ConnectionSockets(port)
            with socket.create_connection(("127.0.0.1", other_port), 5) as beside:
                assert sockets.cut() == 0
                accepted = [server.accept()[0], other.accept()[0]]
                for connection, end in zip((before, beside), accepted, strict=True):
                    end.sendall(b"alive")
                    assert connection.recv(10) == b"alive"
                    end.close()


@pytest.mark.parametrize("port", [1, 65535])
def test_nothing_to_cut_is_no_error(port: int) -> None:
    """Cutting where there is no connection does nothing."""
    assert ConnectionSockets(port).cut() == 0


def test_what_one_connection_has_claimed_the_others_leave_alone() -> None:
    """Of two connections to one server each cuts its own, and knows whether the server has closed it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        first, second = ConnectionSockets(port), ConnectionSockets(port)
        with socket.create_connection(("127.0.0.1", port), 5) as connection, server.accept()[0] as end:
            first.claim()
            assert second.cut() == 0
            end.sendall(b"alive")
            assert connection.recv(10) == b"alive"
            assert not first.is_closed_by_peer()
            end.close()
            assert connection.recv(10) == b""
            assert first.is_closed_by_peer()
            assert first.cut() == 1
        first.release()

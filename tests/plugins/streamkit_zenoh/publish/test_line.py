"""The line keeps order, holds the stream up once at most, and counts what it drops."""

import threading
from collections.abc import Iterator

import pytest

from streamkit_zenoh.publish.line import SendingLine


class _Network:
    """Sends nothing until it is opened."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.open = threading.Event()
        self.busy = threading.Event()

    def send(self, payload: bytes) -> None:
        self.busy.set()
        assert self.open.wait(10)
        if payload == b"bad":
            raise OSError("link down")
        self.sent.append(payload)


@pytest.fixture
def network() -> Iterator[_Network]:
    """A network that is opened at the latest when the test ends."""
    network = _Network()
    yield network
    network.open.set()


def _sender(network: _Network, capacity: int = 4) -> tuple[SendingLine[bytes], list[Exception]]:
    failures: list[Exception] = []
    return SendingLine(network.send, capacity, failures.append), failures


NEVER = threading.Event()


def test_everything_is_sent_in_order(network: _Network) -> None:
    """With patience nothing is dropped, however small the line."""
    network.open.set()
    sender, failures = _sender(network, capacity=2)
    payloads = [str(number).encode() for number in range(200)]
    assert sum(sender.submit(payload, 10.0, NEVER) for payload in payloads) == 0
    assert sender.flush(10.0, NEVER) == 0
    assert network.sent == payloads
    assert failures == []
    assert sender.close() == 0
    assert sender.join(5)


def test_a_full_line_drops_the_oldest(network: _Network) -> None:
    """Without patience the newest are kept and the number of dropped ones is told."""
    sender, _ = _sender(network, capacity=3)
    assert sender.submit(b"first", 0.0, NEVER) == 0
    assert network.busy.wait(5)
    dropped = [sender.submit(str(number).encode(), 0.0, NEVER) for number in range(5)]
    assert dropped == [0, 0, 0, 1, 1]
    network.open.set()
    assert sender.flush(5.0, NEVER) == 0
    assert network.sent == [b"first", b"2", b"3", b"4"]
    sender.close()
    assert sender.join(5)


def test_a_dead_network_is_waited_for_once(network: _Network) -> None:
    """After one wait in vain, frames pass at once until something has been sent."""
    sender, _ = _sender(network, capacity=1)
    sender.submit(b"first", 0.0, NEVER)
    assert network.busy.wait(5)
    sender.submit(b"a", 0.0, NEVER)
    assert sender.submit(b"b", 0.1, NEVER) == 1
    # A wait of an hour would end the test by its time limit.
    assert sender.submit(b"c", 3600.0, NEVER) == 1
    network.open.set()
    assert sender.flush(5.0, NEVER) == 0
    assert sender.submit(b"d", 3600.0, NEVER) == 0
    sender.flush(5.0, NEVER)
    assert network.sent == [b"first", b"c", b"d"]
    sender.close()
    assert sender.join(5)


def test_a_cancelled_wait_ends_at_once(network: _Network) -> None:
    """A pipeline that stops is not held up by patience."""
    sender, _ = _sender(network, capacity=1)
    stopping = threading.Event()
    stopping.set()
    sender.submit(b"first", 0.0, NEVER)
    assert network.busy.wait(5)
    sender.submit(b"a", 0.0, NEVER)
    assert sender.submit(b"b", 3600.0, stopping) == 1
    assert sender.flush(3600.0, stopping) == 2
    sender.close()
    network.open.set()
    assert sender.join(5)


def test_flush_tells_what_is_left(network: _Network) -> None:
    """A flush ends when nothing moves for its patience; closing tells what it drops."""
    sender, _ = _sender(network)
    for payload in (b"a", b"b", b"c"):
        sender.submit(payload, 0.0, NEVER)
    assert network.busy.wait(5)
    assert sender.flush(0.1, NEVER) == 3
    assert sender.close() == 2
    network.open.set()
    assert sender.join(5)


def test_a_failure_does_not_end_sending(network: _Network) -> None:
    """One record that cannot be sent is told; the next ones go out."""
    network.open.set()
    sender, failures = _sender(network)
    for payload in (b"a", b"bad", b"b"):
        sender.submit(payload, 5.0, NEVER)
    assert sender.flush(5.0, NEVER) == 0
    assert network.sent == [b"a", b"b"]
    assert [str(failure) for failure in failures] == ["link down"]
    sender.close()
    assert sender.join(5)

import socket

import pytest

from streamkit_media.udp import (
    COUNT_OVERFLOWS,
    OVERFLOWS,
    UdpAddress,
    open_receiver,
    overflows,
    source_address,
)


@pytest.mark.parametrize(
    ("location", "address"),
    [
        ("udp://239.1.2.3:5000", ("239.1.2.3", 5000, "")),
        ("udp://@239.1.2.3:5000?localaddr=10.0.0.1", ("239.1.2.3", 5000, "10.0.0.1")),
        ("udp://@:5000", ("", 5000, "")),
        ("udp://:5000?localaddr=10.0.0.1", ("", 5000, "10.0.0.1")),
        ("udp://[ff02::1%eth0]:5000", ("ff02::1%eth0", 5000, "")),
    ],
)
def test_addresses(location: str, address: tuple[str, int, str]) -> None:
    """Host, group and interface are read from the URL; no host is every interface."""
    assert source_address(location) == UdpAddress(*address)


def test_overflows_of_the_kernel_are_counted() -> None:
    """What a full buffer drops is told with the next datagram that is read."""
    with open_receiver(UdpAddress("127.0.0.1", 0)) as receiver:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        receiver.settimeout(5)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for _ in range(100):
                sender.sendto(bytes(1000), receiver.getsockname())
            taken = 0
            receiver.setblocking(False)
            try:
                while True:
                    receiver.recv(2000)
                    taken += 1
            except BlockingIOError:
                pass
            sender.sendto(b"x", receiver.getsockname())
        _, ancillary, _, _ = receiver.recvmsg(2000, socket.CMSG_SPACE(OVERFLOWS.size))
    assert overflows(ancillary) == 100 - taken > 0


def test_other_messages_of_the_kernel_are_no_overflows() -> None:
    """Nothing said, or another size, is no loss."""
    assert overflows([]) == 0
    assert overflows([(socket.SOL_SOCKET, COUNT_OVERFLOWS, b"x")]) == 0


@pytest.mark.parametrize(
    ("host", "reason"), [("no-such-host.invalid", "is not known here"), ("192.0.2.1", "write udp://@:PORT")]
)
def test_a_port_that_cannot_be_opened_has_a_remedy(host: str, reason: str) -> None:
    """An unknown name and an address of another machine are refused in plain words."""
    with pytest.raises(OSError, match=reason):
        open_receiver(UdpAddress(host, 5000))

"""A bad network of the tests' own, between an RTSP client and a server: it loses, swaps, holds back and cuts.

What it does depends on the numbers of the packets, never on chance or the clock, so that each run is alike.
"""

from __future__ import annotations

import queue
import re
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TypeAlias

POLL_S = 0.02
SEND_LIMIT_S = 10.0
Send: TypeAlias = "Callable[[bytes], object]"
VIDEO = 0  # the channel, or the first of the two ports, that the video uses


@dataclass
class LossyProxy:
    """Leads every client that connects to it to a server on this machine.

    Attributes may change at any time; the packets meant are those of the video that the server sends.

    Attributes:
        server_port: of the server.
        loses_every: of so many packets one is lost; 0 loses none.
        damages_every: of so many packets one comes with bytes changed; 0 changes none.
        swaps_every: of so many packets one comes after the one that follows it; 0 swaps none.
        delay_s: how much later each packet comes.
        is_stalled: while True nothing passes, in either direction, and nothing is lost.
        blocks_udp: whether packets over UDP are lost, all of them, as behind a firewall.
        refuses_udp: whether a client that asks for UDP is told that there is none.
        packets: of the video that have come from the server.
        lost: of them, those that went no further.
    """

    server_port: int
    loses_every: int = 0
    damages_every: int = 0
    swaps_every: int = 0
    delay_s: float = 0.0
    is_stalled: bool = False
    blocks_udp: bool = False
    refuses_udp: bool = False
    packets: int = 0
    lost: int = 0
    port: int = 0
    _closing: threading.Event = field(default_factory=threading.Event)
    _threads: list[threading.Thread] = field(default_factory=list)
    _connections: list[socket.socket] = field(default_factory=list)
    _under_way: queue.Queue[tuple[float, Callable[[bytes], object], bytes]] = field(
        default_factory=queue.Queue
    )

    def __enter__(self) -> LossyProxy:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._listener.settimeout(POLL_S)
        self.start(self._accept)
        self.start(self._deliver)
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        while self._threads:
            self._threads.pop(0).join(10)

    @property
    def url(self) -> str:
        """Where a client connects."""
        return f"rtsp://127.0.0.1:{self.port}/live"

    def cut(self) -> None:
        """Ends all connections at once, wherever they are."""
        for connection in list(self._connections):
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def start(self, target: object, *arguments: object) -> None:
        """Runs something in a thread that ends with the proxy."""
        thread = threading.Thread(target=target, args=arguments)  # type: ignore[arg-type]
        self._threads.append(thread)
        thread.start()

    def waits(self) -> bool:
        """Waits while the network is stalled; False once the proxy closes."""
        while self.is_stalled and not self._closing.wait(POLL_S):
            continue
        return not self._closing.is_set()

    def send(self, send: Send, data: bytes) -> None:
        """Sends something to the client when it is due; all that is sent keeps its order."""
        self._under_way.put((time.monotonic() + self.delay_s, send, data))

    def _deliver(self) -> None:
        while self.waits():
            with suppress(queue.Empty):
                due_s, send, data = self._under_way.get(timeout=POLL_S)
                self._closing.wait(max(0.0, due_s - time.monotonic()))
                if self.waits():
                    with suppress(OSError):
                        send(data)

    def fate(self, packet: bytes, held: deque[bytes]) -> list[bytes]:
        """What comes of one packet of the video, and of one held back before.

        Args:
            packet: RTP.
            held: at most one packet, which comes after this one.
        """
        self.packets += 1
        if self.loses_every and not self.packets % self.loses_every:
            self.lost += 1
            return []
        if self.damages_every and not self.packets % self.damages_every and len(packet) > 40:
            packet = packet[:30] + bytes(255 - byte for byte in packet[30:40]) + packet[40:]
        if self.swaps_every and not self.packets % self.swaps_every and not held:
            held.append(packet)
            return []
        found = [packet, *held]
        held.clear()
        return found

    def _accept(self) -> None:
        with self._listener:
            while not self._closing.is_set():
                with suppress(TimeoutError):
                    client, _ = self._listener.accept()
                    with suppress(OSError):
                        Passage(self, client, socket.create_connection(("127.0.0.1", self.server_port), 5))

    def joined(self, *connections: socket.socket) -> None:
        """Notes connections, so that they can be cut."""
        self._connections += connections


class Passage:
    """One client's connection to the server: requests one way, answers and interleaved packets the other."""

    def __init__(self, proxy: LossyProxy, client: socket.socket, server: socket.socket) -> None:
        self.proxy, self.client, self.server = proxy, client, server
        self.held: deque[bytes] = deque()
        self.ports: tuple[str, str] | None = None
        self.is_over = threading.Event()
        proxy.joined(client, server)
        for connection in (client, server):
            connection.settimeout(SEND_LIMIT_S)
        proxy.start(self.requests)
        proxy.start(self.answers)

    def receive(self, connection: socket.socket) -> bytes | None:
        """What comes next; None at the end."""
        while not self.is_over.is_set() and self.proxy.waits():
            try:
                if select.select([connection], [], [], POLL_S)[0]:
                    return connection.recv(65_536) or None
            except (OSError, ValueError):  # closed meanwhile
                return None
        return None

    def requests(self) -> None:
        """From the client to the server."""
        try:
            while (data := self.receive(self.client)) is not None:
                if b"client_port=" in data:
                    if self.proxy.refuses_udp:
                        self.refuse(data)
                        continue
                    data = self.through_own_ports(data)
                self.server.sendall(data)
        except OSError:
            pass
        finally:
            self.end()

    def refuse(self, request: bytes) -> None:
        """Answers that this transport is not available."""
        number = re.search(rb"(?i)CSeq: *(\d+)", request)
        assert number is not None
        head = b"RTSP/1.0 461 Unsupported Transport\r\nCSeq: "
        self.proxy.send(self.client.sendall, head + number[1] + b"\r\nSession: 7\r\n\r\n")

    def through_own_ports(self, request: bytes) -> bytes:
        """The request with ports of the proxy in place of the client's."""
        found = re.search(rb"client_port=(\d+)-(\d+)", request)
        assert found is not None
        own = udp_pair()
        for offset, listener in enumerate(own):
            listener.settimeout(POLL_S)
            self.proxy.start(self.datagrams, listener, int(found[1]) + offset, offset)
        first = own[0].getsockname()[1]
        self.ports = (f"client_port={first}-{first + 1}", found[0].decode())
        return request.replace(found[0], self.ports[0].encode())

    def datagrams(self, listener: socket.socket, target: int, channel: int) -> None:
        """From the server to the client over UDP."""
        held: deque[bytes] = deque()
        with listener, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.connect(("127.0.0.1", target))
            to_client = sender.send
            while not self.is_over.is_set() and self.proxy.waits():
                with suppress(TimeoutError):
                    packet = listener.recv(65_536)
                    packets = self.proxy.fate(packet, held) if channel == VIDEO else [packet]
                    for each in packets if not self.proxy.blocks_udp else ():
                        self.proxy.send(to_client, each)

    def answers(self) -> None:
        """From the server to the client over TCP."""
        buffer = b""
        try:
            while (data := self.receive(self.server)) is not None:
                buffer = self.passed_on(buffer + data)
        except OSError:
            pass
        finally:
            self.end()

    def passed_on(self, buffer: bytes) -> bytes:
        """Passes on whole packets and answers; what is left is not whole yet."""
        while buffer:
            if buffer[:1] == b"$":
                length = 4 + int.from_bytes(buffer[2:4], "big")
                if len(buffer) < max(4, length):
                    return buffer
                self.interleaved(buffer[1], buffer[4:length])
            else:
                head = buffer.find(b"\r\n\r\n") + 4
                if head < 4:
                    return buffer
                found = re.search(rb"(?i)content-length: *(\d+)", buffer[:head])
                length = head + (int(found[1]) if found else 0)
                if len(buffer) < length:
                    return buffer
                self.proxy.send(self.client.sendall, self.with_clients_ports(buffer[:length]))
            buffer = buffer[length:]
        return buffer

    def interleaved(self, channel: int, packet: bytes) -> None:
        """One packet over TCP."""
        packets = self.proxy.fate(packet, self.held) if channel == VIDEO else [packet]
        for each in packets:
            head = b"$" + bytes([channel]) + len(each).to_bytes(2, "big")
            self.proxy.send(self.client.sendall, head + each)

    def with_clients_ports(self, answer: bytes) -> bytes:
        """The answer with the client's own ports in place of the proxy's."""
        if self.ports is None:
            return answer
        return answer.replace(self.ports[0].encode(), self.ports[1].encode())

    def end(self) -> None:
        """Closes both sides."""
        self.is_over.set()
        for connection in (self.client, self.server):
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()


def udp_pair() -> tuple[socket.socket, socket.socket]:
    """Two ports next to each other, the first even, as RTP and RTCP have them."""
    while True:
        first = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        first.bind(("127.0.0.1", 0))
        number = first.getsockname()[1]
        second = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            if number % 2 == 0:
                second.bind(("127.0.0.1", number + 1))
                return first, second
        except OSError:
            pass
        first.close()
        second.close()

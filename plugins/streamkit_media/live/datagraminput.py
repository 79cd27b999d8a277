"""A transport stream that arrives in datagrams, received here and demultiplexed by FFmpeg.

FFmpeg's own udp protocol cannot be ended from outside while nothing arrives.
"""

from __future__ import annotations

import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from typing_extensions import override

from streamkit import ResourceError
from streamkit_media.failures import ConnectionLost
from streamkit_media.live.liveinput import TransportInput
from streamkit_media.live.transportstream import NextStream, TransportPackets
from streamkit_media.udp import OVERFLOWS, RECEIVE_BUFFER_BYTES, open_receiver, overflows, source_address

POLL_S = 0.1
NOTICE_S = 2.0  # how long a first connection waits before it reports what for
DATAGRAM_BYTES = 1 << 16


class DatagramInput(TransportInput):
    """Receives a transport stream at a UDP port.

    Args:
        location, timeout_s, low_latency: see `TransportInput` and `source_address`.
        counts: datagrams lost, overflowed (dropped by the kernel) and refused, over all connections.
        warn: called with a text when the kernel first drops datagrams.
        is_first: whether no connection was made before: it warns when nothing comes, a later one is reported
            as a retry.
        before: the input that has ended, perhaps because the sender has begun another stream: its port and
            what has come of that stream are taken over; None for the first.
    """

    def __init__(
        self,
        location: str,
        timeout_s: float,
        counts: Counter[str],
        warn: Callable[[str], object],
        *,
        is_first: bool,
        low_latency: bool,
        before: DatagramInput | None,
    ) -> None:
        super().__init__(location, timeout_s, low_latency=low_latency)
        self._counts, self._warn = counts, warn
        self._reports_absence = is_first  # until it has
        self._packets = TransportPackets(counts)
        self._receiver: socket.socket | None = None
        self._next_stream = NextStream(timeout_s)
        self._begun_anew = b""  # what has come of the sender's next stream, which ends this one
        self._overflowed = self._datagrams = 0
        if before is not None and before._begun_anew:
            self._receiver, self._held = before._receiver, before._begun_anew
            self._packets, self._overflowed = before._packets, before._overflowed  # counted by the socket
            self._next_stream.begun(self._held)

    @override
    def open(self) -> InputContainer:
        if self._receiver is None:
            try:
                self._receiver = open_receiver(source_address(self.location))
            except OSError as error:
                raise ResourceError(f"{self.where}: the port cannot be used: {error}") from None
            self._receiver.settimeout(POLL_S)
        return super().open()

    @override
    def receive(self) -> bytes:
        """The transport packets of the next datagram that has some."""
        assert self._receiver is not None
        now_s = time.monotonic()
        deadline, notice_s = now_s + self.timeout_s, now_s + NOTICE_S
        while not self.ended.is_set() and not self._begun_anew:
            now_s = time.monotonic()
            if now_s > deadline:
                raise self.silence()
            if self._reports_absence and not self._has_come and now_s > notice_s:
                self._reports_absence = False
                self._warn(
                    f"{self.where}: {self._seen()} yet; waiting up to {self.timeout_s:g} s (timeout-s)"
                )
            try:
                datagram, ancillary, _, _ = self._receiver.recvmsg(
                    DATAGRAM_BYTES, socket.CMSG_SPACE(OVERFLOWS.size)
                )
            except TimeoutError:
                continue
            self._datagrams += 1
            self._count_overflows(overflows(ancillary))
            if payload := self._packets.payload(datagram):
                self._begun_anew = self._next_stream.begun(payload)
                return payload[: max(0, len(payload) - len(self._begun_anew))]
        return b""

    def _count_overflows(self, total: int) -> None:
        if total and not self._overflowed:
            self._warn(
                f"{self.where}: datagrams come faster than they are read; allow a larger buffer with "
                f"sysctl net.core.rmem_max={RECEIVE_BUFFER_BYTES}"
            )
        self._counts["overflowed"] += max(0, total - self._overflowed)
        self._overflowed = max(self._overflowed, total)

    @override
    def absence(self) -> str:
        remedy = (
            "the sender must send MPEG-TS (GStreamer: mpegtsmux ! udpsink, FFmpeg: -f mpegts)"
            if self._datagrams
            else "check the sender's address and the firewall, or allow more time"
        )
        return f"{self._seen()}; {remedy}"

    def _seen(self) -> str:
        if self._datagrams:
            return f"{self._datagrams} datagrams have come to this port, none of them MPEG-TS"
        return "nothing has come to this port"

    @override
    def packets(self, container: InputContainer, streams: Sequence[Stream]) -> Iterator[Packet[Stream]]:
        """The packets until `cut`; raises `ConnectionLost` where the sender restarts."""
        self._next_stream.video_pid = self.video_of(container).id
        yield from super().packets(container, streams)
        if self._begun_anew:
            raise ConnectionLost(f"{self.where}: the sender has begun another stream")

    @override
    def close(self) -> None:
        if self._receiver is not None and not self._begun_anew:
            self._receiver.close()

    def leave(self) -> None:
        """Closes the port, for an input whose port no later one takes over."""
        if self._receiver is not None:
            self._receiver.close()

"""LiveInput, what a live connection reads: a URL that FFmpeg opens, or a transport stream received here."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from threading import Event
from urllib.parse import urlsplit

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream
from typing_extensions import override

from streamkit import ResourceError, mask_secrets
from streamkit_media.container import open_container, video_stream
from streamkit_media.failures import AccessRefused, ConnectionLost, Silence
from streamkit_media.live.accessunits import UNPARSED, whole_frames
from streamkit_media.live.reachability import port_of, unreachable
from streamkit_media.live.sockets import ConnectionSockets
from streamkit_media.streams import read_packets

# FFmpeg would otherwise read up to five seconds to guess the frame rate.
LIVE_OPTIONS = {"analyzeduration": "1500000", "fpsprobesize": "0"}
PLAYLIST = "hls"
ONE_CLIENT = ("tcp", "rtmp")  # a simple sender takes one client: a look at the port would take its place
MAX_PACE_S = 1.0  # a longer step of the decoding times is a jump


class LiveInput:
    """One connection, used once and by one thread; `cut` alone is called from others.

    Args:
        location: URL of the stream.
        timeout_s: limit for opening and for each read.
    """

    video_index: int | None = None  # of the stream whose video is read; none is FFmpeg's best

    def __init__(self, location: str, timeout_s: float) -> None:
        self.location, self.timeout_s = location, timeout_s
        self.where = mask_secrets(location)  # the location as it may be shown
        self.ended = threading.Event()  # set by `cut`

    def open(self) -> InputContainer:
        """Connects; raises `ResourceError` where that fails."""
        raise NotImplementedError

    def video_of(self, container: InputContainer) -> VideoStream:
        """The video that is read; raises `StreamError` where there is none."""
        return video_stream(container, self.location, self.video_index)

    def packets(self, container: InputContainer, streams: Sequence[Stream]) -> Iterator[Packet[Stream]]:
        """The packets of streams, the video first, until the end.

        Raises:
            StreamError: reading failed; a `ConnectionLost` says for itself what to do.
            TimedOut: nothing has come for the time limit.
        """
        raise NotImplementedError

    def cut(self) -> None:
        """Ends calls under way; may be called again and again until `close`."""
        self.ended.set()

    def close(self) -> None:
        """Releases what `open` has acquired apart from the container; called in any case."""


class UrlInput(LiveInput):
    """A connection to a server, with FFmpeg's `options` besides `LIVE_OPTIONS`."""

    def __init__(self, location: str, options: Mapping[str, str], timeout_s: float) -> None:
        super().__init__(location, timeout_s)
        self.options = {**LIVE_OPTIONS, **options}
        self.sockets = ConnectionSockets(port_of(location))

    @override
    def open(self) -> InputContainer:
        began = time.monotonic()
        try:
            return self.opened(self.options)
        except AccessRefused:
            raise
        except ResourceError as error:
            serves_one_client = urlsplit(self.location).scheme in ONE_CLIENT
            left_s = self.timeout_s - (time.monotonic() - began)
            if left_s <= 0 or self.ended.is_set() or serves_one_client:
                raise
            # FFmpeg often does not say why.
            reason = unreachable(self.location, self.options.get("ca_file"), left_s, "check the address")
            raise ResourceError(f"{self.where}: {reason}") if reason else error from None

    def opened(self, options: Mapping[str, str]) -> InputContainer:
        """Connects with these options."""
        if self.ended.is_set():
            raise ResourceError(f"{self.where}: the connection was ended from here")
        container = open_container(self.location, options, (self.timeout_s, self.timeout_s))
        self.sockets.claim()
        return container

    @override
    def packets(self, container: InputContainer, streams: Sequence[Stream]) -> Iterator[Packet[Stream]]:
        packets = read_packets(container, *streams)
        if container.format.name == PLAYLIST:  # a playlist says where the stream ends
            yield from paced(packets, self.ended)
            return
        yield from packets
        self.check_end()

    def check_end(self) -> None:
        """Raises `ConnectionLost` where the stream has ended because the server has closed the connection."""
        if self.sockets.is_closed_by_peer():
            raise ConnectionLost(
                f"{self.where}: the server has closed the connection; check that it still runs"
            )

    @override
    def cut(self) -> None:
        super().cut()
        self.sockets.cut()

    @override
    def close(self) -> None:
        self.sockets.release()


class TransportInput(LiveInput):
    """Base of connections whose transport stream is received here and demultiplexed by FFmpeg.

    Override `receive`.

    Args:
        location, timeout_s: see `LiveInput`.
        low_latency: take a PES packet for a frame, as FFmpeg's parser waits for the next one.
    """

    def __init__(self, location: str, timeout_s: float, *, low_latency: bool) -> None:
        super().__init__(location, timeout_s)
        self._low_latency = low_latency
        self._held = b""
        self._has_failed = self._has_come = False

    def receive(self) -> bytes:
        """The next bytes as soon as there are any; empty at the end, or once `cut` is called.

        Raises:
            Silence: nothing has come within the limit.
            ResourceError: there is no connection.
        """
        raise NotImplementedError

    def absence(self) -> str:
        """What there is in place of a transport stream while none has come, in words, and what to check."""
        raise NotImplementedError

    def silence(self) -> Silence:
        """The error for what `receive` has waited for in vain."""
        limit = f"{self.timeout_s:g} s (timeout-s)"
        if self._has_come:
            return Silence(
                f"{self.where}: nothing has come for {limit}; check the sender, or allow more time"
            )
        return Silence(f"{self.where}: no video within {limit}: {self.absence()}")

    @override
    def open(self) -> InputContainer:
        options = {**LIVE_OPTIONS, **UNPARSED} if self._low_latency else LIVE_OPTIONS
        return open_container(self.location, options, format_name="mpegts", stream=self)

    def read(self, size: int) -> bytes:
        """Up to `size` bytes for FFmpeg; raises as `receive`, once."""
        if self._has_failed:
            return b""  # FFmpeg reads on after an error, and PyAV has kept the first to raise it
        try:
            held = self._held or self.receive()
        except ResourceError:
            self._has_failed = True
            raise
        self._has_come |= bool(held)
        self._held = held[size:]
        return held[:size]

    @override
    def packets(self, container: InputContainer, streams: Sequence[Stream]) -> Iterator[Packet[Stream]]:
        packets = read_packets(container, *streams)
        return whole_frames(container, packets, self.video_of(container)) if self._low_latency else packets


def paced(
    packets: Iterator[Packet[Stream]], ended: Event, now_s: Callable[[], float] = time.monotonic
) -> Iterator[Packet[Stream]]:
    """Packets that arrive in bursts, as the segments of a playlist do, each when its decoding time has come.

    A packet that comes too late moves the times of all after it, so that they do not follow in a burst.

    Args:
        packets: of all streams, in the order of the container.
        ended: set to end a wait, and the packets.
        now_s: monotonic clock, s.
    """
    offset_s: float | None = None
    for packet in packets:
        if packet.dts is not None and packet.time_base:
            decoding_s, now = float(packet.dts * packet.time_base), now_s()
            if offset_s is None or not 0 <= decoding_s + offset_s - now <= MAX_PACE_S:
                offset_s = now - decoding_s
            elif ended.wait(decoding_s + offset_s - now):
                return
        yield packet

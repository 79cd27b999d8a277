"""A transport stream that is received here by other means than FFmpeg's, which demultiplexes it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

from av.container import Flags, InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream
from typing_extensions import override

from streamkit import ResourceError
from streamkit_media.container import open_container
from streamkit_media.live.accessunits import UNPARSED, AccessUnits, can_be_joined
from streamkit_media.live.liveinput import LIVE_OPTIONS, LiveInput

NO_PARSE = cast("int", Flags.no_parse.value)
# FFmpeg hands on a PES packet in pieces of 200 KB with its header, cut between transport packets.
FULL_PIECE_BYTES = 200 * 1024 - 184


class TransportInput(LiveInput):
    """Base of connections that receive a transport stream: override `receive`.

    Args:
        location, timeout_s: see `LiveInput`.
        low_latency: take a PES packet for a frame, as FFmpeg's parser waits for the next one.
    """

    def __init__(self, location: str, timeout_s: float, *, low_latency: bool) -> None:
        super().__init__(location, timeout_s)
        self._low_latency = low_latency
        self._held = b""
        self._has_failed = False

    def receive(self) -> bytes:
        """The next bytes as soon as there are any; empty at the end, or once `cut` is called.

        Raises:
            Silence: nothing has come within the limit.
            ResourceError: there is no connection.
        """
        raise NotImplementedError

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
        self._held = held[size:]
        return held[:size]

    def frames(
        self, container: InputContainer, packets: Iterator[Packet[Stream]]
    ) -> Iterator[Packet[Stream]]:
        """The packets of the container, those of the video a frame each."""
        return whole_frames(container, packets, self.video_of(container)) if self._low_latency else packets


def whole_frames(
    container: InputContainer, pieces: Iterator[Packet[Stream]], video: VideoStream
) -> Iterator[Packet[Stream]]:
    """The packets of a container opened with `UNPARSED`, in which a PES packet is a frame, or part of one.

    Where it is several, or the codec is not known here, FFmpeg's parser takes over.
    """
    if can_be_joined(video):
        units = AccessUnits(video, has_decoding_times=True)
        for piece in pieces:
            if piece.stream_index != video.index:
                yield piece
                continue
            yield from units.add(piece, is_marked=piece.size <= FULL_PIECE_BYTES)
            if units.has_several:
                yield from units.drain()
                break
    container.flags &= ~NO_PARSE
    yield from pieces

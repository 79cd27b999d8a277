"""Packets of a live connection: each picture as soon as its last piece has come, where that can be known."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit_media.codecs import stream_rate
from streamkit_media.packets import read_packets
from streamkit_media.rtsp.accessunits import KINDS, AccessUnits
from streamkit_media.rtsp.connections import duplicate
from streamkit_media.rtsp.rtpheads import HeadReader, is_marked, payload_bytes
from streamkit_media.streams import StreamKind

# FFmpeg hands out what each RTP packet carries.
PIECES = {"fflags": "+noparse"}
# A piece is its payload with start codes in place of fragment headers or sizes.
# A read that takes longer has waited for the network.
LEAST_WAIT_S = 0.001
LEAST_MORE_BYTES, MOST_MORE_BYTES = -3, 512


@dataclass(slots=True)
class LiveStreams:
    """Streams of a connection that are read.

    Attributes:
        container: FFmpeg's.
        streams: what to read of it, each with its kind.
        sockets: names of the connection's own, see `connections`.
    """

    container: InputContainer
    streams: Sequence[tuple[Stream, StreamKind]]
    sockets: frozenset[str]

    def packets(self) -> Iterator[tuple[int, Packet[Stream]]]:
        """Packets as FFmpeg's parsers make them, each with the index of its stream."""
        for packet in read_packets(self.container, *(stream for stream, _ in self.streams)):
            yield packet.stream_index, packet

    def joined(self, left_s: Callable[[], float]) -> Iterator[tuple[int, Packet[Stream]]]:
        """The same of a container opened with `PIECES`, without FFmpeg's wait for the next picture.

        Args:
            left_s: how long the next packet may be waited for before FFmpeg looks for it itself.
        """
        video = next(stream for stream, kind in self.streams if kind is StreamKind.VIDEO)
        units = AccessUnits(video.codec_context.name, _duration(video))
        for piece, is_last in self._marked(left_s):
            if piece.stream_index != video.index:
                yield piece.stream_index, piece
                continue
            for unit in units.add(piece, is_marked=is_last):
                yield video.index, unit
        for unit in units.flush():
            yield video.index, unit

    def _marked(self, left_s: Callable[[], float]) -> Iterator[tuple[Packet[Stream], bool]]:
        """Pieces, and whether each is known to be the last of its picture."""
        pieces = read_packets(self.container, *(stream for stream, _ in self.streams))
        connections = [connection for name in self.sockets if (connection := duplicate(name)) is not None]
        if len(connections) != 1:
            for connection in connections:
                connection.close()
            yield from ((piece, False) for piece in pieces)
            return
        with closing(HeadReader(connections[0])) as heads:
            # What FFmpeg took to learn of the stream it hands out first, without reading on or waiting.
            is_in_step, head = False, heads.look()
            while True:
                if is_in_step and not head:
                    head = heads.wait(left_s())
                began = time.monotonic()
                piece = next(pieces, None)
                if piece is None:
                    return
                following = heads.look()
                is_read = bool(head) and following != head
                is_in_step = is_in_step or is_read or time.monotonic() - began > LEAST_WAIT_S
                yield piece, is_read and _is_end(piece, head)
                head = following


def can_be_joined(stream: Stream) -> bool:
    """Whether the pictures of a stream can be put together here."""
    return stream.codec_context is not None and stream.codec_context.name in KINDS


def _is_end(piece: Packet[Stream], head: bytes) -> bool:
    """Whether a piece is what the packet with this head carried, and the last of its picture."""
    if not is_marked(head):
        return False
    return LEAST_MORE_BYTES <= piece.size - payload_bytes(head) <= MOST_MORE_BYTES


def _duration(stream: Stream) -> int:
    """Of a picture in the stream's time base; 0 if unknown."""
    rate = stream_rate(stream) if isinstance(stream, VideoStream) else None
    base = stream.time_base
    return round(1 / (rate * base)) if rate and base else 0

"""Joins FFmpeg's unparsed packets to frames, each as soon as its last RTP packet is read."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing

from av.packet import Packet
from av.stream import Stream

from streamkit_media.live.accessunits import AccessUnits
from streamkit_media.live.sockets import duplicate
from streamkit_media.rtsp.low_latency.rtpheaders import RtpHeaders, is_marked, payload_bytes

# A read that takes longer has waited for the network.
MIN_WAIT_S = 0.001
# A piece is its payload with start codes instead of fragment headers or sizes: so many bytes longer.
MIN_MORE_BYTES, MAX_MORE_BYTES = -3, 512


def complete_frames(
    pieces: Iterator[Packet[Stream]],
    video: Stream,
    duration: int,
    sockets: frozenset[str],
    left_s: Callable[[], float],
) -> Iterator[Packet[Stream]]:
    """The packets of a container opened with `UNPARSED`.

    Args:
        pieces: its packets.
        video: the stream whose pieces are joined; others pass.
        duration: of a frame in the stream's time base; 0 if unknown.
        sockets: names of the connection's own sockets, see `live.sockets`.
        left_s: how long the next packet may be waited for before FFmpeg reads on itself.
    """
    units = AccessUnits(video.codec_context.name, duration)
    for piece, is_last in _marked(pieces, sockets, left_s):
        if piece.stream_index != video.index:
            yield piece
            continue
        for unit in units.add(piece, is_marked=is_last):
            unit.stream = video
            yield unit
    for unit in units.flush():
        unit.stream = video
        yield unit


def _marked(
    pieces: Iterator[Packet[Stream]], sockets: frozenset[str], left_s: Callable[[], float]
) -> Iterator[tuple[Packet[Stream], bool]]:
    """Pieces, and whether each is known to be the last of its frame."""
    connections = [connection for name in sockets if (connection := duplicate(name)) is not None]
    if len(connections) != 1:
        for connection in connections:
            connection.close()
        yield from ((piece, False) for piece in pieces)
        return
    with closing(RtpHeaders(connections[0])) as headers:
        # FFmpeg first returns the packets that it has read to detect the stream, without reading on.
        is_in_step, header = False, headers.peek()
        while True:
            if is_in_step and not header:
                header = headers.wait(left_s())
            began = time.monotonic()
            piece = next(pieces, None)
            if piece is None:
                return
            following = headers.peek()
            is_read = bool(header) and following != header
            is_in_step = is_in_step or is_read or time.monotonic() - began > MIN_WAIT_S
            yield piece, is_read and _is_end(piece, header)
            header = following


def _is_end(piece: Packet[Stream], header: bytes) -> bool:
    """Whether a piece is the payload of the packet with this header, and the last of its frame."""
    more = piece.size - payload_bytes(header) if header else 0
    return is_marked(header) and MIN_MORE_BYTES <= more <= MAX_MORE_BYTES

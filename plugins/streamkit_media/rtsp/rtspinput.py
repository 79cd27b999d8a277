"""A connection to an RTSP server, over TCP with the end of each frame taken from RTP.

RTP marks the last packet of a frame, but FFmpeg does not pass the mark on. The header of the next packet is
read in the socket's buffer (Linux) before FFmpeg takes the packet, unless `low-latency=false`.

Source: RFC 2326, 10.12 (RTP interleaved in the connection); RFC 3550, 5.1 (RTP header).
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from urllib.parse import urlsplit

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from typing_extensions import override

from streamkit_media.failures import InvalidMedia, UnsupportedMedia
from streamkit_media.live.accessunits import UNPARSED, AccessUnits, can_be_joined
from streamkit_media.live.liveinput import UrlInput
from streamkit_media.streams import read_packets

VP9_PROFILE_3 = 0x30  # its two bits; a reserved bit follows them
JPEG_FRAME_HEADER, JPEG_SIZE_AT = b"\xff\xc0", 5  # then its length and depth, and height and width
TOO_LARGE_JPEG = (
    "its JPEG pictures are wider or higher than 2040 pixels, for which RTP has no field (RFC 2435); set the "
    "camera to a smaller size, or to H.264 or H.265"
)
MAGIC, VERSION = ord("$"), 2
FRAME_BYTES, HEADER_BYTES, EXTENSION_HEADER_BYTES = 4, 12, 4  # before each packet: "$", the channel, the size
MARKER, EXTENSION, SOURCES = 0x80, 0x10, 0x0F
# Second byte of RTCP packets (RFC 5761, 4).
FIRST_RTCP, LAST_RTCP = 192, 223
PEEK_BYTES = 2048
PEEK = int(socket.MSG_PEEK | socket.MSG_DONTWAIT)
AFTER_RTCP_TRIES, AFTER_RTCP_S = 3, 0.001  # waits for what follows an RTCP packet
# A read that takes longer has waited for the network.
MIN_WAIT_S = 0.001
# A piece is its payload with start codes instead of fragment headers or sizes: so many bytes longer.
MIN_MORE_BYTES, MAX_MORE_BYTES = -3, 512


class RtspInput(UrlInput):
    """A connection to an RTSP server.

    Args:
        location, timeout_s: see `LiveInput`.
        options: FFmpeg options for it, `rtsp_transport` among them.
        low_latency: read the ends of frames from RTP where possible.
    """

    def __init__(
        self, location: str, options: Mapping[str, str], timeout_s: float, *, low_latency: bool = True
    ) -> None:
        super().__init__(location, options, timeout_s)
        self._low_latency = low_latency
        # RTP packets can be peeked at on a TCP connection without TLS only.
        self._has_marks = urlsplit(location).scheme == "rtsp" and options.get("rtsp_transport") == "tcp"
        self._is_in_pieces = False

    @override
    def opened(self, options: Mapping[str, str]) -> InputContainer:
        if self._low_latency:
            # Only FFmpeg's parsers find parameter sets that the server does not send in advance.
            with suppress(InvalidMedia):
                container = super().opened({**options, **UNPARSED})
                try:
                    self._is_in_pieces = can_be_joined(self.video_of(container))
                finally:
                    if not self._is_in_pieces:
                        container.close()
                if self._is_in_pieces:
                    return container
        return super().opened(options)

    @override
    def packets(self, container: InputContainer, streams: Sequence[Stream]) -> Iterator[Packet[Stream]]:
        video = self.video_of(container)
        if not self._is_in_pieces:
            codec = video.codec_context.name
            for packet in super().packets(container, streams):
                if codec == "vp9" and packet.stream_index == video.index:
                    packet.is_keyframe = is_vp9_keyframe(memoryview(packet))
                elif codec == "mjpeg" and packet.stream_index == video.index and has_no_size(bytes(packet)):
                    raise UnsupportedMedia(f"{self.where}: {TOO_LARGE_JPEG}")
                yield packet
            return
        units = AccessUnits(video)
        for piece, is_last in self._marked(read_packets(container, *streams)):
            if piece.stream_index == video.index:
                yield from units.add(piece, is_marked=is_last)
            else:
                yield piece
        yield from units.drain()
        self.check_end()

    def _marked(self, pieces: Iterator[Packet[Stream]]) -> Iterator[tuple[Packet[Stream], bool]]:
        connection = self.sockets.duplicate() if self._has_marks else None
        if connection is None:
            return ((piece, False) for piece in pieces)
        return with_marks(pieces, connection, self.timeout_s)


@dataclass(frozen=True, slots=True)
class RtpHeader:
    """The header of an RTP packet."""

    data: bytes  # the header's bytes, which tell packets apart
    is_marked: bool  # whether the packet is the last of its frame
    payload_bytes: int  # size of the payload, padding included


def peek(connection: socket.socket) -> RtpHeader | None:
    """The header of the next RTP packet on a connection, after any RTCP packets; None where none has come."""
    try:
        return first_header(connection.recv(PEEK_BYTES, PEEK))
    except OSError:  # nothing there, or the connection is closed: FFmpeg reports that
        return None


def wait_for_header(connection: socket.socket, limit_s: float) -> RtpHeader | None:
    """Waits for data, then does as `peek`; None at the end of the stream, too."""
    # A server with Nagle's algorithm sends the last small segment of a frame only when the others are
    # acknowledged, which this side would delay. The option does not stay set.
    with suppress(OSError):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
    poll = select.poll()
    poll.register(connection.fileno(), select.POLLIN)
    if not poll.poll(limit_s * 1000):
        return None
    for _ in range(AFTER_RTCP_TRIES):
        if (header := peek(connection)) is not None:
            return header
        time.sleep(AFTER_RTCP_S)
    return peek(connection)


def first_header(data: bytes) -> RtpHeader | None:
    """The header of the first RTP packet, after any RTCP packets; None where it is incomplete."""
    while len(data) >= FRAME_BYTES + HEADER_BYTES and data[0] == MAGIC:
        size, first, second = int.from_bytes(data[2:4], "big"), data[FRAME_BYTES], data[FRAME_BYTES + 1]
        if FIRST_RTCP <= second <= LAST_RTCP:
            data = data[FRAME_BYTES + size :]
            continue
        is_extended = bool(first & EXTENSION)
        header_bytes = HEADER_BYTES + 4 * (first & SOURCES)
        header_bytes += EXTENSION_HEADER_BYTES if is_extended else 0
        header = data[: FRAME_BYTES + header_bytes]
        if first >> 6 != VERSION or len(header) < FRAME_BYTES + header_bytes:
            return None
        extension_bytes = 4 * int.from_bytes(header[-2:], "big") if is_extended else 0
        return RtpHeader(header, bool(second & MARKER), size - header_bytes - extension_bytes)
    return None


def with_marks(
    pieces: Iterator[Packet[Stream]], connection: socket.socket, limit_s: float
) -> Iterator[tuple[Packet[Stream], bool]]:
    """Pieces, and whether each is known to be the last of its frame.

    Args:
        pieces: packets of a container opened without FFmpeg's parser.
        connection: a duplicate of its socket; is closed.
        limit_s: longest wait for a header, before FFmpeg reads on itself.
    """
    with connection:
        # FFmpeg first returns the packets that it has read to detect the stream, without reading on.
        is_in_step, header = False, peek(connection)
        while True:
            if is_in_step and header is None:
                header = wait_for_header(connection, limit_s)
            began = time.monotonic()
            piece = next(pieces, None)
            if piece is None:
                return
            following = peek(connection)
            is_read = header is not None and following != header
            is_in_step = is_in_step or is_read or time.monotonic() - began > MIN_WAIT_S
            is_last = is_read and header is not None and header.is_marked
            more = piece.size - header.payload_bytes if header is not None else 0
            yield piece, is_last and MIN_MORE_BYTES <= more <= MAX_MORE_BYTES
            header = following


def is_vp9_keyframe(data: bytes | memoryview) -> bool:
    """Whether decoding can begin with a packet of VP9, which FFmpeg does not tell of what it receives.

    Source: VP9 Bitstream and Decoding Process Specification 0.6, 6.2 (uncompressed header).
    """
    if not len(data):
        return False
    first = data[0] << (data[0] & VP9_PROFILE_3 == VP9_PROFILE_3)
    shows_existing_frame, is_inter_frame = first & 0x08, first & 0x04
    return not (shows_existing_frame or is_inter_frame)


def has_no_size(jpeg: bytes) -> bool:
    """Whether a JPEG picture says 0 pixels, as where its size does not fit into RTP.

    Source: ITU-T T.81, B.2.2 (frame header); RFC 2435, 3.1.5 (width and height in blocks of 8, up to 255).
    """
    at = jpeg.find(JPEG_FRAME_HEADER)
    size = jpeg[at + JPEG_SIZE_AT : at + JPEG_SIZE_AT + 4]
    return at >= 0 and len(size) == 4 and b"\0\0" in (size[:2], size[2:])

"""A connection to an RTSP server, over TCP with the end of each frame taken from RTP."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from urllib.parse import urlsplit

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from typing_extensions import override

from streamkit_media.container import InvalidMedia, video_stream
from streamkit_media.live.accessunits import UNPARSED, AccessUnits, can_be_joined
from streamkit_media.live.urlinput import UrlInput
from streamkit_media.packets import read_packets
from streamkit_media.rtsp.rtpheaders import with_marks


class RtspInput(UrlInput):
    """A connection to an RTSP server.

    Args:
        location: URL of the stream.
        options: FFmpeg options for it, `rtsp_transport` among them.
        timeout_s: limit for opening and for each read.
        low_latency: read the ends of frames from RTP where possible, see `rtsp.rtpheaders`.
    """

    def __init__(
        self, location: str, options: Mapping[str, str], timeout_s: float, *, low_latency: bool = True
    ) -> None:
        super().__init__(location, options, timeout_s)
        # RTP packets can be peeked at on a TCP connection without TLS only.
        is_plain = urlsplit(location).scheme == "rtsp" and options.get("rtsp_transport") == "tcp"
        self._low_latency = low_latency and is_plain
        self._is_in_pieces = False

    @override
    def opened(self, options: Mapping[str, str]) -> InputContainer:
        if self._low_latency:
            # Only FFmpeg's parsers find parameter sets that the server does not send in advance.
            with suppress(InvalidMedia):
                container = super().opened({**options, **UNPARSED})
                try:
                    self._is_in_pieces = can_be_joined(video_stream(container, self.location))
                finally:
                    if not self._is_in_pieces:
                        container.close()
                if self._is_in_pieces:
                    return container
        return super().opened(options)

    @override
    def packets(self, container: InputContainer, streams: Sequence[Stream]) -> Iterator[Packet[Stream]]:
        if not self._is_in_pieces:
            yield from super().packets(container, streams)
            return
        video = video_stream(container, self.location)
        units = AccessUnits(video)
        for piece, is_last in self._marked(read_packets(container, *streams)):
            if piece.stream_index == video.index:
                yield from units.add(piece, is_marked=is_last)
            else:
                yield piece
        yield from units.flush()
        self.check_end()

    def _marked(self, pieces: Iterator[Packet[Stream]]) -> Iterator[tuple[Packet[Stream], bool]]:
        connection = self.sockets.duplicate()
        if connection is None:
            return ((piece, False) for piece in pieces)
        return with_marks(pieces, connection, self.timeout_s)

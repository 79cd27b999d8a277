"""A connection to an RTSP server, over TCP with the end of each frame taken from RTP."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from urllib.parse import urlsplit

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from typing_extensions import override

from streamkit_media.container import InvalidMedia, video_stream
from streamkit_media.live.accessunits import UNPARSED, can_be_joined, frame_duration
from streamkit_media.live.urlinput import UrlInput
from streamkit_media.packets import read_packets
from streamkit_media.rtsp.low_latency.completeframes import complete_frames


class RtspInput(UrlInput):
    """A connection to an RTSP server.

    Args:
        location: URL of the stream.
        options: FFmpeg options for it, `rtsp_transport` among them.
        timeout_s: limit for opening and for each read.
        low_latency: read the ends of frames from RTP where possible, see `rtsp.low_latency`.
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
                self._is_in_pieces = _can_be_joined(container, self.location)
                if self._is_in_pieces:
                    return container
        return super().opened(options)

    @override
    def packets(
        self, container: InputContainer, streams: Sequence[Stream], left_s: Callable[[], float]
    ) -> Iterator[Packet[Stream]]:
        if not self._is_in_pieces:
            yield from super().packets(container, streams, left_s)
            return
        video = video_stream(container, self.location)
        pieces = read_packets(container, *streams)
        yield from complete_frames(pieces, video, frame_duration(video), self.sockets, left_s)
        self.check_end()


def _can_be_joined(container: InputContainer, location: str) -> bool:
    """Whether frames of the container can be joined here; closes it otherwise."""
    found = False
    try:
        found = can_be_joined(video_stream(container, location))
    finally:
        if not found:
            container.close()
    return found

"""filesrc: the video of a file, as coded packets."""

from __future__ import annotations

from collections.abc import Iterator

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit import Caps, Frame, Property, ResourceError, Source, StreamError
from streamkit_decoder.codecs import CODED_CAPS, coded_caps, stream_parameters, stream_rate
from streamkit_decoder.container import MEDIA_ERRORS, open_container, reason_of, video_stream
from streamkit_decoder.location import redact
from streamkit_decoder.packets import DECODE_ONLY, DecodeOnly, packet_frame, read_packets


class FileSrc(Source):
    """Reads the video of any file FFmpeg knows, film or still picture, as coded packets.

    Times are the file's own, exact to the nanosecond.

    Example:
        filesrc location=flight.mp4 ! decode ! fakesink
    """

    src = CODED_CAPS

    location: str = Property("", doc="Path or URL of the file.")
    start_s: float = Property(
        0.0, min=0.0, unit="s", doc="First picture shown, from the beginning of the video."
    )
    stop_s: float | None = Property(
        None, min=0.0, unit="s", doc="End, from the beginning of the video; none is its own."
    )

    def start(self) -> None:
        """Opens the file, so that a bad one is known before anything plays."""
        self._container: InputContainer | None = None
        if not self.location:
            raise ResourceError("location= must name a file, it is empty; write filesrc location=flight.mp4")
        if self.stop_s is not None and self.stop_s <= self.start_s:
            raise ResourceError(f"stop-s= must be after start-s={self.start_s:g}, got {self.stop_s:g}")
        container = open_container(self.location)
        try:
            self._stream = video_stream(container, self.location)
            self._caps = coded_caps(stream_parameters(self._stream), stream_rate(self._stream))
        except BaseException:
            container.close()
            raise
        self._container = container

    def negotiate(self, allowed: Caps) -> Caps | None:
        """What the file holds."""
        return self._caps

    def frames(self) -> Iterator[Frame]:
        """The packets in decoding order.

        Raises:
            StreamError: not one packet could be read.
        """
        # From here on this thread alone uses the file, and closes it: FFmpeg does not bear two threads.
        container, self._container = self._container, None
        assert container is not None
        with container:
            yield from self._packets(container, self._stream)

    def _packets(self, container: InputContainer, stream: VideoStream) -> Iterator[Frame]:
        if self.start_s:
            self._seek(container, stream)
        where, count, shown = redact(self.location), 0, 0
        try:
            for packet in read_packets(container, stream):
                frame = self._in_range(packet, stream)
                if frame is None:
                    break
                count += 1
                shown += frame.get(DecodeOnly) is None
                yield frame
        except StreamError as error:
            if not count:
                raise StreamError(f"{where}: {error}; the file is damaged or cut short") from None
            self.post_warning(f"{where}: {error} after {count} packets; ending there")
        if shown:
            return
        if self.start_s:
            self.post_warning(f"{where}: there is no picture from start-s={self.start_s:g} on")
            return
        fault = (
            "the file's own edit list shows none of its pictures" if count else "the video holds no packets"
        )
        raise StreamError(f"{where}: {fault}; the file is damaged or cut short")

    def stop(self) -> None:
        """Closes the file if its packets were never asked for."""
        if self._container is not None:
            self._container.close()
            self._container = None

    def _seek(self, container: InputContainer, stream: VideoStream) -> None:
        """Goes to the key frame at or before `start_s`."""
        try:
            container.seek(_first_tick(stream) + _ticks(self.start_s, stream), stream=stream)
        except MEDIA_ERRORS as error:
            raise StreamError(
                f"{redact(self.location)}: start-s={self.start_s:g} cannot be reached: {reason_of(error)}; "
                "this format may not allow seeking"
            ) from None

    def _in_range(self, packet: Packet[Stream], stream: VideoStream) -> Frame | None:
        """The packet as a frame, marked where only others need it; None once all that follow are too late."""
        frame = packet_frame(packet, self._caps)
        if not self.start_s and self.stop_s is None:
            return frame
        first = _first_tick(stream)
        shown = packet.pts if packet.pts is not None else packet.dts
        if shown is None:
            return frame
        if self.stop_s is not None:
            end = first + _ticks(self.stop_s, stream)
            decoded = packet.dts if packet.dts is not None else shown
            if decoded >= end:
                return None
            if shown >= end:
                return frame.attach(DECODE_ONLY)
        return frame.attach(DECODE_ONLY) if shown < first + _ticks(self.start_s, stream) else frame


def _first_tick(stream: VideoStream) -> int:
    return stream.start_time or 0


def _ticks(seconds: float, stream: VideoStream) -> int:
    return round(seconds / stream.time_base) if stream.time_base else 0

"""filesrc: the streams of a file, as coded packets."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

from av.container import InputContainer
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit import (
    SECOND_NS,
    Caps,
    Direction,
    EosEvent,
    Frame,
    PadTemplate,
    Presence,
    Property,
    ResourceError,
    Source,
    StreamError,
    mask_secrets,
)
from streamkit.output.names import is_network, local_path
from streamkit_media.codecs import CODED_CAPS
from streamkit_media.container import check_file, display_rotation, open_container, video_stream
from streamkit_media.failures import MEDIA_ERRORS, reason_of
from streamkit_media.files.completeness import Completeness
from streamkit_media.live.addresses import LIVE_SCHEMES, RTSP_SCHEMES, port_of
from streamkit_media.live.sockets import ConnectionSockets
from streamkit_media.streams import (
    AUDIO_CAPS,
    BARE_PACKETS,
    DECODE_ONLY,
    KLV_CAPS,
    SUBTITLE_CAPS,
    DecodeOnly,
    StreamKind,
    kinds_of,
    packet_frame,
    read_packets,
    stream_caps,
    streams_of,
)
from streamkit_telemetry_formats.klv import holds_klv

PAD_CAPS = {
    StreamKind.VIDEO: CODED_CAPS,
    StreamKind.KLV: KLV_CAPS,
    StreamKind.SECOND_KLV: KLV_CAPS,
    StreamKind.SUBTITLE: SUBTITLE_CAPS,
    StreamKind.AUDIO: AUDIO_CAPS,
}
CUT_LIMIT_S, CUT_EVERY_S = 1.0, 0.02
# FFmpeg takes bare KLV packets for any other format.
KLV_CONTAINERS = frozenset({"mpegts", "mpeg", "mxf", "mov", "matroska", "avi"})


class FileSrc(Source):
    """Reads any file FFmpeg knows, video or image, as coded packets.

    The video comes out of `src`, or of `video` with `klv` and `klv_1` (first and second stream of MISB
    telemetry), `subtitle` (DJI telemetry) and `audio`, where the file has them. Times are the file's own,
    exact to the nanosecond. A file of bare KLV packets has none: they come out of `klv` without times. Video
    that ends before the end that its container declares is warned of, as a shortfall: the file is cut short.

    Example:
        filesrc location=flight.mp4 ! decode ! fakesink
    """

    src = CODED_CAPS
    templates = tuple(
        PadTemplate(kind.value, Direction.SRC, Caps(caps), Presence.SOMETIMES)
        for kind, caps in PAD_CAPS.items()
    )

    location: str = Property("", file="read", doc="Path or URL of the file.")
    start_s: float = Property(
        0.0, min=0.0, unit="s", doc="First frame shown, from the beginning of the video."
    )
    stop_s: float | None = Property(
        None, min=0.0, unit="s", doc="End, from the beginning of the video; none is its own."
    )
    loop: bool = Property(False, doc="Repeat forever; times continue.")

    _is_opening = False
    _duration: int | None = None
    _sockets: ConnectionSockets | None = None

    def start(self) -> None:
        """Looks into the file, so that a bad one fails before playing."""
        self._where = mask_secrets(self.location)
        self._sockets = None
        self._check_properties()
        if is_network(self.location):
            try:
                self._sockets = ConnectionSockets(port_of(self.location))
            except ValueError as error:
                raise ResourceError(f"{error}, got {self._where!r}") from None
        self._caps: dict[StreamKind, Caps] = {}
        self._offset = self._end = 0
        self._rotation = 0
        with self._open() as container:
            self._kinds, self._duration = kinds_of(container), container.duration
            if self._video_is_wanted():
                video = video_stream(container, self.location)
                self._rotation = display_rotation(container, video)
                self._packet_caps(video, StreamKind.VIDEO)

    def _check_properties(self) -> None:
        scheme = self.location.partition("://")[0].lower()
        if scheme in (*LIVE_SCHEMES, *RTSP_SCHEMES):
            source = "rtspsrc location=" if scheme in RTSP_SCHEMES else "livesrc uri="
            raise ResourceError(f"{self._where}: this is live video and no file; write {source}{self._where}")
        if not self.location:
            raise ResourceError("location= must name a file, it is empty; write filesrc location=flight.mp4")
        if self.stop_s is not None and self.stop_s <= self.start_s:
            raise ResourceError(f"stop-s= must be after start-s={self.start_s:g}, got {self.stop_s:g}")

    def _open(self) -> InputContainer:
        """The container; for bare KLV packets FFmpeg needs the format's name."""
        self._is_opening, may_be_bare = True, False
        try:
            if not is_network(self.location):
                check_file(self.location)
                may_be_bare = holds_klv(local_path(self.location))
            try:
                container = open_container(self.location)
            except StreamError:
                if not may_be_bare:
                    raise
            else:
                if not may_be_bare or KLV_CONTAINERS & set(container.format.name.split(",")):
                    return container
                container.close()
            return open_container(self.location, format_name=BARE_PACKETS)
        finally:
            self._is_opening = False

    def duration_ns(self) -> int | None:
        """Duration of the part that is played."""
        if self.loop or self._duration is None:
            return None
        end_s = self._duration / 1e6 if self.stop_s is None else min(self.stop_s, self._duration / 1e6)
        return max(0, round((end_s - self.start_s) * SECOND_NS))

    def negotiate(self, allowed: Caps) -> Caps | None:
        """The caps of the file's video."""
        return self._caps.get(StreamKind.VIDEO)

    def frames(self) -> Iterator[Frame | tuple[str, Frame]]:
        """The packets in the file's order.

        Raises:
            StreamError: not one packet could be read.
        """
        self._add_pads()
        while True:
            try:
                container = self._open()
            except ResourceError:
                if self.over.is_set():  # `interrupt` has cut the connection
                    return
                raise
            with container:
                yield from self._play_once(container)
            if not self.loop or self._end <= self._offset:
                return
            self._offset = self._end

    def interrupt(self) -> None:
        """Cuts a connection that is being opened or read."""
        super().interrupt()
        if self._sockets is None:
            return
        deadline_s = time.monotonic() + CUT_LIMIT_S
        self._sockets.cut()
        while self._is_opening and time.monotonic() < deadline_s:  # it may just begin, or try again
            time.sleep(CUT_EVERY_S)
            self._sockets.cut()

    # Pads.

    def _add_pads(self) -> None:
        for kind in StreamKind:
            if kind in self._kinds and kind.value not in self.pads:
                self.add_pad(kind.value)
            elif kind not in self._kinds and self._is_linked(kind.value):
                self.post_warning(f"{self._where}: it holds no stream for the pad {kind.value}", "shortfall")
                self.pads[kind.value].send_event(EosEvent())
        self.no_more_pads()
        second = StreamKind.SECOND_KLV
        if self._is_linked("klv") and second in self._kinds and not self._is_linked(second.value):
            self.post_warning(f"{self._where}: nothing reads its second KLV stream, the pad {second}")

    def _video_is_wanted(self) -> bool:
        """Whether the video has a pad, or might get one; not where there are other streams only."""
        return self._is_linked("src") or StreamKind.VIDEO in self._kinds or not self._kinds

    def _is_linked(self, name: str) -> bool:
        return name in self.pads and self.pads[name].peer is not None

    def _packet_caps(self, stream: Stream, kind: StreamKind) -> Caps:
        """The stream's caps; the same object while they are equal, which saves comparing them."""
        caps = stream_caps(stream, kind)
        if kind is StreamKind.VIDEO and self._rotation:
            caps = caps.with_fields(rotation=self._rotation)
        if self._caps.get(kind) != caps:
            self._caps[kind] = caps
        return self._caps[kind]

    # One round through the file.

    def _play_once(self, container: InputContainer) -> Iterator[Frame | tuple[str, Frame]]:
        """The frames of the linked pads; an error where none is shown, a warning where some are."""
        wanted = {kind for kind in self._kinds if self._is_linked(kind.value)}
        uses_src_pad = self._is_linked("src") or not wanted
        streams = streams_of(container, wanted | ({StreamKind.VIDEO} if uses_src_pad else set()))
        where, count, shown = self._where, 0, 0
        if not streams:
            raise StreamError(f"{where}: none of its streams is linked")
        self._seek(container, streams[0][0])
        video = next((stream for stream, _ in streams if isinstance(stream, VideoStream)), None)
        completeness = (
            Completeness(container, video, self.start_s, self.stop_s) if video is not None else None
        )
        try:
            for kind, frame in self._in_range(container, streams, completeness):
                count += 1
                shown += frame.get(DecodeOnly) is None
                if kind in wanted:
                    yield kind.value, frame
                if kind is StreamKind.VIDEO and uses_src_pad:
                    yield frame
        except StreamError as error:
            if self.stopping.is_set():
                return
            if not count:
                raise StreamError(f"{where}: {error}; the file is damaged or cut short") from None
            self.post_warning(f"{where}: {error} after {count} packets; ending there")
        cut = "" if completeness is None or self._offset else completeness.shortfall()
        self._report_end(cut, count, shown)

    def _report_end(self, cut: str, count: int, shown: int) -> None:
        """Warns of what is missing at the end of a round; an error where no frame was shown at all."""
        if cut and (shown or self.start_s):
            self.post_warning(f"{self._where}: {cut}", "shortfall")
            self.post_message("cut-short", text=cut)
        elif not shown and self.start_s:
            length = "" if self._duration is None else f"; it is {self._duration / 1e6:.1f} s long"
            self.post_warning(
                f"{self._where}: there is no frame from start-s={self.start_s:g} on{length}", "shortfall"
            )
        elif not shown:
            fault = (
                "the file's own edit list shows none of its frames" if count else "the video holds no packets"
            )
            raise StreamError(f"{self._where}: {fault}; the file is damaged or cut short")

    def _in_range(
        self,
        container: InputContainer,
        streams: list[tuple[Stream, StreamKind]],
        completeness: Completeness | None,
    ) -> Iterator[tuple[StreamKind, Frame]]:
        """Frames with their kinds; video outside of the range is for decoding only."""
        carried = {stream.index: (kind, self._packet_caps(stream, kind)) for stream, kind in streams}
        limits = {stream.index: self._limits(stream) for stream, _ in streams}
        playing, latest = set(carried), None
        for packet in read_packets(container, *(stream for stream, _ in streams)):
            decoded = packet.dts if packet.dts is not None else packet.pts
            shown = packet.pts if packet.pts is not None else decoded
            begin, end = limits[packet.stream_index]
            if completeness is not None:
                completeness.add(packet)
            if decoded is not None and end is not None and decoded >= end:
                playing.discard(packet.stream_index)
                if not playing:
                    return
                continue
            is_inside = shown is None or (begin <= shown and (end is None or shown < end))
            kind, caps = carried[packet.stream_index]
            frame = packet_frame(packet, caps)
            if frame.pts is not None:
                pts = frame.pts + self._offset
                self._end = max(self._end, pts + (frame.duration or 0))
                frame = frame.replace(pts=pts) if self._offset else frame
                latest = pts if kind is StreamKind.VIDEO else latest
            elif latest is not None and kind is not StreamKind.VIDEO:
                frame = frame.replace(pts=latest)  # asynchronous KLV gets the time of the video around it
            if is_inside:
                yield kind, frame
            elif kind is StreamKind.VIDEO:
                yield kind, frame.attach(DECODE_ONLY)

    def _limits(self, stream: Stream) -> tuple[float, int | None]:
        """The first tick of a stream that is shown, and the first that is not any more."""
        begin = _tick(self.start_s, stream) if self.start_s else -math.inf
        return begin, None if self.stop_s is None else _tick(self.stop_s, stream)

    def _seek(self, container: InputContainer, stream: Stream) -> None:
        """Goes to the keyframe at or before the start."""
        if not self.start_s:
            return
        try:
            container.seek(_tick(self.start_s, stream), stream=stream)
        except MEDIA_ERRORS as error:
            raise StreamError(
                f"{self._where}: start-s={self.start_s:g} cannot be reached: {reason_of(error)}; "
                "this format may not allow seeking"
            ) from None


def _tick(seconds: float, stream: Stream) -> int:
    """A time from the beginning of the video, in a stream's ticks; other streams count from there too."""
    video = next((s for s in stream.container.streams if isinstance(s, VideoStream)), stream)
    start = video.start_time or 0
    if not stream.time_base or not video.time_base:
        return start
    return round(start * video.time_base / stream.time_base) + round(seconds / stream.time_base)

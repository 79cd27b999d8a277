"""filesrc: the streams of a file, as coded packets."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Generator, Iterator, Sequence

from av.container import InputContainer
from av.stream import Stream

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
from streamkit_media.container import (
    check_file,
    display_orientation,
    open_container,
    other_videos,
    unread_remedy,
    video_stream,
)
from streamkit_media.files.completeness import holds_second_recording
from streamkit_media.files.file_part import FilePart, Joint
from streamkit_media.live.reachability import LIVE_SCHEMES, RTSP_SCHEMES, port_of
from streamkit_media.live.sockets import ConnectionSockets
from streamkit_media.streams import (
    AUDIO_CAPS,
    BARE_PACKETS,
    KLV_CAPS,
    SUBTITLE_CAPS,
    DecodeOnly,
    StreamKind,
    kinds_of,
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
JOINTS_LOOKED_AT = 10
SECOND_RECORDING = (
    "another recording is appended to it, and is not read; join MP4 files with ffmpeg -f concat, or read "
    "them one by one"
)
CUT_LIMIT_S, CUT_EVERY_S = 1.0, 0.02
# FFmpeg takes bare KLV packets for any other format.
KLV_CONTAINERS = frozenset({"mpegts", "mpeg", "mxf", "mov", "matroska", "avi"})


class FileSrc(Source):
    """Reads any file FFmpeg knows, video or image, as coded packets.

    The video comes out of `src`, or of `video` with `klv` and `klv_1` (first and second stream of MISB
    telemetry), `subtitle` (DJI telemetry) and `audio`, where the file has them. Of several videos FFmpeg's
    best is read, and a warning names the others, unless `video-stream` chooses one. Times are the file's own,
    exact to the nanosecond; where they go back, as where recordings are joined, they continue, with a
    warning. `start-s` goes by the file's own times: `filesrc ! packetsink` first makes a copy whose times
    ascend. Times that the container stores in order of coding, as writers do that know no B-frames, are put
    in order of presentation. A file of bare KLV packets has none: they come out of `klv` without times. Video
    that ends before the end that its container declares, or a JPEG within its picture, is warned of, as a
    shortfall: the file is cut short. The frame of that JPEG is `CORRUPT`.

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
    video_stream: int | None = Property(
        None, min=0, doc="Number of the stream whose video is read, from 0; none is FFmpeg's best."
    )

    _is_opening = False
    _begin_ns = 0
    _duration_us: int | None = None
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
        self._orientation: dict[str, int | bool] = {}
        self.unread_videos: list[int] = []  # streams of further videos, unless one is chosen
        with self._open() as container:
            if not is_network(self.location) and holds_second_recording(self.location):
                self.post_warning(f"{self._where}: {SECOND_RECORDING}", "shortfall")
            self._kinds, self._duration_us = kinds_of(container), container.duration
            if self._video_is_wanted():
                video = video_stream(container, self.location, self.video_stream)
                self._orientation = display_orientation(container, video)
                self._begin_ns = round((video.start_time or 0) * (video.time_base or 0) * SECOND_NS)
                self._packet_caps(video, StreamKind.VIDEO)
                if self.video_stream is None:
                    self.unread_videos = other_videos(container, video)
                if self.unread_videos:
                    self.post_warning(
                        f"{self._where}: video stream {video.index} is read, "
                        + unread_remedy(self.unread_videos)
                    )

    def query_begin_ns(self) -> int:
        """Time of the first frame of the video."""
        return self._begin_ns

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
        if self.loop or self._duration_us is None:
            return None
        end_s = self._duration_us / 1e6 if self.stop_s is None else min(self.stop_s, self._duration_us / 1e6)
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
        end_ns = 0
        while True:
            begin_ns = end_ns
            try:
                container = self._open()
            except ResourceError:
                if self.over.is_set():  # `interrupt` has cut the connection
                    return
                raise
            with container:
                end_ns = yield from self._play_once(container, begin_ns)
            if not self.loop or end_ns <= begin_ns:
                return

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
            elif kind not in self._kinds and self.is_linked(kind.value):
                self.post_warning(f"{self._where}: it holds no stream for the pad {kind.value}", "shortfall")
                self.pads[kind.value].send_event(EosEvent())
        self.no_more_pads()
        second = StreamKind.SECOND_KLV
        if self.is_linked("klv") and second in self._kinds and not self.is_linked(second.value):
            self.post_warning(f"{self._where}: nothing reads its second KLV stream, the pad {second}")

    def _video_is_wanted(self) -> bool:
        """Whether the video has a pad, or might get one; not where there are other streams only."""
        return self.is_linked("src") or StreamKind.VIDEO in self._kinds or not self._kinds

    def _packet_caps(self, stream: Stream, kind: StreamKind) -> Caps:
        """The stream's caps; the same object while they are equal, which saves comparing them."""
        caps = stream_caps(stream, kind)
        if kind is StreamKind.VIDEO:
            caps = caps.with_fields(**self._orientation)
        if self._caps.get(kind) != caps:
            self._caps[kind] = caps
        return self._caps[kind]

    # One round through the file.

    def _play_once(
        self, container: InputContainer, begin_ns: int
    ) -> Generator[Frame | tuple[str, Frame], None, int]:
        """The frames of the linked pads, and the end of the last one.

        Raises:
            StreamError: no frame is shown; where some are, faults are warned of.
        """
        wanted = {kind for kind in self._kinds if self.is_linked(kind.value)}
        uses_src_pad = self.is_linked("src") or not wanted
        streams = self._find_streams(container, wanted | ({StreamKind.VIDEO} if uses_src_pad else set()))
        where, count, shown = self._where, 0, 0
        if not streams:
            raise StreamError(f"{where}: none of its streams is linked")
        first_ns = self._begin_ns + round(self.start_s * SECOND_NS) if begin_ns else 0
        part = FilePart(
            container, where, streams, self.start_s, self.stop_s, begin_ns - first_ns, self.warn_once
        )
        part.seek()
        try:
            for kind, frame in part.frames():
                count += 1
                shown += frame.get(DecodeOnly) is None
                if kind in wanted:
                    yield kind.value, frame
                if kind is StreamKind.VIDEO and uses_src_pad:
                    yield frame
        except StreamError as error:
            if self.stopping.is_set():
                return begin_ns
            if not count:
                raise StreamError(f"{where}: {error}; {self._unread_remedy()}") from None
            self.post_warning(f"{where}: {error} after {count} packets; ending there")
        if part.joints and not begin_ns:
            self._report_joints(part.joints)
        self._report_end("" if begin_ns else part.shortfall(), count, shown)
        return part.end_ns

    def _find_streams(
        self, container: InputContainer, kinds: set[StreamKind]
    ) -> dict[StreamKind, tuple[Stream, Caps]]:
        """The streams to read, each with the caps of its packets."""
        found = {kind: stream for stream, kind in streams_of(container, kinds)}
        if StreamKind.VIDEO in found:
            found[StreamKind.VIDEO] = video_stream(container, self.location, self.video_stream)
        return {kind: (stream, self._packet_caps(stream, kind)) for kind, stream in found.items()}

    def _report_joints(self, joints: Sequence[Joint]) -> None:
        """Warns of times that go back, and of joined recordings that differ in codec."""
        more = f", and {len(joints) - 1} more times" if len(joints) > 1 else ""
        self.post_warning(
            f"{self._where}: its times go back at {joints[0].pts / SECOND_NS:.3f} s{more}, as where "
            "recordings are joined; from there on they continue, and are not the file's own"
        )
        self._report_other_codec(joints)

    def _report_other_codec(self, joints: Sequence[Joint]) -> None:
        """Warns if joined recordings differ in codec: FFmpeg gives the packets of all as of the first."""
        if is_network(self.location):
            return
        read = self._caps[StreamKind.VIDEO].name
        for joint in joints[:JOINTS_LOOKED_AT]:
            options = {"skip_initial_bytes": str(joint.position or 0)}
            with (
                contextlib.suppress(ResourceError, StreamError),
                open_container(self.location, options) as rest,
            ):
                found = stream_caps(video_stream(rest, self.location), StreamKind.VIDEO).name
                if found != read:
                    self.post_warning(
                        f"{self._where}: its video is {found} from {joint.pts / SECOND_NS:.3f} s on, and is "
                        f"read as {read}; read the recordings one by one, before they are joined",
                        "shortfall",
                    )
                    return

    def _unread_remedy(self) -> str:
        if is_network(self.location):
            return "the server may not serve parts of a file, as an index at its end needs; download it first"
        return "the file is damaged or cut short"

    def _report_end(self, cut: str, count: int, shown: int) -> None:
        """Warns of what is missing at the end of a round; an error where no frame was shown at all."""
        if cut and (shown or self.start_s):
            self.post_warning(f"{self._where}: {cut}", "shortfall")
            self.post_message("cut-short", text=cut)
        elif not shown and self.start_s:
            length = "" if self._duration_us is None else f"; it is {self._duration_us / 1e6:.1f} s long"
            self.post_warning(
                f"{self._where}: there is no frame from start-s={self.start_s:g} on{length}", "shortfall"
            )
        elif not shown:
            fault = (
                "the file's own edit list shows none of its frames" if count else "the video holds no packets"
            )
            raise StreamError(f"{self._where}: {fault}; the file is damaged or cut short")

"""FilePart: the frames of a file between two times, read once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import NamedTuple

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit import SECOND_NS, Caps, Frame, StreamError
from streamkit_media.decoding.presentation_times import WRONG_TIMES, WRONG_TIMES_CODE
from streamkit_media.failures import MEDIA_ERRORS, reason_of
from streamkit_media.files.completeness import Completeness
from streamkit_media.files.presentation_order import with_presentation_times
from streamkit_media.streams import (
    CORRUPT,
    DECODE_ONLY,
    StreamKind,
    nanoseconds,
    packet_frame,
    read_packets,
)

FIRST_BACK_S = 1.0  # doubled with each try
# The decoder refuses a part of a packet with a length, and PyAV then loses the frames in other threads.
MP4_FORMAT = "mov,mp4,m4a,3gp,3g2,mj2"
WRAP_NS = 2**32 * SECOND_NS // 90_000  # half of the times that a transport stream can tell


class Joint(NamedTuple):
    """Where recordings are joined.

    Attributes:
        pts: time of the stream, ns.
        position: of the first packet of the video behind it, bytes; None if the container does not tell.
    """

    pts: int
    position: int | None


@dataclass(slots=True)
class _PartStream:
    """A stream of the part.

    Attributes:
        caps: of its packets.
        begin, end: its first tick that is shown, and the first that is not any more.
        time: of its newest packet, ticks; None before one has a time.
    """

    kind: StreamKind
    caps: Caps
    begin: float
    end: float
    time: int | None = None

    def shows(self, packet: Packet[Stream]) -> bool:
        """Whether a packet is shown; of several in a PES packet only the first has a time."""
        time = packet.dts if packet.pts is None else packet.pts
        if time is not None:
            self.time = time
        return self.time is None or self.begin <= self.time < self.end


class FilePart:
    """Reads the part of a file from `start_s` to `stop_s`, or to its own end.

    Args:
        container: the file.
        where: the file as it may be shown.
        streams: what to read, by kind, each with the caps of its packets.
        start_s, stop_s: from the beginning of the video.
        offset_ns: added to all times, as this part follows others.
        warn: called with a text where the file's times are corrected, or its last packet is left out.

    Attributes:
        end_ns: end of the last frame shown so far.
        joints: where the file's own times went back, and go on from there.
    """

    def __init__(
        self,
        container: InputContainer,
        where: str,
        streams: Mapping[StreamKind, tuple[Stream, Caps]],
        start_s: float,
        stop_s: float | None,
        offset_ns: int,
        warn: Callable[[str, str], object],
    ) -> None:
        self.end_ns = self._offset_ns = offset_ns
        self.joints: list[Joint] = []
        self._container, self._where = container, where
        self._start_s, self._stop_s = start_s, stop_s
        self._streams = [stream for stream, _ in streams.values()]
        self._read = {
            stream.index: _PartStream(kind, caps, *self._limits_of(stream))
            for kind, (stream, caps) in streams.items()
        }
        self._video = next((stream for stream in self._streams if isinstance(stream, VideoStream)), None)
        self._video_pts: int | None = None  # of its newest frame, ns
        self._awaits_keyframe = False
        self._dts: int | None = None  # of the last packet of the video, ns
        self._step_ns = 0
        self._completeness = (
            None if self._video is None else Completeness(container, self._video, start_s, stop_s)
        )
        self._report_times = partial(warn, f"{where}: {WRONG_TIMES}", WRONG_TIMES_CODE)
        self._report_part = partial(
            warn, f"{where}: the file ends within a packet, which is left out", "cut-packet"
        )
        self._leaves_out_parts = container.format.name == MP4_FORMAT

    def shortfall(self) -> str:
        """What is missing of the video at its end, in words; "" where nothing is."""
        return "" if self._completeness is None else self._completeness.shortfall()

    def seek(self) -> None:
        """Goes to a keyframe at or before the start, if only to the beginning.

        A container without an index, as MPEG-TS, is entered at any packet: earlier and earlier, until a
        keyframe is among those before the start.
        """
        at_s, back_s = self._start_s, FIRST_BACK_S
        while at_s > 0:
            self._seek(at_s)
            if self._meets_keyframe():
                self._seek(at_s)
                return
            at_s, back_s = self._start_s - back_s, 2 * back_s
        if self._start_s:
            self._seek(-FIRST_BACK_S)  # its first packet may precede the first frame

    def _meets_keyframe(self) -> bool:
        """Whether a keyframe of the video comes before the start; reads on, up to the start."""
        if self._video is None:
            return True
        start = _tick(self._start_s, self._video)
        for packet in read_packets(self._container, self._video):
            decoded = packet.pts if packet.dts is None else packet.dts
            if packet.is_keyframe and (packet.pts is None or packet.pts <= start):
                self._awaits_keyframe = True
                return True
            if decoded is None or decoded >= start:
                break
        return False

    def _seek(self, at_s: float) -> None:
        stream = self._streams[0]
        try:
            self._container.seek(_tick(at_s, stream), stream=stream)
        except MEDIA_ERRORS as error:
            raise StreamError(
                f"{self._where}: start-s={self._start_s:g} cannot be reached: {reason_of(error)}; "
                "this format may not allow seeking"
            ) from None

    def frames(self) -> Iterator[tuple[StreamKind, Frame]]:
        """Frames with their kinds; video before the start is for decoding only.

        Raises:
            StreamError: reading failed; the frames before were good.
        """
        playing = set(self._read)
        packets = read_packets(self._container, *self._streams)
        for packet in with_presentation_times(packets, self._video, self._report_times):
            if self._completeness is not None:
                self._completeness.add(packet)
            if packet.is_corrupt and self._leaves_out_parts:
                self._report_part()
                continue
            stream = self._read[packet.stream_index]
            decoded = packet.pts if packet.dts is None else packet.dts
            if decoded is not None and decoded >= stream.end:
                playing.discard(packet.stream_index)
                if not playing:
                    return
                continue
            is_video = stream.kind is StreamKind.VIDEO
            if is_video and self._awaits_keyframe and not packet.is_keyframe:
                continue  # its frame is shown before the keyframe that was sought
            self._awaits_keyframe &= not is_video
            frame = self._retimed(packet, packet_frame(packet, stream.caps), is_video=is_video)
            if self._completeness is not None and self._completeness.is_cut_photograph:
                frame = frame.replace(flags=frame.flags | CORRUPT)
            if stream.shows(packet):
                self.end_ns = max(self.end_ns, (frame.pts or 0) + (frame.duration or 0))
                yield stream.kind, frame
            elif is_video:
                yield stream.kind, frame.attach(DECODE_ONLY)

    def _retimed(self, packet: Packet[Stream], frame: Frame, *, is_video: bool) -> Frame:
        """A packet's frame with the stream's time; asynchronous KLV gets that of the video around it."""
        if is_video and packet.dts is not None:
            self._follow(nanoseconds(packet.dts, packet.time_base), frame, packet.pos)
        pts = self._video_pts if not is_video else None
        if frame.pts is not None:
            pts = frame.pts + self._offset_ns
        if is_video and pts is not None:
            self._video_pts = pts
        return frame if pts == frame.pts else frame.replace(pts=pts)

    def _follow(self, dts: int, frame: Frame, position: int | None) -> None:
        """Moves the times from here on where the video's go back, as where recordings were joined.

        FFmpeg takes a step back by more than a minute in a transport stream for a wrap of its 33 bits.

        Args:
            dts: decoding time of a packet of the video, ns.
            frame: the packet, with the file's own time.
            position: of the packet in the file, bytes.
        """
        step = 0 if self._dts is None else dts - self._dts
        self._dts = dts
        has_wrapped = step > WRAP_NS and self._container.format.name == "mpegts"
        if frame.pts is not None and (step < 0 or has_wrapped):
            self.end_ns += 0 if frame.duration else self._step_ns
            before_ns, self._offset_ns = self._offset_ns, self.end_ns - frame.pts
            self.joints.append(Joint(self.end_ns, position))
            moved_s = Fraction(self._offset_ns - before_ns, SECOND_NS)
            for stream in self._streams:
                moved = round(moved_s / (stream.time_base or 1))
                self._read[stream.index].begin -= moved
                self._read[stream.index].end -= moved
        else:
            self._step_ns = step

    def _limits_of(self, stream: Stream) -> tuple[float, float]:
        """The first tick of a stream that is shown, and the first that is not any more."""
        begin = _tick(self._start_s, stream) if self._start_s else -math.inf
        return begin, math.inf if self._stop_s is None else _tick(self._stop_s, stream)


def _tick(seconds: float, stream: Stream) -> int:
    """A time from the beginning of the video, in a stream's ticks; other streams count from there too."""
    video = next((s for s in stream.container.streams if isinstance(s, VideoStream)), stream)
    start = video.start_time or 0
    if not stream.time_base or not video.time_base:
        return start
    return round(start * video.time_base / stream.time_base) + round(seconds / stream.time_base)

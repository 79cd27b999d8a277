"""The part of a file that is played, exact to the frame."""

from __future__ import annotations

from dataclasses import dataclass

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit import Frame
from streamkit_media.packets import DECODE_ONLY
from streamkit_media.streams import StreamKind


@dataclass(frozen=True)
class PlayRange:
    """From `start_s` to before `stop_s`, s from the beginning of the video; None is the video's own end."""

    start_s: float
    stop_s: float | None

    def seek(self, container: InputContainer, stream: Stream) -> None:
        """Goes to the key frame at or before the start.

        Raises:
            FFmpegError: the format does not allow it.
        """
        if self.start_s:
            container.seek(_first_tick(stream) + _ticks(self.start_s, stream), stream=stream)

    def is_over(self, packet: Packet[Stream], stream: Stream) -> bool:
        """Whether this packet and all that follow of its stream are too late."""
        if self.stop_s is None:
            return False
        decoded = packet.dts if packet.dts is not None else packet.pts
        return decoded is not None and decoded >= _first_tick(stream) + _ticks(self.stop_s, stream)

    def within(self, frame: Frame, packet: Packet[Stream], stream: Stream, kind: StreamKind) -> Frame | None:
        """The frame of a packet, marked decode-only where it lies outside; None where it is not needed."""
        if not self.start_s and self.stop_s is None:
            return frame
        shown = packet.pts if packet.pts is not None else packet.dts
        if shown is None:
            return frame
        first = _first_tick(stream)
        is_early = shown < first + _ticks(self.start_s, stream)
        is_late = self.stop_s is not None and shown >= first + _ticks(self.stop_s, stream)
        if not is_early and not is_late:
            return frame
        return frame.attach(DECODE_ONLY) if kind is StreamKind.VIDEO else None


def _first_tick(stream: Stream) -> int:
    """Where the video begins, in the stream's ticks: the other streams count from there too."""
    video = next((s for s in stream.container.streams if isinstance(s, VideoStream)), stream)
    start = video.start_time or 0
    if video is stream or not stream.time_base or not video.time_base:
        return start
    return round(start * video.time_base / stream.time_base)


def _ticks(seconds: float, stream: Stream) -> int:
    return round(seconds / stream.time_base) if stream.time_base else 0

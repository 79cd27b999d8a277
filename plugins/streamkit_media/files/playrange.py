"""The part of a file that is played, exact to the frame."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream


class RangePosition(enum.Enum):
    """Where a packet lies: in the range, outside of it, or after it with all that follow of its stream."""

    INSIDE, OUTSIDE, OVER = range(3)


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
            container.seek(_tick(self.start_s, stream), stream=stream)

    def place(self, packet: Packet[Stream]) -> RangePosition:
        """Where a packet lies; one without a time is inside."""
        decoded = packet.dts if packet.dts is not None else packet.pts
        if decoded is None or (not self.start_s and self.stop_s is None):
            return RangePosition.INSIDE
        stream, shown = packet.stream, packet.pts if packet.pts is not None else decoded
        end = None if self.stop_s is None else _tick(self.stop_s, stream)
        if end is not None and decoded >= end:
            return RangePosition.OVER
        is_inside = shown >= _tick(self.start_s, stream) and (end is None or shown < end)
        return RangePosition.INSIDE if is_inside else RangePosition.OUTSIDE


def _tick(seconds: float, stream: Stream) -> int:
    """A time from the beginning of the video, in a stream's ticks; other streams count from there too."""
    video = next((s for s in stream.container.streams if isinstance(s, VideoStream)), stream)
    start = video.start_time or 0
    if not stream.time_base or not video.time_base:
        return start
    return round(start * video.time_base / stream.time_base) + round(seconds / stream.time_base)

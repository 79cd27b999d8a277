"""Whether a file is cut short: within its photograph, or before the end that its container declares."""

from __future__ import annotations

import re

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit.output.names import local_path
from streamkit_media.failures import FIRST_BOX, INDEX_BOX, boxes

# The smaller difference is that of rounding, of delays, and of streams that end together.
TOLERANCE_S, TOLERANCE_RATIO, TOLERANCE_STEPS = 1.0, 0.02, 2
JPEG_START, JPEG_SCAN, JPEG_END = b"\xff\xd8", b"\xff\xda", b"\xff\xd9"
PHOTOGRAPHS = ("image2", "jpeg_pipe")  # formats of FFmpeg that hold one
LENGTH = re.compile(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)")


class Completeness:
    """Compares the video that comes out of a file with its declared duration.

    Attributes:
        is_cut_photograph: whether the file is a photograph that ends within its picture.
    """

    def __init__(
        self, container: InputContainer, video: VideoStream, start_s: float, stop_s: float | None
    ) -> None:
        self._start_s = start_s
        self._is_photograph = container.format.name in PHOTOGRAPHS
        self.is_cut_photograph = False
        self._stream_index, self._base = video.index, float(video.time_base or 0)
        self._declared_s, self._stop_s = declared_length_s(container, video), stop_s
        self._first: int | None = None
        self._last = self._end = self._longest_step = 0

    def add(self, packet: Packet[Stream]) -> None:
        """Takes a packet of any of the streams, in the file's order."""
        self.is_cut_photograph |= self._is_photograph and is_cut_short(bytes(packet))
        if packet.stream_index != self._stream_index or packet.pts is None:
            return
        if self._first is None:
            self._first = self._last = packet.pts
        self._first = min(self._first, packet.pts)
        self._longest_step = max(self._longest_step, packet.pts - self._last)
        self._last = max(self._last, packet.pts)
        self._end = max(self._end, packet.pts + (packet.duration or 0))

    def shortfall(self) -> str:
        """What is missing, in words; "" where nothing is, or the container declares no length."""
        if self.is_cut_photograph:
            return "the photograph is cut short, and part of it grey"
        if self._declared_s is None:
            return ""
        # Containers count from 0 or from the first frame: the later end of the two is the safe one.
        end_s = self._start_s if self._first is None else (self._end - min(self._first, 0)) * self._base
        due_s = self._declared_s if self._stop_s is None else min(self._declared_s, self._stop_s)
        steps_s = TOLERANCE_STEPS * self._longest_step * self._base
        if due_s - end_s <= max(tolerance_s(self._declared_s), steps_s):
            return ""
        where = f"{'before' if self._first is None else 'at'} {end_s:.1f} s of {self._declared_s:.1f} s"
        return f"the video ends {where}: the file is cut short"


def tolerance_s(length_s: float) -> float:
    """How much earlier than its declared length a whole video may end, s."""
    return max(TOLERANCE_S, TOLERANCE_RATIO * length_s)


def declared_length_s(container: InputContainer, video: VideoStream) -> float | None:
    """The length of a video by its file's header, s; None where FFmpeg estimates it from what is there."""
    formats = set(container.format.name.split(","))
    own_s = float(video.duration * video.time_base) if video.duration and video.time_base else None
    if "mov" in formats:
        return own_s
    if "avi" in formats:  # FFmpeg shortens the duration to what is there, but not the number of frames
        return float(video.frames / video.average_rate) if video.frames and video.average_rate else own_s
    if "matroska" in formats:
        if found := LENGTH.match(video.metadata.get("DURATION", "")):
            hours, minutes, seconds = found.groups()
            return int(hours) * 3600 + int(minutes) * 60 + float(seconds)
        # Of the longest stream, which need not be the video.
        if len(container.streams) == 1 and container.duration:
            return container.duration / 1e6
    return None


def holds_second_recording(location: str) -> bool:
    """Whether a local MP4 file has another one appended; FFmpeg reads only the first."""
    try:
        with local_path(location).open("rb") as file:
            found = boxes(file)
    except OSError:
        return False
    # Fragments of a stream may each repeat the index, and are all read.
    return found[:1] == [FIRST_BOX] and found.count(INDEX_BOX) > 1 and b"moof" not in found


def is_cut_short(data: bytes) -> bool:
    """Whether a JPEG file ends within its picture, which FFmpeg does not tell.

    The end marker is sought behind the headers: a thumbnail in them has one of its own.
    """
    at = len(JPEG_START)
    while data[at : at + 1] == b"\xff" and data[at : at + 2] != JPEG_SCAN:
        at += 2 + int.from_bytes(data[at + 2 : at + 4])
    return data.startswith(JPEG_START) and data.find(JPEG_END, at) < 0

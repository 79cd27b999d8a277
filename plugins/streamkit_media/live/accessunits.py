"""Access units of H.264 and H.265 from the pieces that packets of RTP or MPEG-TS (PES) carry.

FFmpeg's parser ends a frame when the next one begins, which delays it by one frame. RTP marks the last packet
of a frame, and a PES packet is one: here the pieces are joined, and the parser is told that the frame ends.

Source: RFC 6184, 5.1 (marker and timestamp).
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator
from typing import cast

from av.codec.context import CodecContext
from av.container import Flags, InputContainer
from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit_media.codecs import stream_rate
from streamkit_media.nalunits import CODECS, START_CODES, holds_slice, without_inner_parameter_sets

UNPARSED = {"fflags": "+noparse"}  # FFmpeg's option to return pieces
MAX_REORDERED = 16
NO_PARSE = cast("int", Flags.no_parse.value)
# FFmpeg hands on a PES packet in pieces of 200 KB with its header, cut between transport packets.
FULL_PIECE_BYTES = 200 * 1024 - 184


def can_be_joined(stream: Stream) -> bool:
    """Whether frames of the stream's codec can be joined here."""
    return stream.codec_context is not None and stream.codec_context.name in CODECS


class DecodingTimes:
    """Decoding times of frames, estimated from their presentation times."""

    def __init__(self) -> None:
        self._latest: list[int] = []
        self._reordered = 0

    def of(self, pts: int) -> int:
        """The decoding time of the next frame, in the unit of its time of presentation.

        Frames that are shown in another order than they come in are decoded as many places earlier.
        """
        insort(self._latest, pts)
        behind = len(self._latest) - 1 - self._latest.index(pts)
        self._reordered = min(max(self._reordered, behind), MAX_REORDERED)
        del self._latest[: -self._reordered - 1]
        return self._latest[0]


class AccessUnits:
    """Joins the pieces of a video to packets of one frame each.

    Args:
        video: their stream.
        has_decoding_times: whether the pieces have them; they are estimated otherwise.

    Attributes:
        trusts_marks: whether marked pieces end frames; false after a mark within a frame.
        has_several: whether pieces of one time held more than one frame.
    """

    def __init__(self, video: VideoStream, *, has_decoding_times: bool = False) -> None:
        self.trusts_marks, self.has_several = True, False
        self._video, self._codec = video, video.codec_context.name
        self._parser = CodecContext.create(self._codec, "r")
        self._times = None if has_decoding_times else DecodingTimes()
        self._pts: int | None = None  # of the frame under way, or of the last one
        self._pieces: list[Packet[Stream]] = []
        self._is_ended = False  # whether the last piece, by its mark, has ended a frame

    def add(self, piece: Packet[Stream], *, is_marked: bool) -> Iterator[Packet[Stream]]:
        """Takes the next piece.

        Args:
            piece: one or more NAL units with start codes, or more of the last one.
            is_marked: whether it is known to be the last of its frame.

        Yields:
            The frames that are complete with it.
        """
        data = bytes(piece)
        has_start = START_CODES.match(data) is not None
        if has_start and (piece.pts is None or piece.pts != self._pts):
            yield from self.drain()
        elif has_start and holds_slice(self._codec, data, is_first=True):  # the server's time stands still
            before = self._taken_before_slice()
            yield from self.drain()
            self._pieces = before
        elif self._is_ended and (not has_start or holds_slice(self._codec, data)):
            self.trusts_marks = False
        if not self._pieces:
            self._pts = piece.pts
        self._pieces.append(piece)
        self._is_ended = is_marked and self.trusts_marks and self._holds_slice()
        if self._is_ended:
            yield from self.drain()

    def _taken_before_slice(self) -> list[Packet[Stream]]:
        """Takes the units behind the last slice, such as parameter sets, which belong to the next frame."""
        pieces, at = self._pieces, 0
        for index, data in enumerate(map(bytes, pieces)):
            if holds_slice(self._codec, data):
                at = len(pieces)
            elif at == len(pieces) and START_CODES.match(data):
                at = index
        self._pieces = pieces[:at]
        return pieces[at:]

    def _holds_slice(self) -> bool:
        """Whether the pieces are more than parameter sets and the like."""
        return any(holds_slice(self._codec, bytes(piece)) for piece in self._pieces)

    def drain(self) -> Iterator[Packet[Stream]]:
        """What is held, with the times of its first piece."""
        pieces, self._pieces = self._pieces, []
        if not pieces:
            return
        first, is_corrupt = pieces[0], any(piece.is_corrupt for piece in pieces)
        data = without_inner_parameter_sets(self._codec, b"".join(map(bytes, pieces)))
        units = self._parser.parse(data) + self._parser.parse(None)
        self.has_several |= len(units) > 1
        for unit in units:
            unit.stream, unit.time_base = self._video, first.time_base
            unit.pts, unit.dts = first.pts, first.dts
            if self._times is not None:
                unit.dts = None if first.pts is None else self._times.of(first.pts)
            unit.duration, unit.is_corrupt = frame_duration(self._video), is_corrupt
            for item in first.iter_sidedata():
                item.to_packet(unit)
            yield unit


def frame_duration(video: VideoStream) -> int:
    """Duration of a frame in the stream's time base; 0 if unknown."""
    rate, base = stream_rate(video), video.time_base
    return round(1 / (rate * base)) if rate and base else 0


def whole_frames(
    container: InputContainer, pieces: Iterator[Packet[Stream]], video: VideoStream
) -> Iterator[Packet[Stream]]:
    """The packets of a container opened with `UNPARSED`, in which a PES packet is a frame, or part of one.

    Where it is several, or the codec is not known here, FFmpeg's parser takes over.
    """
    if can_be_joined(video):
        units = AccessUnits(video, has_decoding_times=True)
        for piece in pieces:
            if piece.stream_index != video.index:
                yield piece
                continue
            yield from units.add(piece, is_marked=piece.size <= FULL_PIECE_BYTES)
            if units.has_several:
                break
        yield from units.drain()
    container.flags &= ~NO_PARSE
    yield from pieces

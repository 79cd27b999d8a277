"""Access units of H.264 and H.265 from the pieces that packets of RTP or MPEG-TS (PES) carry.

FFmpeg's parser ends a frame when the next one begins, which delays it by one frame. RTP marks the last packet
of a frame, and a PES packet is one.

Source: RFC 6184, 5.1 (marker); ITU-T H.264, 7.4.1.2.3 and H.265, 7.4.2.4.4 (where an access unit begins).
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator
from dataclasses import dataclass

from av.packet import Packet
from av.stream import Stream
from av.video.stream import VideoStream

from streamkit_media.codecs import stream_rate
from streamkit_media.nalunits import START_CODES, unit_type, units

UNPARSED = {"fflags": "+noparse"}  # FFmpeg's option to return pieces
MAX_REORDERED = 16
SUPPLEMENT, RECOVERY_POINT = 6, 6  # type of such units of H.264, and of the message in them


@dataclass(frozen=True)
class Kinds:
    """Types of NAL units of a codec.

    Attributes:
        header_bytes: of a unit.
        slices: slices; what follows the header begins with a set bit in the first one of a frame.
        keys: of those, the ones of frames that decoding can begin with.
        leading: types that precede the slices of their frame.
    """

    header_bytes: int
    slices: frozenset[int]
    keys: frozenset[int]
    leading: frozenset[int]


KINDS = {
    "h264": Kinds(1, frozenset({1, 2, 5}), frozenset({5}), frozenset({6, 7, 8, 9, 14, 15, 18})),
    "hevc": Kinds(
        2,
        frozenset(range(32)),
        frozenset(range(16, 24)),
        frozenset({32, 33, 34, 35, 39, *range(41, 45), *range(48, 56)}),
    ),
}


def can_be_joined(stream: Stream) -> bool:
    """Whether frames of the stream's codec can be joined here."""
    return stream.codec_context is not None and stream.codec_context.name in KINDS


def frame_duration(video: VideoStream) -> int:
    """Duration of a frame in the stream's time base; 0 if unknown."""
    rate, base = stream_rate(video), video.time_base
    return round(1 / (rate * base)) if rate and base else 0


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
    """Joins pieces to packets of one frame each.

    Args:
        codec: h264 or hevc.
        duration: of a frame in the pieces' time base; 0 if unknown.
        has_decoding_times: whether the pieces have them; they are estimated otherwise.

    Attributes:
        trusts_marks: whether marked pieces end frames; false after a mark within a frame.
        has_several: whether a piece held more than one frame: only a parser takes them apart.
    """

    def __init__(self, codec: str, duration: int = 0, *, has_decoding_times: bool = False) -> None:
        self.trusts_marks, self.has_several = True, False
        self._has_decoding_times = has_decoding_times
        self._codec, self._kinds = codec, KINDS[codec]
        self._duration = duration
        self._times = DecodingTimes()
        self._marked_pts: int | None = None
        self._pieces: list[Packet[Stream]] = []
        self._data: list[bytes] = []
        self._has_slice = self._is_key = False

    def add(self, piece: Packet[Stream], *, is_marked: bool) -> Iterator[Packet[Stream]]:
        """Takes the next piece.

        Args:
            piece: one or more NAL units with start codes, or more of the last one.
            is_marked: whether it is known to be the last of its frame.

        Yields:
            The frames that are complete with it.
        """
        data = bytes(piece)
        found = list(units(data)) if START_CODES.match(data) else []
        begins = bool(found) and self._may_begin(found[0])
        is_next = self._pieces and piece.pts != self._pieces[0].pts
        if self._pieces and (is_next or (begins and self._has_slice)):
            yield self._joined()
        elif not self._pieces and not begins and piece.pts == self._marked_pts:
            self.trusts_marks = False
        self._pieces.append(piece)
        self._data.append(data)
        for unit in found:
            self.has_several |= self._has_slice and unit is not found[0] and self._may_begin(unit)
            self._note(unit)
        if is_marked and self.trusts_marks and self._has_slice:
            self._marked_pts = piece.pts
            yield self._joined()

    def flush(self) -> Iterator[Packet[Stream]]:
        """What is held when no piece follows."""
        if self._pieces:
            yield self._joined()

    def _kind(self, unit: bytes) -> int:
        return unit_type(self._codec, unit[0]) if unit else -1

    def _may_begin(self, unit: bytes) -> bool:
        """Whether a unit begins a frame where another one precedes it."""
        kind, at = self._kind(unit), self._kinds.header_bytes
        is_first = len(unit) > at and bool(unit[at] & 0x80)
        return kind in self._kinds.leading or (kind in self._kinds.slices and is_first)

    def _note(self, unit: bytes) -> None:
        kind = self._kind(unit)
        self._has_slice |= kind in self._kinds.slices
        self._is_key |= kind in self._kinds.keys
        if self._codec == "h264" and kind == SUPPLEMENT:
            self._is_key |= has_recovery_point(unit[self._kinds.header_bytes :])

    def _joined(self) -> Packet[Stream]:
        """The pieces as one packet, with the times of the first."""
        first = self._pieces[0]
        whole: Packet[Stream] = Packet(b"".join(self._data))
        whole.pts, whole.time_base = first.pts, first.time_base
        if self._has_decoding_times:
            whole.dts = first.dts
        else:
            whole.dts = None if first.pts is None else self._times.of(first.pts)
        whole.duration = self._duration
        whole.is_keyframe, whole.is_corrupt = self._is_key, any(piece.is_corrupt for piece in self._pieces)
        for item in first.iter_sidedata():
            item.to_packet(whole)
        self._pieces, self._data, self._has_slice, self._is_key = [], [], False, False
        return whole


def has_recovery_point(messages: bytes) -> bool:
    """Whether supplemental enhancement information holds a recovery point message.

    Source: ITU-T H.264, 7.3.2.3.1.
    """
    at = 0
    while at + 2 <= len(messages):
        kind, at = _number(messages, at)
        if kind == RECOVERY_POINT:
            return True
        size, at = _number(messages, at)
        at += size
    return False


def _number(data: bytes, at: int) -> tuple[int, int]:
    """The sum of some bytes, of which all but the last are 255, and the offset behind them."""
    end = at
    while end < len(data) and data[end] == 255:
        end += 1
    return 255 * (end - at) + sum(data[end : end + 1]), end + 1

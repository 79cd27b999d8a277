"""Finds H.264 frames that are missing; FFmpeg decodes the next ones without an error.

Source: ITU-T H.264, 7.3.2.1.1 (sequence parameter set), 7.3.3 (slice header), 7.4.3 (frame_num).
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

from streamkit_media.nalunits import BadPacket, length_field, parameter_sets, units

LOOK_BYTES = 4096
HEADER_BYTES = 16
PARAMETER_BYTES = 1024
SLICE, KEY_SLICE, SEQUENCE_SET, PICTURE_SET = 1, 5, 7, 8
# Profiles whose parameter sets hold chroma format and scaling lists.
HIGH_PROFILES = frozenset({44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 244})


class Sequence(NamedTuple):
    """Frame numbering of a sequence parameter set."""

    bits: int  # of a frame number
    has_planes: bool  # whether slices have a colour plane
    has_gaps: bool  # whether the encoder itself leaves numbers out


class FrameNumbers:
    """Follows the frame numbers of a stream.

    Args:
        extradata: of the codec; says whether units have lengths or start codes.
    """

    def __init__(self, extradata: bytes) -> None:
        self._length_bytes = length_field("h264", extradata)
        self._sequences: dict[int, Sequence] = {}
        self._sequence_of: dict[int, int] = {}
        self._reference: int | None = None
        self._lacks_reference = False
        with suppress(BadPacket):
            for unit in parameter_sets("h264", extradata):
                self._take(unit)

    def lacks_reference(self, data: bytes | memoryview, is_keyframe: bool) -> bool:
        """Whether a frame is missing that the one in this packet depends on, directly or not.

        Args:
            data: the packet.
            is_keyframe: whether decoding can begin with it; then earlier frames do not matter.
        """
        for unit in units(bytes(data[:LOOK_BYTES]), self._length_bytes):
            kind = unit[0] & 31 if unit else 0
            if kind in (SEQUENCE_SET, PICTURE_SET):
                self._take(unit)
            elif kind in (SLICE, KEY_SLICE):
                is_keyframe = is_keyframe or kind == KEY_SLICE
                with suppress(IndexError):  # the header is cut short: the decoder reports it
                    self._lacks_reference |= self._is_behind_gap(unit)
                break
        self._lacks_reference &= not is_keyframe
        return self._lacks_reference

    def _is_behind_gap(self, unit: bytes) -> bool:
        bits = _Bits(unit[1:HEADER_BYTES])
        bits.unsigned()  # first macroblock
        bits.unsigned()  # kind of slice
        sequence = self._sequences.get(self._sequence_of.get(bits.unsigned(), -1))
        if sequence is None:
            return False
        bits.read(2 if sequence.has_planes else 0)
        number, before = bits.read(sequence.bits), self._reference
        if unit[0] & 0x60:
            self._reference = number
        return not sequence.has_gaps and before is not None and (number - before) % (1 << sequence.bits) > 1

    def _take(self, unit: bytes) -> None:
        """Takes a parameter set."""
        kind = unit[0] & 31 if unit else 0
        try:
            if kind == SEQUENCE_SET:
                number, sequence = _sequence(unit)
                self._sequences[number] = sequence
            elif kind == PICTURE_SET:
                bits = _Bits(unit[1:HEADER_BYTES])
                number = bits.unsigned()
                self._sequence_of[number] = bits.unsigned()
        except IndexError:
            return  # cut short


class _Bits:
    """Reads bits and Exp-Golomb codes; IndexError where there are no more."""

    def __init__(self, data: bytes) -> None:
        plain = data.replace(b"\0\0\3", b"\0\0")
        self._left = 8 * len(plain)
        self._rest = int.from_bytes(plain, "big")  # the bits not read yet

    def read(self, count: int) -> int:
        self._left -= count
        if self._left < 0:
            raise IndexError("no more bits")
        value = self._rest >> self._left
        self._rest -= value << self._left
        return value

    def unsigned(self) -> int:
        return self.read(2 * (self._left - self._rest.bit_length()) + 1) - 1

    def signed(self) -> int:
        code = self.unsigned()
        return (code + 1) // 2 if code % 2 else -(code // 2)


def _sequence(unit: bytes) -> tuple[int, Sequence]:
    """A sequence parameter set's own number, and its frame numbering."""
    bits = _Bits(unit[1:PARAMETER_BYTES])
    profile = bits.read(8)
    bits.read(16)
    number, has_planes = bits.unsigned(), False
    if profile in HIGH_PROFILES:
        chroma = bits.unsigned()
        has_planes = chroma == 3 and bool(bits.read(1))
        bits.unsigned()  # depth of luma
        bits.unsigned()  # depth of chroma
        bits.read(1)
        if bits.read(1):
            _skip_scaling(bits, 8 if chroma != 3 else 12)
    size = bits.unsigned() + 4
    order = bits.unsigned()
    if order == 0:
        bits.unsigned()
    elif order == 1:
        bits.read(1)
        bits.signed()
        bits.signed()
        for _ in range(bits.unsigned()):
            bits.signed()
    bits.unsigned()  # reference frames
    return number, Sequence(size, has_planes, bool(bits.read(1)))


def _skip_scaling(bits: _Bits, lists: int) -> None:
    for index in range(lists):
        last = following = 8
        for _ in range((16 if index < 6 else 64) if bits.read(1) else 0):
            if following:
                following = (last + bits.signed()) % 256
            last = following or last

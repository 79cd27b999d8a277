"""NAL units of H.264 and H.265: in packets, with start codes or lengths between them, and in extradata.

Source: ITU-T H.264, annex B and 7.4.1 (nal_ref_idc); H.265, table 7-1; ISO/IEC 14496-15, 5.3.3.1 (avcC) and
8.3.3.1 (hvcC). PyAV passes extradata to FFmpeg's bitstream filters for demuxed streams only, and packets here
also come from encoders and applications.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

START_CODE = b"\0\0\0\1"
START_CODES = re.compile(b"\0\0\0?\1")
CODECS = frozenset({"h264", "hevc"})
LENGTH_FIELD_AT = {"h264": 4, "hevc": 21}
BOX_HEADER_BYTES = {"h264": 5, "hevc": 23}
REFERENCE_LOOK_BYTES = 1 << 16
SLICE_TYPES = {"h264": range(1, 6), "hevc": range(32)}
PARAMETER_SET_TYPES = {"h264": {7, 8}, "hevc": {32, 33, 34}}
LOOK_BYTES = 4096


class BadPacket(ValueError):
    """A packet or extradata with a length that exceeds it."""


def length_field(codec: str, extradata: bytes) -> int:
    """Bytes of the length before each unit; 0 where start codes divide them."""
    at = LENGTH_FIELD_AT[codec]
    return (extradata[at] & 3) + 1 if len(extradata) > at and extradata[0] == 1 else 0


def units(data: bytes, length_bytes: int = 0, *, is_whole: bool = False) -> Iterator[bytes]:
    """The units, without start codes or lengths.

    Args:
        data: a packet, or its beginning.
        length_bytes: as `length_field` returns.
        is_whole: whether a unit that is cut short is an error; only with lengths.

    Raises:
        BadPacket: a length exceeds the packet.
    """
    if not length_bytes:
        yield from data.split(START_CODE[1:])[1:]
        return
    at = 0
    while at + length_bytes <= len(data):
        begin = at + length_bytes
        at = begin + int.from_bytes(data[at:begin], "big")
        if is_whole and at > len(data):
            break
        yield data[begin:at]
    if is_whole and at != len(data):
        raise BadPacket(f"the length of a NAL unit exceeds its packet of {len(data)} bytes")


def parameter_sets(codec: str, extradata: bytes) -> Iterator[bytes]:
    """The parameter sets in extradata: an avcC or hvcC box, or units with start codes.

    Raises:
        BadPacket: a count or length exceeds the box.
    """
    if START_CODES.match(extradata):
        yield from units(extradata)
        return
    at = BOX_HEADER_BYTES[codec]
    if len(extradata) < at + 2 * (codec == "h264"):
        raise BadPacket(f"the codec's header has at least {at} bytes, got {len(extradata)}")
    for index in range(2 if codec == "h264" else extradata[at - 1]):
        if codec == "h264":
            if at == len(extradata):  # no picture parameter sets
                return
            count, at = extradata[at] & (255 if index else 31), at + 1
        else:
            count, at = int.from_bytes(extradata[at + 1 : at + 3], "big"), at + 3
        for _ in range(count):
            begin = at + 2
            at = begin + int.from_bytes(extradata[at:begin], "big")
            if at > len(extradata) or begin > len(extradata):
                raise BadPacket("a parameter set exceeds the codec's header")
            yield extradata[begin:at]
    if at > len(extradata):
        raise BadPacket("the codec's header ends within an array of parameter sets")


def typed_units(codec: str, data: bytes, length_bytes: int = 0) -> Iterator[tuple[int, bytes]]:
    """The units, each after its type; arguments as those of `units`."""
    for unit in units(data, length_bytes):
        if unit:
            yield unit[0] & 31 if codec == "h264" else unit[0] >> 1 & 63, unit


def holds_slice(codec: str, data: bytes, *, is_first: bool = False) -> bool:
    """Whether a slice, or the first of a picture, begins in a packet or piece of one; it has start codes."""
    slices = (unit for kind, unit in typed_units(codec, data) if kind in SLICE_TYPES[codec])
    return any(not is_first or begins_picture(codec, unit) for unit in slices)


def without_inner_parameter_sets(codec: str, data: bytes) -> bytes:
    """A frame with start codes, without the parameter sets between its slices.

    GStreamer's rtph264pay config-interval=-1 repeats them before each slice of a keyframe. A parser begins
    another frame there, so that it would return halves.
    """
    kept, held = list[bytes](), list[bytes]()
    has_slice = is_inner = False
    for kind, unit in typed_units(codec, data):
        if has_slice and kind in PARAMETER_SET_TYPES[codec]:
            held.append(unit)
            continue
        is_slice = kind in SLICE_TYPES[codec]
        if is_slice and held and not begins_picture(codec, unit):
            is_inner = True
            held.clear()
        kept += [*held, unit]
        held.clear()
        has_slice |= is_slice
    if not is_inner:
        return data
    return data[: data.find(START_CODE[1:])] + b"".join(START_CODE[1:] + unit for unit in kept + held)


def begins_picture(codec: str, unit: bytes) -> bool:
    """Whether a slice is the first of its picture.

    Source: H.264, 7.3.3 (first_mb_in_slice is 0); H.265, 7.3.6.1 (first_slice_segment_in_pic_flag).
    """
    header = 1 if codec == "h264" else 2
    return len(unit) > header and bool(unit[header] & 0x80)


def is_reference(codec: str, data: bytes | memoryview, extradata: bytes) -> bool:
    """Whether other frames may depend on the one in a packet; True where that is unknown."""
    if codec not in CODECS:
        return True
    found = typed_units(codec, bytes(data[:REFERENCE_LOOK_BYTES]), length_field(codec, extradata))
    slices = [(kind, unit[0]) for kind, unit in found if kind in SLICE_TYPES[codec]]
    if codec == "h264":
        return not slices or any(first & 0x60 for _, first in slices)
    return not slices or any(kind >= 16 or kind % 2 for kind, _ in slices)


class AnnexBConverter:
    """Converts packets with lengths to Annex B; other packets, and those of other codecs, pass unchanged.

    Args:
        codec: FFmpeg's name.
        extradata: avcC, hvcC or Annex B parameter sets; b"" where they are in the packets.

    Raises:
        BadPacket: the extradata are damaged.
    """

    def __init__(self, codec: str, extradata: bytes) -> None:
        self._codec = codec
        self._length_bytes = 0
        self._parameter_sets = b""
        if codec not in CODECS or not extradata:
            return
        found = b"".join(START_CODE + unit for unit in parameter_sets(codec, extradata))
        self._parameter_sets = extradata if START_CODES.match(extradata) else found
        self._length_bytes = length_field(codec, extradata)

    def packet(self, data: bytes, is_keyframe: bool) -> bytes:
        """The packet; a keyframe begins with the parameter sets, so that playing can begin there.

        Raises:
            BadPacket: a length exceeds the packet.
        """
        if self._codec not in CODECS:
            return data
        if self._length_bytes:
            data = b"".join(START_CODE + unit for unit in units(data, self._length_bytes, is_whole=True))
        if not is_keyframe or not self._parameter_sets or self._holds_parameter_sets(data):
            return data
        return self._parameter_sets + data

    def _holds_parameter_sets(self, data: bytes) -> bool:
        types = PARAMETER_SET_TYPES[self._codec]
        return any(kind in types for kind, _ in typed_units(self._codec, data[:LOOK_BYTES]))

"""The NAL units of packets, whether start codes or lengths divide them.

Source: ITU-T H.264, annex B; ISO/IEC 14496-15, 5.3.
"""

from __future__ import annotations

from collections.abc import Iterator

START_CODE = b"\0\0\1"
LENGTH_FIELD_AT = {"h264": 4, "hevc": 21}


def length_field(codec: str, extradata: bytes) -> int:
    """Bytes of the length before each unit; 0 where start codes divide them.

    Args:
        codec: h264 or hevc.
        extradata: of the codec.
    """
    at = LENGTH_FIELD_AT[codec]
    return (extradata[at] & 3) + 1 if len(extradata) > at and extradata[0] == 1 else 0


def units(data: bytes, length_bytes: int = 0) -> Iterator[bytes]:
    """The units, without what divides them; a last one may be cut short.

    Args:
        data: a packet, or its beginning.
        length_bytes: as `length_field` tells.
    """
    at = 0
    if length_bytes:
        while at + length_bytes < len(data):
            begin = at + length_bytes
            at = begin + int.from_bytes(data[at:begin], "big")
            yield data[begin:at]
        return
    begin = data.find(START_CODE) + 3
    while begin >= 3:
        end = data.find(START_CODE, begin)
        yield data[begin : end if end >= 0 else len(data)]
        begin = end + 3

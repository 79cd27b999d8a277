"""Which packets a slow machine can leave out without harm to the pictures it shows.

Source: ITU-T H.264, 7.4.1 (nal_ref_idc); H.265, table 7-1 (sub-layer non-reference pictures).
"""

from __future__ import annotations

import re
from collections.abc import Iterator

START_CODE = re.compile(b"\0\0\1")
LENGTH_FIELD_AT = {"h264": 4, "hevc": 21}
LOOK_BYTES = 1 << 16


def is_reference(codec: str, data: bytes | memoryview, extradata: bytes) -> bool:
    """Whether other pictures may be built on the one in a packet; True where that cannot be told.

    Args:
        codec: FFmpeg's name.
        data: the packet.
        extradata: of the codec; tells whether units have lengths or start codes.
    """
    if codec not in LENGTH_FIELD_AT:
        return True
    slices = [
        first for first in _first_bytes(codec, bytes(data[:LOOK_BYTES]), extradata) if _is_slice(codec, first)
    ]
    return not slices or any(_is_referenced(codec, first) for first in slices)


def _is_slice(codec: str, first: int) -> bool:
    return 1 <= first & 31 <= 5 if codec == "h264" else first >> 1 & 63 < 32


def _is_referenced(codec: str, first: int) -> bool:
    if codec == "h264":
        return bool(first & 0x60)
    kind = first >> 1 & 63
    return kind >= 16 or bool(kind % 2)


def _first_bytes(codec: str, data: bytes, extradata: bytes) -> Iterator[int]:
    """The first byte of each NAL unit."""
    at = LENGTH_FIELD_AT[codec]
    has_lengths = len(extradata) > at and extradata[0] == 1
    if not has_lengths:
        yield from (data[m.end()] for m in START_CODE.finditer(data) if m.end() < len(data))
        return
    count, at = (extradata[at] & 3) + 1, 0
    while at + count < len(data):
        yield data[at + count]
        at += count + int.from_bytes(data[at : at + count], "big")

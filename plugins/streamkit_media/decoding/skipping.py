"""Which packets a slow machine can leave out without harm to the pictures it shows.

Source: ITU-T H.264, 7.4.1 (nal_ref_idc); H.265, table 7-1 (sub-layer non-reference pictures).
"""

from __future__ import annotations

from streamkit_media.nalunits import LENGTH_FIELD_AT, length_field, units

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
    found = units(bytes(data[:LOOK_BYTES]), length_field(codec, extradata))
    slices = [unit[0] for unit in found if unit and _is_slice(codec, unit[0])]
    return not slices or any(_is_referenced(codec, first) for first in slices)


def _is_slice(codec: str, first: int) -> bool:
    return 1 <= first & 31 <= 5 if codec == "h264" else first >> 1 & 63 < 32


def _is_referenced(codec: str, first: int) -> bool:
    if codec == "h264":
        return bool(first & 0x60)
    kind = first >> 1 & 63
    return kind >= 16 or bool(kind % 2)

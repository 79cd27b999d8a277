"""Keyframes of VP9, which FFmpeg does not mark in what it receives over RTP.

Source: VP9 Bitstream and Decoding Process Specification 0.6, 6.2 (uncompressed header).
"""

from __future__ import annotations

PROFILE_3 = 0x30  # its two bits; a reserved bit follows them


def is_keyframe(data: bytes | memoryview) -> bool:
    """Whether decoding can begin with a packet: its frame is coded, and of the type of keyframes."""
    if not len(data):
        return False
    first = data[0] << (data[0] & PROFILE_3 == PROFILE_3)
    shows_existing_frame, is_inter_frame = first & 0x08, first & 0x04
    return not (shows_existing_frame or is_inter_frame)

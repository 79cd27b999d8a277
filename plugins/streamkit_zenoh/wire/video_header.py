"""The header of a coded video packet, and the codec string that browsers name its codec by."""

from __future__ import annotations

import base64
import re
from typing import Annotated, Literal

import msgspec

from streamkit import Frame, FrameFlags, mask_secrets

VIDEO_SCHEMA: Literal["streamkit.video/1"] = "streamkit.video/1"
VIDEO_CAPS = "video/x-h264; video/x-h265"
LOOK_BYTES = 4096
SIDES = ("width", "height")
START_CODE = re.compile(b"\0\0\1")
EMULATION_PREVENTION = b"\0\0\3"


class VideoHeader(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The second line of a packet's attachment, as JSON; None is unknown.

    Attributes:
        schema: name and version of the schema.
        source: the publisher's key.
        seq: number of the packet at its source, in decoding order.
        epoch: increases when `pts_ns` restarts.
        pts_ns: that of the decoded frame, and of its track record.
        duration_ns: of the frame.
        capture_ns: UTC of capture.
        published_ns: UTC of publishing.
        keyframe: whether decoding can begin with this packet.
        codec: RFC 6381 string such as `avc1.640028`; in keyframes, and None where no parameter set is found.
        codec_data: parameter sets as base64, in keyframes: an avcC or hvcC box, then NAL units in packets
            have lengths; or units with start codes. None where they are in the packets.
        width: of the packet's frame, px.
        height: px.
        flipped: whether the frame is to be turned upside down for display, as `decode` does.
        rotation: by which it is to be rotated counter-clockwise after that, degrees.
    """

    schema: Literal["streamkit.video/1"]
    source: str
    seq: int
    epoch: int
    pts_ns: int | None = None
    duration_ns: int | None = None
    capture_ns: int | None = None
    published_ns: int
    keyframe: bool = False
    codec: Annotated[str, msgspec.Meta(max_length=64)] | None = None
    codec_data: Annotated[str, msgspec.Meta(max_length=65536)] | None = None
    width: int | None = None
    height: int | None = None
    flipped: bool = False
    rotation: Literal[0, 90, 180, 270] = 0


def video_header(frame: Frame, source: str, published_ns: int) -> bytes:
    """Encodes the header of a coded packet."""
    keyframe = bool(frame.flags & FrameFlags.KEYFRAME)
    codec_data = bytes.fromhex(str(frame.caps.get("codec_data", ""))) if keyframe else b""
    width, height = (size if isinstance(size := frame.caps.get(side), int) else None for side in SIDES)
    header = VideoHeader(
        schema=VIDEO_SCHEMA,
        source=mask_secrets(source),
        seq=frame.seq,
        epoch=frame.epoch,
        pts_ns=frame.pts,
        duration_ns=frame.duration,
        capture_ns=frame.capture.utc_ns if frame.capture else None,
        published_ns=published_ns,
        keyframe=keyframe,
        codec=codec_string(frame.caps.name, codec_data, bytes(frame.data)) if keyframe else None,
        codec_data=base64.b64encode(codec_data).decode() if codec_data else None,
        width=width,
        height=height,
        flipped=bool(frame.caps.get("flipped")),
        rotation=frame.caps.get("rotation", 0),  # type: ignore[arg-type]
    )
    return msgspec.json.encode(header)


def codec_string(media_type: str, codec_data: bytes, packet: bytes) -> str | None:
    """The codec as RFC 6381 names it, from the parameter sets; None where they are missing or cut short.

    Args:
        media_type: `video/x-h264` or `video/x-h265`.
        codec_data: avcC or hvcC box, Annex B units or b"".
        packet: a keyframe.

    Source: ISO/IEC 14496-15, 5.3.3.1 (avcC), 8.3.3.1 (hvcC) and annex E.
    """
    is_box = codec_data[:1] == b"\x01"
    if media_type == "video/x-h264":
        profile = codec_data[1:4] if is_box else _sequence_parameters(codec_data, packet, 0x1F, 7)[1:4]
        return f"avc1.{profile.hex()}" if len(profile) == 3 else None
    # Two bytes of NAL unit header and one of identifiers precede profile, tier and level.
    profile = codec_data[1:13] if is_box else _sequence_parameters(codec_data, packet, 0x7E, 33 << 1)[3:15]
    return _hevc_string(profile) if len(profile) == 12 else None


def _hevc_string(profile: bytes) -> str:
    space = ("", "A", "B", "C")[profile[0] >> 6]
    tier = "H" if profile[0] & 0x20 else "L"
    compatible = int(f"{int.from_bytes(profile[1:5], 'big'):032b}"[::-1], 2)
    constraints = "".join(f".{byte:X}" for byte in profile[5:11].rstrip(b"\0"))
    return f"hev1.{space}{profile[0] & 31}.{compatible:X}.{tier}{profile[11]}{constraints}"


def _sequence_parameters(codec_data: bytes, packet: bytes, mask: int, kind: int) -> bytes:
    """The beginning of the sequence parameter set, without emulation prevention; b"" where none is found."""
    for unit in START_CODE.split(codec_data + packet[:LOOK_BYTES])[1:]:
        if unit and unit[0] & mask == kind:
            return unit.replace(EMULATION_PREVENTION, b"\0\0")
    return b""

"""Checks H.264 and H.265 parameter sets before FFmpeg's muxers read them.

The muxers of MP4 and Matroska make the file's head of them without checks: a damaged count in one of H.265
keeps them busy for minutes, with the interpreter's lock held. FFmpeg's bitstream filters check the range of
every field; what they refuse and the decoder takes is harmless.

Source: ITU-T H.264, 7.3.2; H.265, 7.3.2.
"""

from __future__ import annotations

from av.bitstream import BitStreamFilterContext
from av.codec.context import CodecContext
from av.error import FFmpegError, InvalidDataError
from av.packet import Packet
from av.video.codeccontext import VideoCodecContext

from streamkit_media.nalunits import START_CODE, BadPacket, typed_units

# Sequence parameter sets, and video parameter sets of H.265. Picture parameter sets may belong to other
# layers, whose sequence parameter sets the filters do not know.
CHECKED_TYPES = {"h264": frozenset({7}), "hevc": frozenset({32, 33})}


def check_parameter_sets(codec: str, data: bytes) -> None:
    """Checks the parameter sets in a keyframe's packet.

    Args:
        codec: FFmpeg's name; only h264 and hevc are checked.
        data: the packet, in Annex B.

    Raises:
        BadPacket: a field of a set is out of its range or a set is cut short, and the packet does not decode.
    """
    kinds = CHECKED_TYPES.get(codec)
    if kinds is None:
        return
    sets = [START_CODE + unit for kind, unit in typed_units(codec, data) if kind in kinds]
    if not sets:
        return
    try:
        BitStreamFilterContext(f"{codec}_metadata", codec).filter(Packet(b"".join(sets)))
    except InvalidDataError:
        if not _decodes(codec, data):  # some encoders break the rules in harmless ways
            raise BadPacket("its parameter sets are damaged") from None
    except FFmpegError:
        return  # an extension that the filter does not know


def _decodes(codec: str, data: bytes) -> bool:
    context = CodecContext.create(codec, "r")
    assert isinstance(context, VideoCodecContext)
    context.thread_count = 1
    packet = Packet(len(data))
    packet.update(data)
    try:
        return bool(context.decode(packet) or context.decode(None))
    except FFmpegError:
        return False

"""Checks H.264 and H.265 parameter sets before FFmpeg's muxers read them.

The muxers of MP4 and Matroska read the sets without limits: a damaged count keeps them busy for minutes, with
the interpreter's lock held. FFmpeg's bitstream filters check the range of every field.

Source: ITU-T H.264, 7.3.2; H.265, 7.3.2.
"""

from __future__ import annotations

from av.bitstream import BitStreamFilterContext
from av.error import FFmpegError, InvalidDataError
from av.packet import Packet

from streamkit_decoder.nalunits import units
from streamkit_decoder.recording.annexb import KINDS_BEFORE_PICTURE, START_CODE, BadPacket, kind_of


def check_parameter_sets(codec: str, data: bytes) -> None:
    """Checks the parameter sets in a packet.

    Args:
        codec: FFmpeg's name; only h264 and hevc are checked.
        data: the packet, in Annex B.

    Raises:
        BadPacket: a field of a set is out of its range, or a set is cut short.
    """
    kinds = KINDS_BEFORE_PICTURE.get(codec)
    if kinds is None:
        return
    sets = [START_CODE + unit for unit in units(data) if unit and kind_of(codec, unit[0]) in kinds]
    if not sets:
        return
    try:
        BitStreamFilterContext(f"{codec}_metadata", codec).filter(Packet(b"".join(sets)))
    except InvalidDataError:
        raise BadPacket(f"the parameter sets of {codec} are damaged") from None
    except FFmpegError:
        return  # an extension that the filter does not know

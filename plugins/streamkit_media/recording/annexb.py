"""H.264 and H.265 packets as transport streams carry them: with start codes and parameter sets.

Source: ITU-T H.264 and H.265, annex B.
"""

from __future__ import annotations

from streamkit_media.nalunits import (
    CODECS,
    START_CODE,
    START_CODES,
    length_field,
    parameter_sets,
    unit_type,
    units,
)

PARAMETER_SET_TYPES = {"h264": {7, 8}, "hevc": {32, 33, 34}}
LOOK_BYTES = 4096


class AnnexBWriter:
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
        """The packet; a key frame begins with the parameter sets, so that playing can begin there.

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
        return any(unit and unit_type(self._codec, unit[0]) in types for unit in units(data[:LOOK_BYTES]))

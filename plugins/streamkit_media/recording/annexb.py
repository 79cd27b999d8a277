"""H.264 and H.265 packets in the form that transport streams carry: start codes, parameter sets within.

Source: ISO/IEC 14496-15 (avcC, hvcC and length-prefixed samples); ITU-T H.264 and H.265, Annex B.
"""

from __future__ import annotations

import re

START_CODE = b"\0\0\0\1"
BEGINS_WITH_START_CODE = re.compile(b"\0\0\0?\1")
AVCC_HEADER, HVCC_HEADER = 6, 23
KINDS_BEFORE_PICTURE = {"h264": {7, 8}, "hevc": {32, 33, 34}}


class BadPacket(ValueError):
    """A packet or header whose lengths lead out of it."""


class AnnexBWriter:
    """Turns length-prefixed packets into Annex B; ones that are so already pass, as do other codecs.

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
        if codec not in KINDS_BEFORE_PICTURE or not extradata:
            return
        if BEGINS_WITH_START_CODE.match(extradata):
            self._parameter_sets = extradata
        elif codec == "h264":
            self._read_avcc(extradata)
        else:
            self._read_hvcc(extradata)

    def packet(self, data: bytes, is_keyframe: bool) -> bytes:
        """The packet; a key frame begins with the parameter sets, so that playing can begin there.

        Raises:
            BadPacket: its lengths lead out of it.
        """
        if self._codec not in KINDS_BEFORE_PICTURE:
            return data
        if self._length_bytes:
            data = b"".join(START_CODE + nal for nal in self._split(data))
        if not is_keyframe or not self._parameter_sets or self._holds_parameter_sets(data):
            return data
        return self._parameter_sets + data

    def _split(self, data: bytes) -> list[bytes]:
        nals, at = [], 0
        while at < len(data):
            end = at + self._length_bytes
            size = int.from_bytes(data[at:end], "big")
            if end + size > len(data):
                raise BadPacket(f"a NAL unit of {size} bytes leads out of its packet of {len(data)}")
            nals.append(data[end : end + size])
            at = end + size
        return nals

    def _holds_parameter_sets(self, data: bytes) -> bool:
        kinds = KINDS_BEFORE_PICTURE[self._codec]
        starts = [match.end() for match in BEGINS_WITH_START_CODE.finditer(data[:4096])]
        return any(kind_of(self._codec, data[at]) in kinds for at in starts if at < len(data))

    def _read_avcc(self, data: bytes) -> None:
        if len(data) < AVCC_HEADER + 1:
            raise BadPacket(f"avcC has at least {AVCC_HEADER + 1} bytes, got {len(data)}")
        self._length_bytes = (data[4] & 3) + 1
        found, at = self._read_sets(data, AVCC_HEADER, data[5] & 31)
        if at < len(data):
            more, _ = self._read_sets(data, at + 1, data[at])
            found += more
        self._parameter_sets = b"".join(START_CODE + nal for nal in found)

    def _read_hvcc(self, data: bytes) -> None:
        if len(data) < HVCC_HEADER:
            raise BadPacket(f"hvcC has at least {HVCC_HEADER} bytes, got {len(data)}")
        self._length_bytes = (data[21] & 3) + 1
        found: list[bytes] = []
        at = HVCC_HEADER
        for _ in range(data[22]):
            if at + 3 > len(data):
                raise BadPacket("hvcC ends within an array of parameter sets")
            more, at = self._read_sets(data, at + 3, int.from_bytes(data[at + 1 : at + 3], "big"))
            found += more
        self._parameter_sets = b"".join(START_CODE + nal for nal in found)

    @staticmethod
    def _read_sets(data: bytes, at: int, count: int) -> tuple[list[bytes], int]:
        found = []
        for _ in range(count):
            size = int.from_bytes(data[at : at + 2], "big")
            if at + 2 + size > len(data):
                raise BadPacket("a parameter set leads out of the codec's header")
            found.append(data[at + 2 : at + 2 + size])
            at += 2 + size
        return found, at


def kind_of(codec: str, first: int) -> int:
    """The kind of a NAL unit, which its first byte tells; `codec` is h264 or hevc."""
    return first & 31 if codec == "h264" else first >> 1 & 63

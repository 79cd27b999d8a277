"""KLV framing: packets found in a stream of bytes that may be cut anywhere, and may be damaged.

Source: SMPTE ST 336 (key, BER length, value); MISB ST 0601, "Checksum".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

KEY_PREFIX = bytes.fromhex("060e2b34")
KEY_BYTES = 16
UAS_LOCAL_SET = bytes.fromhex("060e2b34020b01010e01030101000000")
# A damaged length must not make us wait for a gigabyte.
LONGEST_VALUE = 1 << 16
CHECKSUM_HEAD = b"\x01\x02"


class BadKlv(ValueError):
    """Bytes that are not what the standard says."""


@dataclass(frozen=True, slots=True)
class KlvPacket:
    """One packet.

    Attributes:
        key: 16 bytes.
        value: what the length covers.
        data: the whole packet, key to end.
    """

    key: bytes
    value: bytes
    data: bytes

    @property
    def checksum_is_good(self) -> bool:
        """Whether the packet ends in a checksum element (tag 1) that fits."""
        if len(self.value) < 4 or self.value[-4:-2] != CHECKSUM_HEAD:
            return False
        return checksum(self.data[:-2]) == int.from_bytes(self.data[-2:], "big")


def checksum(data: bytes) -> int:
    """The 16-bit sum of a packet from its key to the checksum's own length byte.

    Source: MISB ST 0601, "Checksum": bytes at even places count 256-fold, modulo 65536.
    """
    return (sum(data[0::2]) * 256 + sum(data[1::2])) & 0xFFFF


def read_length(data: bytes, at: int) -> tuple[int, int] | None:
    """A BER length and where the value begins; None where the bytes end before it does.

    Raises:
        BadKlv: the form is not allowed (indefinite or longer than eight bytes).
    """
    if at >= len(data):
        return None
    first = data[at]
    if first < 0x80:
        return first, at + 1
    count = first & 0x7F
    if not 1 <= count <= 8:
        raise BadKlv(f"a BER length has one to eight bytes, this one has {count}")
    if at + 1 + count > len(data):
        return None
    return int.from_bytes(data[at + 1 : at + 1 + count], "big"), at + 1 + count


def read_tag(data: bytes, at: int) -> tuple[int, int] | None:
    """A BER-OID tag and where its length begins; None where the bytes end before it does.

    Raises:
        BadKlv: the tag has more than four bytes.
    """
    tag = 0
    for count, byte in enumerate(data[at : at + 4], 1):
        tag = tag << 7 | byte & 0x7F
        if byte < 0x80:
            return tag, at + count
    if at + 4 <= len(data):
        raise BadKlv("a tag has at most four bytes")
    return None


def elements(value: bytes) -> Iterator[tuple[int, bytes]]:
    """The tags and values of a local set.

    Raises:
        BadKlv: an element reaches beyond the set's end.
    """
    at = 0
    while at < len(value):
        tag = read_tag(value, at)
        length = read_length(value, tag[1]) if tag is not None else None
        if tag is None or length is None or length[1] + length[0] > len(value):
            raise BadKlv(f"the element at byte {at} reaches beyond the end of its set")
        yield tag[0], value[length[1] : length[1] + length[0]]
        at = length[1] + length[0]


class KlvReader:
    """Finds packets in bytes as they come; joins split ones, and finds its way again after damage.

    Attributes:
        good: packets with a checksum that fits.
        bad: keys that began a packet whose checksum or form is wrong; nothing of them is used.
        skipped: bytes that belong to no good packet.
    """

    def __init__(self) -> None:
        self._buffer = b""
        self.good = 0
        self.bad = 0
        self.skipped = 0

    def feed(self, data: bytes) -> list[KlvPacket]:
        """The good packets that are complete with these bytes."""
        self._buffer += data
        return self._packets(is_end=False)

    def finish(self) -> list[KlvPacket]:
        """No bytes follow: what hides behind a packet that was cut short comes out."""
        found = self._packets(is_end=True)
        self._skip(len(self._buffer))
        return found

    def _packets(self, is_end: bool) -> list[KlvPacket]:
        found = []
        while self._find_key():
            packet = self._packet_here()
            # A key within a packet that never ends: its length is damaged, nothing is worth waiting for.
            if packet is None and not is_end and self._buffer.find(UAS_LOCAL_SET, 1) < 0:
                break
            if packet is not None and packet.checksum_is_good:
                self.good += 1
                self._buffer = self._buffer[len(packet.data) :]
                found.append(packet)
                continue
            # Not the length but the next key tells where to go on: the length may be what is damaged.
            self.bad += 1
            self._skip(1)
        return found

    def _find_key(self) -> bool:
        """Drops what lies before the next key; False where none is there."""
        at = self._buffer.find(KEY_PREFIX)
        if at < 0:
            self._skip(max(0, len(self._buffer) - len(KEY_PREFIX) + 1))
            return False
        self._skip(at)
        return True

    def _packet_here(self) -> KlvPacket | None:
        """The packet at the buffer's start; None while bytes are missing. One too long counts as broken."""
        data = self._buffer
        if len(data) <= KEY_BYTES:
            return None
        try:
            length = read_length(data, KEY_BYTES)
        except BadKlv:
            return KlvPacket(data[:KEY_BYTES], b"", data[:KEY_BYTES])
        if length is None:
            return None
        size, begin = length
        if size > LONGEST_VALUE:
            return KlvPacket(data[:KEY_BYTES], b"", data[:KEY_BYTES])
        if begin + size > len(data):
            return None
        return KlvPacket(data[:KEY_BYTES], data[begin : begin + size], data[: begin + size])

    def _skip(self, count: int) -> None:
        self.skipped += count
        self._buffer = self._buffer[count:]

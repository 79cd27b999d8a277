"""KLV framing: finds packets in a byte stream that may be split anywhere and may be damaged.

Source: SMPTE ST 336 (key, BER length, value); MISB ST 0601, "Checksum"; MISB EG 0104.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

KEY_PREFIX = bytes.fromhex("060e2b34")
KEY_BYTES = 16
UAS_LOCAL_SET = bytes.fromhex("060e2b34020b01010e01030101000000")
UNIVERSAL_SET = bytes.fromhex("060e2b34020101010e01010201010000")
# The two sets that are read; the registry's version (byte 8) and the last three bytes may differ.
LOCAL_SET_KEY = rb"\x02\x0b\x01.\x0e\x01\x03\x01\x01..."
UNIVERSAL_SET_KEY = rb"\x02\x01\x01.\x0e\x01\x01\x02\x01..."
SET_KEY = re.compile(
    re.escape(KEY_PREFIX) + b"(?:" + LOCAL_SET_KEY + b"|" + UNIVERSAL_SET_KEY + b")", re.DOTALL
)
# A damaged length must not make the reader wait for a gigabyte.
LONGEST_VALUE = 1 << 16
CHECKSUM_HEAD = b"\x01\x02"
# The universal set has 29 elements; without a limit a hostile stream makes each search long.
MOST_UNIVERSAL_ELEMENTS = 64


class BadKlv(ValueError):
    """The bytes violate the standard."""


@dataclass(frozen=True, slots=True)
class KlvPacket:
    """One packet.

    Attributes:
        key: 16 bytes.
        value: the bytes that the length counts.
        data: the whole packet, key to end.
    """

    key: bytes
    value: bytes
    data: bytes

    @property
    def is_universal_set(self) -> bool:
        """Whether it is the older universal set, whose elements have whole keys and which has no checksum."""
        return self.key[4:6] == UNIVERSAL_SET[4:6]


def checksum(data: bytes) -> int:
    """The 16-bit sum of a packet from its key to the checksum's own length byte.

    Source: MISB ST 0601, "Checksum": bytes at even offsets count 256 times, modulo 65536.
    """
    return (sum(data[0::2]) * 256 + sum(data[1::2])) & 0xFFFF


def second_byte_sums(data: bytes) -> NDArray[np.int64]:
    """int64[n + 2]: entry i + 2 is the sum of the bytes i, i - 2, i - 4, ... of n bytes.

    From it the checksum of any part takes constant time, however many candidates overlap.
    """
    values = np.frombuffer(data, np.uint8)
    sums = np.zeros(len(values) + 2, np.int64)
    for parity in (0, 1):
        np.cumsum(values[parity::2], out=sums[2 + parity :: 2])
    return sums


def checksum_from_sums(sums: NDArray[np.int64], begin: int, end: int) -> int:
    """The checksum of the bytes from `begin` to before `end`, out of all `second_byte_sums`; end > begin."""
    last, other = (end + 1, end) if (end - begin) % 2 else (end, end + 1)
    high, low = sums[last] - sums[begin], sums[other] - sums[begin + 1]
    return int(high * 256 + low) & 0xFFFF


def read_length(data: bytes, at: int) -> tuple[int, int] | None:
    """A BER length and the offset of the value; None if the bytes end within the length.

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
    """A BER-OID tag and the offset of its length; None if the bytes end within the tag.

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


def universal_elements(value: bytes) -> Iterator[tuple[bytes, bytes]]:
    """The keys (16 bytes) and values of a universal set.

    Raises:
        BadKlv: an element has no key or reaches beyond the set's end, or there are too many.
    """
    at = count = 0
    while at < len(value):
        count += 1
        length = read_length(value, at + KEY_BYTES)
        is_cut = length is None or length[1] + length[0] > len(value)
        if is_cut or value[at : at + len(KEY_PREFIX)] != KEY_PREFIX or count > MOST_UNIVERSAL_ELEMENTS:
            raise BadKlv(f"byte {at} of the universal set is no element, or the one there does not end in it")
        assert length is not None
        yield value[at : at + KEY_BYTES], value[length[1] : length[1] + length[0]]
        at = length[1] + length[0]


class KlvReader:
    """Finds packets in bytes as they arrive; joins split packets, and resynchronises after damage.

    It searches for the keys of the UAS local set and the universal set, and skips other packets.

    Attributes:
        good: packets with a correct checksum, and universal sets whose elements fit.
        bad: keys that begin a packet with a wrong checksum or form; such packets are not used.
        skipped: bytes outside of good packets.
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
        """The packets after one that was cut short; no bytes follow."""
        return self._packets(is_end=True)

    def _packets(self, is_end: bool) -> list[KlvPacket]:
        data, found = self._buffer, list[KlvPacket]()
        candidates = _Candidates(data)
        at = 0
        while (begin := candidates.next_key(at)) is not None:
            self.skipped += begin - at
            at = begin
            end = candidates.end_of(at)
            # Another key inside an incomplete packet: its length is damaged, so do not wait for its end.
            if end is None and not is_end and candidates.last_key <= at:
                break
            packet = None if end is None else candidates.packet(at, end)
            if packet is not None:
                self.good += 1
                found.append(packet)
                at += len(packet.data)
            else:
                # Continue at the next key, not after the length, which may be damaged.
                self.bad += 1
                self.skipped += 1
                at += 1
        else:
            # The last bytes may be the beginning of a key.
            kept = 0 if is_end else min(len(data) - at, KEY_BYTES - 1)
            self.skipped += len(data) - kept - at
            at = len(data) - kept
        self._buffer = data[at:]
        return found


class _Candidates:
    """The offsets in a buffer at which a packet may begin; each is checked in constant time.

    Attributes:
        last_key: position of the last key of a set; -1 if there is none.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._sums: NDArray[np.int64] | None = None
        self.last_key = max(data.rfind(UAS_LOCAL_SET[:7]), data.rfind(UNIVERSAL_SET[:7]))

    def next_key(self, at: int) -> int | None:
        """Position of the next key of a set."""
        found = SET_KEY.search(self._data, at)
        return None if found is None else found.start()

    def end_of(self, at: int) -> int | None:
        """End of the packet at `at`: `at` itself if its length is invalid, None if it is incomplete."""
        try:
            length = read_length(self._data, at + KEY_BYTES)
        except BadKlv:
            return at
        if length is None:
            return None
        if length[0] > LONGEST_VALUE:
            return at
        end = length[0] + length[1]
        return end if end <= len(self._data) else None

    def packet(self, begin: int, end: int) -> KlvPacket | None:
        """The packet from `begin` to `end`; None if its checksum or form is wrong."""
        length = read_length(self._data, begin + KEY_BYTES) if end > begin else None
        if length is None or end == length[1]:
            return None
        packet = KlvPacket(
            self._data[begin : begin + KEY_BYTES], self._data[length[1] : end], self._data[begin:end]
        )
        is_good = (
            self._elements_fit(packet)
            if packet.is_universal_set
            else self._checksum_fits(begin, end, length[0])
        )
        return packet if is_good else None

    def _checksum_fits(self, begin: int, end: int, size: int) -> bool:
        data = self._data
        if size < 4 or data[end - 4 : end - 2] != CHECKSUM_HEAD:
            return False
        if self._sums is None:
            self._sums = second_byte_sums(data)
        return checksum_from_sums(self._sums, begin, end - 2) == int.from_bytes(data[end - 2 : end], "big")

    def _elements_fit(self, packet: KlvPacket) -> bool:
        try:
            return bool(list(universal_elements(packet.value)))
        except BadKlv:
            return False

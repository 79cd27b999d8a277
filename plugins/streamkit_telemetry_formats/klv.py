"""KLV framing: finds packets in a byte stream that may be split anywhere and may be damaged.

Source: SMPTE ST 336 (key, BER length, value); MISB ST 0601, "Checksum"; MISB EG 0104.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Key = TypeVar("Key")

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
CHUNK_BYTES = 1 << 16  # that a file is read in
# A damaged length must not make the reader wait for a gigabyte.
MAX_VALUE_BYTES = 1 << 16
CHECKSUM_HEAD = b"\x01\x02"
# The universal set has 29 elements; without a limit a hostile stream makes each search long.
MAX_UNIVERSAL_ELEMENTS = 64


class BadKlv(ValueError):
    """The bytes violate the standard."""


def holds_klv(path: Path) -> bool:
    """Whether the first 64 KB of a file hold a key of a telemetry set.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return SET_KEY.search(file.read(CHUNK_BYTES)) is not None


@dataclass(frozen=True, slots=True)
class KlvPacket:
    """One packet."""

    value: bytes  # the bytes that the length counts
    data: bytes  # the whole packet, key to end

    @property
    def is_universal_set(self) -> bool:
        """Whether it is the older universal set, whose elements have whole keys and which has no checksum."""
        return self.data[4:6] == UNIVERSAL_SET[4:6]


def prefix_sums(data: bytes) -> NDArray[np.int64]:
    """int64[2, n + 1]: weighted sums of the bytes before each offset, by which any part is checked at once.

    Row 0 counts the bytes at even offsets 256 times, row 1 those at odd offsets, and the others once.
    """
    is_odd = np.arange(len(data)) % 2
    weighted = np.frombuffer(data, np.uint8) * np.where(is_odd == [[0], [1]], 256, 1)
    return np.pad(np.cumsum(weighted, axis=1), [(0, 0), (1, 0)])


def checksum(data: bytes) -> int:
    """The 16-bit sum of a packet from its key to the checksum's own length byte.

    Source: MISB ST 0601, "Checksum": bytes at even offsets count 256 times, modulo 65536.
    """
    return int(prefix_sums(data)[0, -1]) & 0xFFFF


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
    end = at + 1 + count
    return (int.from_bytes(data[at + 1 : end], "big"), end) if end <= len(data) else None


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


def read_key(data: bytes, at: int) -> tuple[bytes, int] | None:
    """A key of 16 bytes and the offset of its length; None if there is none."""
    key = data[at : at + KEY_BYTES]
    return (key, at + KEY_BYTES) if key.startswith(KEY_PREFIX) else None


def elements(value: bytes) -> Iterator[tuple[int, bytes]]:
    """The tags and values of a local set.

    Raises:
        BadKlv: an element reaches beyond the set's end.
    """
    return _elements(value, read_tag)


def universal_elements(value: bytes) -> Iterator[tuple[bytes, bytes]]:
    """The keys (16 bytes) and values of a universal set.

    Raises:
        BadKlv: an element has no key or reaches beyond the set's end, or there are too many.
    """
    for count, item in enumerate(_elements(value, read_key)):
        if count == MAX_UNIVERSAL_ELEMENTS:
            raise BadKlv(f"a universal set has at most {MAX_UNIVERSAL_ELEMENTS} elements")
        yield item


def _elements(
    value: bytes, read: Callable[[bytes, int], tuple[Key, int] | None]
) -> Iterator[tuple[Key, bytes]]:
    at = 0
    while at < len(value):
        key = read(value, at)
        length = read_length(value, key[1]) if key is not None else None
        if key is None or length is None or sum(length) > len(value):
            raise BadKlv(f"the element at byte {at} reaches beyond the end of its set, or has no key")
        at = sum(length)
        yield key[0], value[length[1] : at]


class KlvReader:
    """Finds packets in bytes as they arrive; joins split packets, and resynchronises after damage.

    It searches for the keys of the UAS local set and the universal set, and skips other packets.
    """

    def __init__(self) -> None:
        self._buffer = b""
        self.good = 0  # packets with a correct checksum, and universal sets whose elements fit
        self.bad = 0  # keys that begin a packet with a wrong checksum or form; such packets are not used
        self.skipped = 0  # bytes outside of good packets

    def feed(self, data: bytes) -> list[KlvPacket]:
        """The good packets that are complete with these bytes."""
        self._buffer += data
        return self._packets(is_end=False)

    def finish(self) -> list[KlvPacket]:
        """The packets after one that was cut short; no bytes follow."""
        return self._packets(is_end=True)

    def _packets(self, is_end: bool) -> list[KlvPacket]:
        data, found, at = self._buffer, list[KlvPacket](), 0
        sums = cache(partial(prefix_sums, data))
        last_key = max(data.rfind(UAS_LOCAL_SET[:7]), data.rfind(UNIVERSAL_SET[:7]))
        while (key := SET_KEY.search(data, at)) is not None:
            self.skipped += key.start() - at
            at = key.start()
            try:
                packet = _read_packet(data, at, sums)
            except BadKlv:
                packet = None
            else:
                # Another key inside an incomplete packet: its length is damaged, so do not wait for its end.
                if packet is None and not is_end and last_key <= at:
                    break
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


def _read_packet(data: bytes, begin: int, sums: Callable[[], NDArray[np.int64]]) -> KlvPacket | None:
    """The packet that begins with the key at `begin`; None where its end has not come yet.

    Raises:
        BadKlv: its length, form or checksum is wrong.
    """
    length = read_length(data, begin + KEY_BYTES)
    if length is None:
        return None
    size, at = length
    if not 4 <= size <= MAX_VALUE_BYTES:
        raise BadKlv(f"a set has 4 to {MAX_VALUE_BYTES} bytes, this one has {size}")
    end = at + size
    if end > len(data):
        return None
    if data[begin + 4 : begin + 6] == UNIVERSAL_SET[4:6]:
        for _ in universal_elements(data[at:end]):
            pass  # without a checksum, its elements must fit
    else:
        before, behind = sums()[begin % 2, [begin, end - 2]]
        expected = CHECKSUM_HEAD + (int(behind - before) & 0xFFFF).to_bytes(2, "big")
        if data[end - 4 : end] != expected:
            raise BadKlv("the checksum is wrong or missing")
    return KlvPacket(data[at:end], data[begin:end])

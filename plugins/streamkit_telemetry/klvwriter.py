"""KLV framing for writing: lengths, tags, elements and packets with their checksum.

Source: SMPTE ST 336 (BER length, BER-OID); MISB ST 0107 (numbers); ST 0601 (checksum).
"""

from __future__ import annotations

from streamkit_telemetry_formats.klv import CHECKSUM_HEAD, UAS_LOCAL_SET, checksum


def ber_length(size: int) -> bytes:
    """A length in the shortest form."""
    if size < 0x80:
        return bytes([size])
    data = shortest(size)
    return bytes([0x80 | len(data)]) + data


def ber_oid(number: int) -> bytes:
    """A tag or identifier: seven bits a byte, all but the last with the highest bit set."""
    data = [number & 0x7F]
    while number := number >> 7:
        data.insert(0, 0x80 | number & 0x7F)
    return bytes(data)


def element(tag: int, value: bytes) -> bytes:
    """One element of a local set."""
    return ber_oid(tag) + ber_length(len(value)) + value


def local_set_packet(elements: bytes) -> bytes:
    """A UAS local set of these elements followed by their checksum; the time stamp must be the first."""
    data = UAS_LOCAL_SET + ber_length(len(elements) + 4) + elements + CHECKSUM_HEAD
    return data + checksum(data).to_bytes(2, "big")


def shortest(number: int) -> bytes:
    """An unsigned integer in as few bytes as it needs, one at least."""
    return number.to_bytes(max(1, (number.bit_length() + 7) // 8), "big")


def unsigned_map(value: float, low: float, high: float, size: int) -> bytes | None:
    """A number mapped linearly from low..high onto an unsigned integer; None out of the range."""
    if not low <= value <= high:
        return None
    return round((value - low) / (high - low) * ((1 << 8 * size) - 1)).to_bytes(size, "big")


def signed_map(value: float, bound: float, size: int) -> bytes | None:
    """A number mapped linearly from -bound..bound onto a signed integer; None out of the range."""
    if not -bound <= value <= bound:
        return None
    return round(value / bound * ((1 << 8 * size - 1) - 1)).to_bytes(size, "big", signed=True)

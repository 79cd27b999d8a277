"""Telemetry that is well formed and hostile, or damaged, for `fuzz_telemetry.py`."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable

from streamkit_telemetry.st0601writer import ber_length, element, local_set_packet
from streamkit_telemetry_formats.klv import KEY_PREFIX, UAS_LOCAL_SET, UNIVERSAL_SET
from streamkit_telemetry_formats.misb import ELEMENTS

POSITION = element(13, b"\x10\0\0\0") + element(14, b"\x10\0\0\0")
EXTREMES = (
    b"\0",
    b"\xff",
    b"\x80",
    b"\x7f\xff",
    b"\x80\0",
    b"\xff" * 4,
    b"\x80\0\0\0",
    b"\xff" * 8,
    b"\xff" * 128,
)
UNIVERSAL_KEYS = [KEY_PREFIX + bytes.fromhex(key[:6]) + b"\x01" + bytes.fromhex(key[7:]) for key in ELEMENTS]
REALS = (0.0, -0.0, 1.5, -91.0, 1e300, math.inf, -math.inf, math.nan)
PIECES = (
    *(
        "1\n",
        "2\n",
        " --> ",
        "00:00:01,000 --> 00:00:02,000\n",
        "99:99:99,999 --> 00:00:00,000\n",
        "GPS(",
        "1.5",
        ",",
    ),
    *(
        ")",
        "[latitude: ",
        "[longtitude: 2.0]",
        "]",
        "n/a",
        "-",
        "9" * 400,
        "2018-09-02 10:22:05,325,621\n",
        "\n\n",
    ),
    *(
        "9999.12.31 23:59:59\n",
        "0001.01.01 00:00:00\n",
        "DiffTime : 33ms",
        "Hb:",
        "F.PRY (2, 3, 4)",
        "\ufeff",
        "\0",
    ),
)


def hostile_value(chance: random.Random) -> bytes:
    """Bytes of a value: extreme, of odd length, or any."""
    kind = chance.randrange(4)
    if kind == 0:
        return chance.choice(EXTREMES)
    if kind == 1:
        return chance.randbytes(chance.choice((0, 1, 2, 3, 4, 8, 9, 127, 128, 129, 200, 5000)))
    return chance.randbytes(chance.choice((1, 2, 4, 8)))


def local_set(chance: random.Random) -> bytes:
    """A UAS local set with a good checksum and any tags."""
    tags = [
        chance.choice((chance.randrange(1, 145), chance.randrange(1, 1 << 28)))
        for _ in range(chance.randrange(30))
    ]
    elements = POSITION * chance.randrange(2) + b"".join(element(tag, hostile_value(chance)) for tag in tags)
    if chance.random() < 0.3:  # elements that do not fit into their set
        elements += chance.choice((b"\x05\x80", b"\x05\x89" + bytes(9), b"\x81\x81\x81\x81\x81", b"\x05\x7f"))
    return local_set_packet(elements[:60_000])


def universal_set(chance: random.Random) -> bytes:
    """A universal set with any numbers."""
    parts = []
    for _ in range(chance.randrange(1, 70)):
        real = struct.pack(chance.choice((">f", ">d")), chance.choice(REALS[:4]))
        if chance.random() < 0.3:
            real = struct.pack(">d", chance.choice(REALS))
        value = chance.choice((real, real, hostile_value(chance)))
        parts.append(chance.choice(UNIVERSAL_KEYS) + ber_length(len(value)) + value)
    value = b"".join(parts)[:65_000]
    return UNIVERSAL_SET + ber_length(len(value)) + value


def damaged(data: bytes, chance: random.Random) -> bytes:
    """Cut short, with a wrong byte, or with a length that leads anywhere."""
    kind = chance.randrange(3)
    if kind == 0:
        return data[: chance.randrange(len(data))]
    if kind == 1:
        at = chance.randrange(len(data))
        return data[:at] + chance.randbytes(1) + data[at + 1 :]
    return (
        data[:16]
        + chance.choice((b"\x80", b"\x84\xff\xff\xff\xff", b"\x82\xff\xff", b"\xff", b"\x88"))
        + data[17:]
    )


def klv_stream(chance: random.Random) -> bytes:
    """Good, hostile and damaged packets and noise, one behind the other."""
    makers: tuple[Callable[[], bytes], ...] = (
        lambda: local_set(chance),
        lambda: local_set(chance),
        lambda: universal_set(chance),
        lambda: damaged(local_set(chance), chance),
        lambda: damaged(universal_set(chance), chance),
        lambda: chance.randbytes(chance.randrange(300)),
        lambda: chance.choice((KEY_PREFIX, UAS_LOCAL_SET, UNIVERSAL_SET)) * chance.randrange(1, 200),
    )
    return b"".join(chance.choice(makers)() for _ in range(chance.randrange(1, 20)))


def subtitles(chance: random.Random) -> str:
    """Subtitles, many of them broken."""
    found = []
    for n in range(chance.randrange(1, 40)):
        if chance.random() < 0.5:
            found.append(
                f"{n}\n00:00:{n:02},000 --> 00:00:{n + 1:02},000\nGPS({n / 10},{n},16) BAROMETER:1.9\n\n"
            )
        else:
            found.append("".join(chance.choice(PIECES) for _ in range(chance.randrange(1, 20))))
    return "".join(found)


def pieces(data: bytes, chance: random.Random) -> list[bytes]:
    """The bytes, cut as packets of a stream may be."""
    size = (
        chance.choice((1, 17, 188, 1024, 1 << 16))
        if len(data) < 4000
        else chance.choice((188, 1024, 1 << 16))
    )
    return [data[at : at + size] for at in range(0, len(data), size)]

"""Parses simple values: numbers, fractions, flag sets, booleans, strings, dates, bytes.

Source: the caps syntax of GStreamer's documentation ("Appendices: caps syntax") and GStreamer's results.
"""

from __future__ import annotations

import math
import re
import struct
import sys
from collections.abc import Callable
from datetime import date
from fractions import Fraction

from streamkit.flow.caps_values import (
    FRACTION_MAX,
    INT_MAX,
    INT_MIN,
    Bitmask,
    DateTime,
    FlagSet,
    Float32,
    Int64,
    Long,
    MultiviewFlags,
    NullText,
    UChar,
    UInt,
    UInt64,
    ULong,
    Value,
)

INTEGER = re.compile(r"[+-]?(?:0[xX][0-9A-Fa-f]{1,40}|0[0-7]{0,40}|[1-9][0-9]{0,40})")
FLOAT = re.compile(r"[+-]?(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+)(?:[eE][+-]?[0-9]+)?")
HEX = re.compile(r"[+-]?0[xX][0-9A-Fa-f]{1,40}\.?[0-9A-Fa-f]{0,40}(?:[pP][+-]?[0-9]{1,5})?")
FRACTION = re.compile(r"([+-]?[0-9]{1,40})(?:/([+-]?[0-9]{1,40}))?")
FLAGS = r"(?:0[xX])?([0-9A-Fa-f]{1,8}):(?:0[xX])?([0-9A-Fa-f]{1,8})(?::(?:[+/][A-Za-z0-9_-]+)*)?"
DATE = r"([0-9]{1,4})-([0-9]{1,2})-([0-9]{1,2})"
DATE_TIME = (
    r"[0-9]{4}(?:-[01][0-9](?:-[0-3][0-9](?:T[0-2][0-9]:[0-5][0-9](?::[0-5][0-9](?:\.[0-9]{1,6})?)?"
    r"(?:Z|[+-][01][0-9](?::?[0-5][0-9])?)?)?)?)?"
)
BYTES = r'""|((?:[0-9A-Fa-f]{2})*)'
ESCAPE = re.compile(rb"\\([0-3][0-7]{2}|.)", re.DOTALL)
UNESCAPED_QUOTE = re.compile(r'(?:[^"\\]|\\.)*(?:"|\\$)', re.DOTALL)
FRACTION_WORDS = {"max": FRACTION_MAX, "min": -FRACTION_MAX, "1/max": Fraction(1, INT_MAX)}
FLOAT_MAX = sys.float_info.max
FLOAT32_MAX = 3.4028234663852886e38
BYTE_ORDERS = {"little_endian": 1234, "big_endian": 4321}
INTEGER_WORDS = frozenset(("min", "max", "little_endian", "big_endian", "byte_order"))
NUMBER_STARTS = frozenset("+-.0123456789")
BYTE_ORDERS["byte_order"] = BYTE_ORDERS[f"{sys.byteorder}_endian"]


def read_integer(text: str) -> int | None:
    """An integer in C notation (0x hexadecimal, leading 0 octal), or None."""
    if not INTEGER.fullmatch(text):
        return None
    digits = text.lstrip("+-")
    base = 16 if digits[:2] in ("0x", "0X") else 8 if len(digits) > 1 and digits[0] == "0" else 10
    return int(text, base)


def read_width(text: str, bits: int, *, signed: bool) -> int | None:
    """An integer of `bits` bits that wraps as in C; also `min`, `max` or a byte order."""
    span: int = 2**bits
    low, high = (-span // 2, span // 2 - 1) if signed else (0, span - 1)
    number = read_integer(text)
    if number is None:
        word = text.lower()
        return low if word == "min" else high if word == "max" else BYTE_ORDERS.get(word)
    if not -(2**63) <= number < 2**64:
        return None
    if bits < 64 and number >= 2**63:
        number -= 2**64
    if not -span // 2 <= number < span:
        return None
    number %= span
    return number - span if number > high else number


def read_fraction(text: str) -> Fraction | None:
    """A fraction `n/d` or integer whose parts fit 32 bits, `min`, `max` or `1/max`, or None."""
    match = FRACTION.fullmatch(text)
    if match is None:
        return FRACTION_WORDS.get(text.lower())
    numerator, denominator = int(match[1]), int(match[2] or 1)
    if denominator == 0 or not all(INT_MIN <= part <= INT_MAX for part in (numerator, denominator)):
        return None
    value = Fraction(numerator, denominator)
    return value if abs(value.numerator) <= INT_MAX else None


def read_float(text: str, largest: float = FLOAT_MAX) -> float | None:
    """A number up to `largest`, `min` or `max`, or None."""
    word = text.lower()
    if word in ("min", "max"):
        return largest if word == "max" else -largest
    try:
        value = (
            float(text) if FLOAT.fullmatch(text) else float.fromhex(text) if HEX.fullmatch(text) else math.nan
        )
    except (ValueError, OverflowError):
        return None
    return value if abs(value) <= largest else None


def _read_float32(text: str) -> Float32 | None:
    value = read_float(text, FLOAT32_MAX)
    return None if value is None else Float32(struct.unpack("f", struct.pack("f", value))[0])


def read_boolean(text: str) -> bool | None:
    """A boolean in any of GStreamer's spellings, or None."""
    word = text.lower()
    return True if word in ("true", "yes", "t", "1") else False if word in ("false", "no", "f", "0") else None


def unquote_string(text: str) -> str:
    r"""A text in double quotes without them, where `\c` is c and `\ooo` a byte of UTF-8; others as they are.

    Raises:
        ValueError: an inner quote is not escaped, an escape is invalid, or the bytes are not UTF-8.
    """
    if not (text.startswith('"') and text.endswith('"')):
        return text
    inner = text[1:-1]
    if len(text) < 2 or UNESCAPED_QUOTE.match(inner):
        raise ValueError("its quotes must be closed, and quotes inside them escaped")
    if "\\" not in inner:
        return inner
    try:
        return ESCAPE.sub(_unescaped, inner.encode()).decode()
    except UnicodeError:
        raise ValueError("its octal escapes must make UTF-8") from None


def _unescaped(escape: re.Match[bytes]) -> bytes:
    mark = escape[1]
    if len(mark) == 3:
        return bytes((int(mark, 8),))
    if mark in (b"0", b"1", b"2", b"3"):
        raise ValueError(r"an octal escape has three digits, \000 to \377")
    return mark


def read_string(text: str) -> str | None:
    """A string of characters that UTF-8 has, without NUL, or None."""
    if text == "NULL":
        return NullText(text)
    try:
        found = unquote_string(text)
        return None if b"\0" in found.encode() else found
    except ValueError:
        return None


def _integers(number: type[int], bits: int, *, signed: bool) -> Callable[[str], Value | None]:
    def read(text: str) -> Value | None:
        found = read_width(text, bits, signed=signed)
        return None if found is None else number(found)

    return read


def _matching(pattern: str, make: Callable[[re.Match[str]], Value]) -> Callable[[str], Value | None]:
    def read(text: str) -> Value | None:
        match = re.fullmatch(pattern, text)  # rarely used patterns are compiled on first use
        try:
            return make(match) if match else None
        except ValueError:
            return None

    return read


read_int = _integers(int, 32, signed=True)
read_flag_set = _matching(FLAGS, lambda match: FlagSet(int(match[1], 16), int(match[2], 16)))
READERS: dict[str, Callable[[str], Value | None]] = {
    "int": read_int,
    "uint": _integers(UInt, 32, signed=False),
    "gint64": _integers(Int64, 64, signed=True),
    "guint64": _integers(UInt64, 64, signed=False),
    "guchar": _integers(UChar, 8, signed=False),
    "float": _read_float32,
    "double": read_float,
    "boolean": read_boolean,
    "string": read_string,
    "fraction": read_fraction,
    "bitmask": _integers(Bitmask, 64, signed=False),
    "flagset": read_flag_set,
    "buffer": _matching(BYTES, lambda match: bytes.fromhex(match[1] or "")),
    "date": _matching(DATE, lambda match: date(int(match[1]), int(match[2]), int(match[3]))),
    "datetime": _matching(DATE_TIME, lambda match: DateTime(match[0])),
    "glong": _integers(Long, 64, signed=True),
    "gulong": _integers(ULong, 64, signed=False),
    "GstVideoMultiviewFlagsSet": _matching(
        FLAGS, lambda match: MultiviewFlags(int(match[1], 16), int(match[2], 16))
    ),
}
TYPES: dict[str, str] = {
    **{name: name for name in (*READERS, "structure", "GstCaps")},
    "i": "int", "gint": "int", "u": "uint", "guint": "uint", "int64": "gint64", "uint64": "guint64",
    "f": "float", "gfloat": "float", "d": "double", "gdouble": "double", "b": "boolean", "bool": "boolean",
    "gboolean": "boolean", "s": "string", "str": "string", "gchararray": "string",
    "GstFraction": "fraction", "GstBitmask": "bitmask", "GstFlagSet": "flagset", "GstBuffer": "buffer",
    "GDate": "date", "GstDateTime": "datetime", "GstStructure": "structure",
}  # fmt: skip


def read_untyped(text: str, raw: str) -> Value | None:
    """A value without a type: the first of int, double, fraction, flag set, boolean and string that fits.

    Args:
        text: without quotes and escapes.
        raw: with quotes and escapes.

    Returns:
        The value; None for a number out of the range of its type.
    """
    if text[:1] in NUMBER_STARTS:
        number = read_int(text)
        if number is not None:
            return number
        if FLOAT.fullmatch(text) or HEX.fullmatch(text):
            return read_float(text)
        match = FRACTION.fullmatch(text)
        if (match and int(match[2] or 0)) or text.lower() == "1/max":
            return read_fraction(text)
    elif text.lower() in INTEGER_WORDS:
        return read_int(text)
    flags = read_flag_set(text) if ":" in text else None
    if flags is not None:
        return flags
    truth = read_boolean(text)
    return read_string(raw) if truth is None else truth

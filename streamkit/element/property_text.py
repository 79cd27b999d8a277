"""Converts the text of a description to a property value; enumerations of properties.

Source: GStreamer's documentation of value deserialisation, and what GStreamer 1.22 returns.
"""

from __future__ import annotations

import enum
from fractions import Fraction
from typing import Any

from streamkit.flow.caps import Caps
from streamkit.flow.caps_text import (
    BYTE_ORDERS,
    read_boolean,
    read_float,
    read_fraction,
    read_integer,
    read_width,
    unquote_string,
)

INT, UINT, INT64, UINT64 = 2**31 - 1, 2**32 - 1, 2**63 - 1, 2**64 - 1  # maxima of C's types
# Bits, and whether it is signed, of the C type whose maximum a property has.
WIDTHS: dict[Any, tuple[int, bool]] = {
    INT: (32, True), UINT: (32, False), INT64: (64, True), UINT64: (64, False),
}  # fmt: skip
PLAIN_KINDS = int, float, bool, str, Fraction, Caps  # of properties, beside enumerations
BLANKS = " \t\n\r\f\v"  # C's functions skip them in front of a number


class Choice(enum.StrEnum):
    """Base class of property enumerations: users write the word, the number or the label of a member.

    A member is declared as a word, or as (word, number, label). The default number is one more than the
    previous member's, the default label is the word:

        class Leaky(Choice):
            NO = "no", 0, "Not Leaky"
            UPSTREAM = "upstream", 1, "Leaky on upstream (new buffers)"
    """

    number: int
    label: str

    def __new__(cls, word: str, number: int | None = None, label: str = "") -> Choice:
        """Makes a member whose value is the word."""
        member = str.__new__(cls, word)
        member._value_ = word
        previous = list(cls.__members__.values())
        member.number = number if number is not None else previous[-1].number + 1 if previous else 0
        member.label = label or word
        return member


def value_from_text(kind: type, text: str, *, minimum: Any = None, maximum: Any = None) -> Any:
    """Converts a text to a value.

    Args:
        kind: int, float, bool, str, Fraction, Caps, or a class of `enum.Enum` or `enum.Flag`.
        text: as written in a description, launch-level quotes removed.
        minimum: value of the word "min", or None; the range is not checked here.
        maximum: value of the word "max", or None; if it is the maximum of a 32-bit or 64-bit type, integers
            wrap as in C: -1 is the largest unsigned value.

    Raises:
        ValueError: the text is not a value of that type; the message says what is.
    """
    if kind is str:
        return unquote_string(text)
    if kind is bool:
        return _demand(read_boolean(text), "it takes true, yes, t, 1 or false, no, f, 0")
    if kind is int:
        return _integer(text, minimum, maximum)
    if kind is float:
        return _demand(read_float(text.lstrip(BLANKS)), "it takes a number such as 0.5 or 1e3")
    if kind is Fraction:
        return _demand(read_fraction(text), "it takes a fraction such as 30/1")
    if kind is Caps:
        return Caps(text) if text.strip() else Caps()
    if issubclass(kind, enum.Flag):
        return _flags(kind, text)
    if issubclass(kind, enum.Enum):
        return _choice(kind, text)
    raise ValueError(f"values of type {kind.__name__} cannot be written in a description")


def _demand(value: Any, rule: str) -> Any:
    if value is None:
        raise ValueError(rule)
    return value


def _integer(text: str, minimum: int | None, maximum: int | None) -> int:
    word = text.lower()
    if word in ("min", "max"):
        given, widest = (minimum, -INT64 - 1) if word == "min" else (maximum, INT64)
        return widest if given is None else int(given)
    rule = "it takes a whole number such as 12, -1 or 0x10"
    if maximum in WIDTHS or word in BYTE_ORDERS:
        bits, is_signed = WIDTHS.get(maximum, (64, True))
        wrapped = read_width(text.lstrip(BLANKS), bits, signed=is_signed)
        if wrapped is not None:
            return wrapped
    value = int(_demand(read_integer(text.lstrip(BLANKS)), rule))
    if not -INT64 - 1 <= value <= INT64:
        raise ValueError("it takes a number of at most 64 bits")
    return value


def _choice(kind: type[enum.Enum], text: str) -> enum.Enum:
    members = list(kind)
    number = read_integer(text.lstrip(BLANKS))
    for index, member in enumerate(members):
        if text in (str(member.value), getattr(member, "label", None)):
            return member
        if number is not None and number == getattr(member, "number", index):
            return member
    raise ValueError(f"it takes {', '.join(str(member.value) for member in members)}")


def flag_word(member: enum.Flag) -> str:
    """A flag as written in a description: its name in lower case, with dashes."""
    return (member.name or "").lower().replace("_", "-")


def _flags(kind: type[enum.Flag], text: str) -> enum.Flag:
    by_word = {flag_word(member): member for member in kind}
    found = kind(0)
    if not text:
        return found
    for part in text.split("+"):
        if part in by_word:
            found |= by_word[part]
            continue
        number = read_integer(part)
        if number is None or number < 0 or number & ~sum(member.value for member in kind):
            raise ValueError(f"it takes any of {', '.join(by_word)}, joined by +")
        found |= kind(number)
    return found

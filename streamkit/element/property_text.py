"""Text of a description to a typed property value.

Source: GStreamer's value deserialisation, as its documentation and test results tell.
"""

from __future__ import annotations

import enum
import re
from fractions import Fraction
from typing import Any

from streamkit.flow.caps import Caps
from streamkit.flow.caps_text import read_boolean, read_float, read_fraction, read_integer

INT64_MIN, INT64_MAX = -(2**63), 2**63 - 1
ESCAPE = re.compile(r"\\([0-3][0-7]{2}|.)", re.DOTALL)


def value_from_text(kind: type, text: str) -> Any:
    """The value that a text stands for.

    Args:
        kind: int, float, bool, str, Fraction, Caps or an enum class.
        text: as written in a description, launch-level quotes removed.

    Raises:
        ValueError: the text is no value of that type; says what is.
    """
    if kind is str:
        return unquote_string(text)
    if kind is bool:
        return _demand(read_boolean(text), "it takes true, yes, t, 1 or false, no, f, 0")
    if kind is int:
        return _integer(text)
    if kind is float:
        if text.lower() in ("min", "max"):
            return float("inf") if text.lower() == "max" else float("-inf")
        return _demand(read_float(text), "it takes a number such as 0.5 or 1e3")
    if kind is Fraction:
        return _demand(read_fraction(text), "it takes a fraction such as 30/1")
    if kind is Caps:
        return Caps(text)
    if issubclass(kind, enum.Enum):
        return _choice(kind, text)
    raise ValueError(f"values of type {kind.__name__} cannot be written in a description")


def unquote_string(text: str) -> str:
    """Strips one pair of double quotes around a string and resolves the escapes inside."""
    if len(text) < 2 or not (text.startswith('"') and text.endswith('"')):
        if text == '"':
            raise ValueError("its quotes must be closed")
        return text
    return ESCAPE.sub(_resolved, text[1:-1])


def _resolved(escape: re.Match[str]) -> str:
    mark = escape[1]
    if mark in "0123456789":
        raise ValueError(r"an octal escape has three digits, \000 to \377")
    return chr(int(mark, 8)) if len(mark) == 3 else mark


def _demand(value: Any, rule: str) -> Any:
    if value is None:
        raise ValueError(rule)
    return value


def _integer(text: str) -> int:
    value = int(_demand(read_integer(text), "it takes a whole number such as 12, -1 or 0x10"))
    if not INT64_MIN <= value <= INT64_MAX:
        raise ValueError("it takes a number of at most 64 bits")
    return value


def _choice(kind: type[enum.Enum], text: str) -> enum.Enum:
    members = list(kind)
    for index, member in enumerate(members):
        if text in (str(member.value), member.name) or text == str(index):
            return member
    raise ValueError(f"it takes {', '.join(str(member.value) for member in members)}")

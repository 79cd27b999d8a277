"""Writes caps as text, in GStreamer's form."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from fractions import Fraction

from streamkit.flow.caps_values import (
    TYPE_NAMES,
    Bitmask,
    DateTime,
    FlagSet,
    IntRange,
    Nested,
    NullText,
    Range,
    Value,
    ValueArray,
    ValueList,
)

PLAIN = re.compile(r"[A-Za-z0-9_+/:.-]+")
OTHER = re.compile(rb"[^A-Za-z0-9_+/:.-]")


def type_name(value: Value) -> str:
    """GStreamer's name of the type of a value, or of the first member of a list or array."""
    if isinstance(value, ValueList | ValueArray):
        return type_name(value.items[0]) if value.items else "int"
    if isinstance(value, Nested):
        return value.type_name
    name = TYPE_NAMES.get(type(value))
    return name or next((name for kind, name in TYPE_NAMES.items() if isinstance(value, kind)), "string")


def write_structure(name: str, features: Iterable[str], fields: Mapping[str, Value]) -> str:
    """`name(features), field=(type)value, ...`."""
    marks = ", ".join(features)
    parts = [f"{name}({marks})" if marks else name]
    parts += [f"{key}={write_value(value)}" for key, value in fields.items()]
    return ", ".join(parts)


def write_value(value: Value) -> str:
    """A value with its type; members of a list or array have their own types if these differ."""
    if isinstance(value, ValueList | ValueArray) and len({type_name(item) for item in value.items}) > 1:
        return write_members(value, typed=True)
    return f"({type_name(value)}){write_plain(value)}"


def write_members(value: ValueList | ValueArray, *, typed: bool) -> str:
    """A list or array in its brackets."""
    opening, closing = ("{", "}") if isinstance(value, ValueList) else ("<", ">")
    members: list[str] = []
    for item in value.items:
        if isinstance(item, ValueList | ValueArray):
            # As in GStreamer, members of an inner list have their types.
            members.append(write_members(item, typed=True))
        else:
            members.append(write_value(item) if typed else write_plain(item))
    return f"{opening} {', '.join(members)} {closing}"


def write_plain(value: Value) -> str:
    """A value without its type."""
    if isinstance(value, ValueList | ValueArray):
        return write_members(value, typed=False)
    if isinstance(value, IntRange):
        step = f", {value.step}" if value.step != 1 else ""
        return f"[ {value.low}, {value.high}{step} ]"
    if isinstance(value, Range):
        return f"[ {write_plain(value.low)}, {write_plain(value.high)} ]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Bitmask):
        return f"0x{int(value):016x}"
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float):
        return f"{float(value):.17g}"
    if isinstance(value, Fraction):
        return f"{value.numerator}/{value.denominator}"
    if isinstance(value, str):
        return str(value) if isinstance(value, NullText | DateTime) else write_string(value)
    if isinstance(value, bytes):
        return value.hex() or '""'
    if isinstance(value, FlagSet):
        names = ((bit, name) for bit, name in value.names.items() if value.mask & bit)
        marks = "".join(("+" if value.flags & bit else "/") + name for bit, name in names)
        return f"{value.flags:x}:{value.mask:x}" + (f":{marks}" if marks else "")
    if isinstance(value, Nested):
        return f"[{value};]" if value.type_name == "structure" else f"[{value}]"
    return str(value)


def write_string(text: str) -> str:
    """A string, quoted and escaped if it has characters that names do not have."""
    if PLAIN.fullmatch(text) and text != "NULL":
        return text

    def escaped(match: re.Match[bytes]) -> bytes:
        byte = match.group()
        return b"\\" + byte if 0x20 <= byte[0] < 0x7F else b"\\%03o" % byte[0]

    return f'"{OTHER.sub(escaped, text.encode("utf-8", "surrogatepass")).decode()}"'

"""Text of caps, written as GStreamer writes it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from datetime import date
from fractions import Fraction

from streamkit.flow.caps_values import (
    Bitmask,
    DateTime,
    FlagSet,
    Float32,
    FloatRange,
    FractionRange,
    Int64,
    Int64Range,
    IntRange,
    Long,
    MultiviewFlags,
    NestedValue,
    NullText,
    UChar,
    UInt,
    UInt64,
    ULong,
    Value,
    ValueArray,
    ValueList,
)

PLAIN = re.compile(r"[A-Za-z0-9_+/:.-]+")
OTHER = re.compile(rb"[^A-Za-z0-9_+/:.-]")
TYPE_NAMES: dict[type, str] = {
    bool: "boolean", int: "int", IntRange: "int", UInt: "uint", Int64: "gint64", Int64Range: "gint64",
    UInt64: "guint64", Long: "glong", ULong: "gulong", UChar: "guchar", float: "double",
    FloatRange: "double", Float32: "float", Fraction: "fraction", FractionRange: "fraction", str: "string",
    NullText: "string", bytes: "buffer", date: "date", DateTime: "datetime", Bitmask: "bitmask",
    FlagSet: "flagset", MultiviewFlags: "GstVideoMultiviewFlagsSet",
}  # fmt: skip


def type_name(value: Value) -> str:
    """GStreamer's name of a value's type; of a list or array that of its first member."""
    if isinstance(value, ValueList | ValueArray):
        return type_name(value.items[0]) if value.items else "int"
    if isinstance(value, NestedValue):
        return "structure" if hasattr(value, "fields") else "GstCaps"
    name = TYPE_NAMES.get(type(value))
    return name or next((name for kind, name in TYPE_NAMES.items() if isinstance(value, kind)), "string")


def write_structure(name: str, features: Iterable[str], fields: Mapping[str, Value]) -> str:
    """`name(features), field=(type)value, ...`."""
    marks = ", ".join(features)
    parts = [f"{name}({marks})" if marks else name]
    parts += [f"{key}={write_value(value)}" for key, value in fields.items()]
    return ", ".join(parts)


def write_value(value: Value) -> str:
    """The text of a value with its type in front.

    The members of a list or array have its type; where they differ each has its own.
    """
    if isinstance(value, ValueList | ValueArray) and len({type_name(item) for item in value.items}) > 1:
        return write_members(value, typed=True)
    return f"({type_name(value)}){write_plain(value)}"


def write_members(value: ValueList | ValueArray, *, typed: bool) -> str:
    """A list or array in its brackets."""
    opening, closing = ("{", "}") if isinstance(value, ValueList) else ("<", ">")
    members: list[str] = []
    for item in value.items:
        if isinstance(item, ValueList | ValueArray):
            # As in GStreamer the members of an inner list carry their types.
            members.append(write_members(item, typed=True))
        else:
            members.append(write_value(item) if typed else write_plain(item))
    return f"{opening} {', '.join(members)} {closing}"


def write_plain(value: Value) -> str:
    """The text of a value without its type."""
    if isinstance(value, ValueList | ValueArray):
        return write_members(value, typed=False)
    if isinstance(value, IntRange):
        step = f", {value.step}" if value.step != 1 else ""
        return f"[ {value.low}, {value.high}{step} ]"
    if isinstance(value, FloatRange | FractionRange):
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
    return _write_nested(value) if isinstance(value, NestedValue) else str(value)


def _write_nested(value: NestedValue) -> str:
    return f"[{value};]" if type_name(value) == "structure" else f"[{value}]"


def write_string(text: str) -> str:
    """A string, quoted and with escapes where it has other characters than those of names."""
    if PLAIN.fullmatch(text) and text != "NULL":
        return text

    def escaped(match: re.Match[bytes]) -> bytes:
        byte = match.group()
        return b"\\" + byte if 0x20 <= byte[0] < 0x7F else b"\\%03o" % byte[0]

    return f'"{OTHER.sub(escaped, text.encode("utf-8", "surrogatepass")).decode()}"'

"""Records as protocol buffers: the messages of streamkit.proto, to and from dictionaries."""

from __future__ import annotations

import re
from collections.abc import MutableSequence
from pathlib import Path
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

PACKAGE = "streamkit"
PROTO_FILE = Path(__file__).with_name("streamkit.proto")
# Columns of the matrices, which the messages hold row by row.
COLUMNS = {"to_reference": 3, "position_covariance": 2}
_MESSAGE = re.compile(r"message (\w+) \{")
_FIELD = re.compile(r"(?:(optional|repeated) )?(\w+) (\w+) = (\d+);")
_OTHER = ("", "}", 'syntax = "proto3";', f"package {PACKAGE};")
_Proto = descriptor_pb2.FieldDescriptorProto


def file_descriptor(text: str) -> descriptor_pb2.FileDescriptorProto:
    """Parses a .proto file of messages with optional and repeated fields; the library has no parser for it.

    Raises:
        ValueError: a line is something else.
    """
    file = descriptor_pb2.FileDescriptorProto(name=PROTO_FILE.name, package=PACKAGE, syntax="proto3")
    for line in text.splitlines():
        statement = line.partition("//")[0].strip()
        if match := _MESSAGE.fullmatch(statement):
            file.message_type.add(name=match[1])
        elif match := _FIELD.fullmatch(statement):
            _add_field(file.message_type[-1], *match.groups())
        elif statement not in _OTHER:
            raise ValueError(f"{PROTO_FILE.name}: not a message, field, syntax or package: {statement!r}")
    return file


def _add_field(message: Any, label: str | None, kind: str, name: str, number: str) -> None:
    is_repeated = label == "repeated"
    field = message.field.add(
        name=name, number=int(number), label=_Proto.LABEL_REPEATED if is_repeated else _Proto.LABEL_OPTIONAL
    )
    if kind.islower():
        field.type = _Proto.Type.Value(f"TYPE_{kind.upper()}")
    else:
        field.type, field.type_name = _Proto.TYPE_MESSAGE, f".{PACKAGE}.{kind}"
    if label == "optional":
        field.proto3_optional, field.oneof_index = True, len(message.oneof_decl)
        message.oneof_decl.add(name=f"_{name}")


# A pool of its own: another library in the process may define messages of the same names.
_POOL = descriptor_pool.DescriptorPool()
_POOL.Add(file_descriptor(PROTO_FILE.read_text("utf-8")))


class ProtobufMessage:
    """A message type of streamkit.proto, to and from dictionaries with its fields, matrices as rows."""

    def __init__(self, name: str) -> None:
        self._class = message_factory.GetMessageClass(_POOL.FindMessageTypeByName(f"{PACKAGE}.{name}"))

    def encode(self, fields: dict[str, Any]) -> bytes:
        """Serialises the fields; None is an unset field."""
        data: bytes = self._class(**_flattened(fields)).SerializeToString()
        return data

    def decode(self, data: bytes) -> dict[str, Any]:
        """The fields of a message; raises what the library raises for malformed data."""
        message = self._class()
        message.ParseFromString(data)
        return _fields_of(message)


def _flattened(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _flattened(item) for name, item in value.items()}
    if not isinstance(value, list | tuple):
        return value
    items = [_flattened(item) for item in value]
    return [number for row in items for number in row] if items and isinstance(items[0], list) else items


def _fields_of(message: Any) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    for field in message.DESCRIPTOR.fields:
        name, value = field.name, getattr(message, field.name)
        if isinstance(value, MutableSequence):
            items = [_fields_of(item) for item in value] if field.message_type else list(value)
            columns = COLUMNS.get(name)
            if columns:
                items = [items[start : start + columns] for start in range(0, len(items), columns)]
            if items or field.message_type:
                fields[name] = items
        elif not field.has_presence or message.HasField(name):
            fields[name] = _fields_of(value) if field.message_type else value
    return fields

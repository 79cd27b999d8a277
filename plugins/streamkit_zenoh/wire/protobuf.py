"""Records as protocol buffers: one table of fields, from which the messages and the .proto file are made.

The numbers in the table are the contract: a field keeps its number for ever, and a new one takes the next.
Matrices are flattened row by row.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

PACKAGE = "streamkit"
FILE_NAME = "streamkit.proto"
_Proto = descriptor_pb2.FieldDescriptorProto
_SCALARS = {
    "double": _Proto.TYPE_DOUBLE,
    "int64": _Proto.TYPE_INT64,
    "uint64": _Proto.TYPE_UINT64,
    "string": _Proto.TYPE_STRING,
    "bool": _Proto.TYPE_BOOL,
}


class Field(NamedTuple):
    """A field of a message: `label` is "", "optional" or "repeated"; `columns` is the width of a matrix."""

    name: str
    kind: str
    label: str = ""
    columns: int = 0
    note: str = ""


# The position in the tuple is the number on the wire, from 1 on: append, never insert.
MESSAGES: dict[str, tuple[Field, ...]] = {
    "GeoRecord": (
        Field("lat", "double", note="deg, WGS84"),
        Field("lon", "double", note="deg, WGS84"),
        Field("error_m", "double", "optional"),
    ),
    "RegistrationRecord": (
        Field("reference", "int64", note="number of the plane"),
        Field("to_reference", "double", "repeated", 3, "3x3, row by row; empty where not known"),
        Field("status", "string", note="ok, weak, lost, cut or still"),
        Field("matches", "int64", "optional"),
        Field("inliers", "int64", "optional"),
        Field("rmse", "double", "optional", note="px"),
    ),
    "MatchRecord": (
        Field("row", "int64", note="of the detection in its frame"),
        Field("gate", "double", "optional", note="standard deviations"),
        Field("centroid", "double", "repeated", note="x y, px"),
        Field("bbox", "double", "repeated", note="x0 y0 x1 y1, px"),
        Field("area", "double", note="px"),
        Field("score", "double"),
        Field("label", "string", "optional"),
    ),
    "ProvenanceRecord": (
        Field("predicted", "double", "repeated", note="x y, px, or empty"),
        Field("detection", "MatchRecord"),
        Field("shared", "bool"),
        Field("similarity", "double", "optional"),
        Field("learnt", "bool"),
        Field("cause", "string", "optional"),
    ),
    "TargetRecord": (
        Field("id", "int64"),
        Field("state", "string", note="tentative, confirmed, coasting or lost"),
        Field("x", "double", note="px of the frame, (0, 0) the centre of the top-left pixel"),
        Field("y", "double"),
        Field("length", "double", note="px, along angle"),
        Field("width", "double", note="px"),
        Field("angle", "double", note="rad, from +x towards +y"),
        Field("bbox", "double", "repeated", note="x0 y0 x1 y1, px"),
        Field("vx", "double", "optional", note="px/s on the reference plane"),
        Field("vy", "double", "optional"),
        Field("position_covariance", "double", "repeated", 2, "2x2, row by row, px squared; or empty"),
        Field("score", "double"),
        Field("age_ns", "int64"),
        Field("geo", "GeoRecord"),
        Field("provenance", "ProvenanceRecord"),
    ),
    "TrackRecord": (
        Field("schema", "string", note='"streamkit.tracks/1"'),
        Field("source", "string"),
        Field("seq", "uint64"),
        Field("epoch", "uint64"),
        Field("pts_ns", "int64", "optional"),
        Field("capture_ns", "int64", "optional", note="UTC"),
        Field("capture_origin", "string", "optional", note="rtcp, misb, file or arrival"),
        Field("published_ns", "int64", "optional", note="UTC"),
        Field("age_ms", "double", "optional"),
        Field("width", "uint64", "optional", note="px"),
        Field("height", "uint64", "optional", note="px"),
        Field("registration", "RegistrationRecord"),
        Field("tracks", "TargetRecord", "repeated"),
        Field("dropped", "uint64"),
    ),
    "StreamStatus": (
        Field("name", "string", note="tracks, frame, mosaic or status"),
        Field("run", "uint64", note="when the publisher began, UTC ns"),
        Field("settled_number", "uint64", note="messages with lower numbers have been sent or dropped"),
        Field("published", "uint64"),
        Field("bytes", "uint64"),
        Field("has_subscriber", "uint64", note="0 or 1"),
        Field("next_number", "uint64", note="of the message that comes next"),
        Field("first_number", "uint64", "optional", note="of those that the receiver who asked is sent"),
    ),
    "DropCount": (
        Field("stream", "string"),
        Field("reason", "string"),
        Field("count", "uint64"),
    ),
    "StatusRecord": (
        Field("schema", "string", note='"streamkit.status/1"'),
        Field("source", "string"),
        Field("state", "string", note="starting, playing or ended"),
        Field("run", "uint64", note="when the publisher began, UTC ns"),
        Field("published_ns", "int64", note="UTC"),
        Field("uptime_s", "double"),
        Field("frames", "uint64", note="frames that came"),
        Field("seq", "uint64", "optional", note="of the last frame"),
        Field("epoch", "uint64", "optional"),
        Field("tracks", "uint64", note="targets in the last frame"),
        Field("age_ms", "double", "optional", note="from capture to publishing, of the last record"),
        Field("streams", "StreamStatus", "repeated"),
        Field("drops", "DropCount", "repeated"),
    ),
}


def _descriptor() -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(name=FILE_NAME, package=PACKAGE, syntax="proto3")
    for name, fields in MESSAGES.items():
        message = file.message_type.add(name=name)
        for number, field in enumerate(fields, 1):
            added = message.field.add(name=field.name, number=number, label=_Proto.LABEL_OPTIONAL)
            if field.label == "repeated":
                added.label = _Proto.LABEL_REPEATED
            if field.kind in _SCALARS:
                added.type = _SCALARS[field.kind]
            else:
                added.type, added.type_name = _Proto.TYPE_MESSAGE, f".{PACKAGE}.{field.kind}"
            if field.label == "optional":
                added.proto3_optional, added.oneof_index = True, len(message.oneof_decl)
                message.oneof_decl.add(name=f"_{field.name}")
    return file


# A pool of its own: another library in the process may have messages of the same names.
_POOL = descriptor_pool.DescriptorPool()
_POOL.Add(_descriptor())


class ProtobufMessage:
    """One kind of message, to and from plain dictionaries with the fields of the table."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._class = message_factory.GetMessageClass(_POOL.FindMessageTypeByName(f"{PACKAGE}.{name}"))

    def encode(self, fields: dict[str, Any]) -> bytes:
        """The message with these fields; matrices as rows."""
        data: bytes = self._class(**_flattened(self._name, fields)).SerializeToString()
        return data

    def decode(self, data: bytes) -> dict[str, Any]:
        """The fields of a message; raises what the library raises where it is none."""
        message = self._class()
        message.ParseFromString(data)
        return _as_fields(self._name, message)


def _flattened(name: str, fields: dict[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for field in MESSAGES[name]:
        value = fields.get(field.name)
        if value is None:
            continue
        if field.kind in MESSAGES:
            repeated = field.label == "repeated"
            value = [_flattened(field.kind, item) for item in (value if repeated else (value,))]
            value = value if repeated else value[0]
        elif field.columns:
            value = [number for row in value for number in row]
        flat[field.name] = value
    return flat


def _as_fields(name: str, message: Any) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    for field in MESSAGES[name]:
        if field.label == "repeated":
            items = list(getattr(message, field.name))
            if field.kind in MESSAGES:
                items = [_as_fields(field.kind, item) for item in items]
            elif not items:
                continue
            elif field.columns:
                items = [
                    items[start : start + field.columns] for start in range(0, len(items), field.columns)
                ]
            fields[field.name] = items
        elif field.kind in MESSAGES:
            if message.HasField(field.name):
                fields[field.name] = _as_fields(field.kind, getattr(message, field.name))
        elif field.label != "optional" or message.HasField(field.name):
            fields[field.name] = getattr(message, field.name)
    return fields


def proto_text() -> str:
    """The .proto file of the table."""
    lines = ["// Track records and status of streamkit, as docs/track-record.md describes them.", ""]
    lines += ['syntax = "proto3";', "", f"package {PACKAGE};"]
    for name, fields in MESSAGES.items():
        lines += ["", f"message {name} {{"]
        for number, field in enumerate(fields, 1):
            label = f"{field.label} " if field.label else ""
            note = f"  // {field.note}" if field.note else ""
            lines.append(f"  {label}{field.kind} {field.name} = {number};{note}")
        lines.append("}")
    return "\n".join(lines) + "\n"

"""What publishers and receivers exchange beside records and frames: status, control, and all schemas."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import msgspec

from streamkit import TRACKS_SCHEMA, TrackRecord
from streamkit_zenoh.wire.encodings import decode_json
from streamkit_zenoh.wire.frame_header import FRAME_SCHEMA, FrameHeader
from streamkit_zenoh.wire.video_header import VIDEO_SCHEMA, VideoHeader

STATUS_SCHEMA: Literal["streamkit.status/1"] = "streamkit.status/1"
CONTROL_SCHEMA: Literal["streamkit.control/1"] = "streamkit.control/1"
REQUEST_LIMIT_BYTES = 4096
Value = bool | int | float | str | None
PROTO_FILE = Path(__file__).with_name("streamkit.proto")


class StreamStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One stream of a publisher.

    Attributes:
        name: tracks, frame, mosaic or status.
        run: when its publisher began, UTC ns; the first word of every attachment.
        settled_number: all messages with lower numbers were sent or dropped; those not received are lost.
        published: messages passed to zenoh.
        bytes: their total size.
        has_subscriber: 1 while there is a subscriber, else 0.
        next_number: of the next message; a subscriber that asked for this status is sent all from it on.
        first_number: in a reply to a receiver with a token: it is sent all from this number on.
    """

    name: str
    run: int
    settled_number: int
    published: int
    bytes: int
    has_subscriber: int
    next_number: int = 0
    first_number: int | None = None


class DropCount(msgspec.Struct, frozen=True, kw_only=True):
    """Messages that the publisher dropped."""

    stream: str
    reason: str
    count: int


class PropertyChange(msgspec.Struct, frozen=True, kw_only=True):
    """A property that was set over KEY/control, with its value as text."""

    element: str
    property: str
    value: str


class ElementDrop(msgspec.Struct, frozen=True, kw_only=True):
    """Frames that an element dropped."""

    reason: str
    count: int


class ElementStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One element of the publisher's pipeline, since streaming began.

    Attributes:
        name: behind that of its bin.
        busy_ns: working time; 0 of a queue.
        drops: frames that it dropped, by reason.
    """

    name: str
    busy_ns: int
    drops: tuple[ElementDrop, ...]


class StatusRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """State and counters of a publisher; unknown values are left out.

    Attributes:
        schema: name and version of the schema.
        source: the publisher's key.
        state: starting until the first frame, then playing, and ended at the end of the stream.
        run: when the publisher began, UTC ns.
        published_ns: UTC.
        uptime_s: since it began.
        frames: frames received.
        seq: sequence number of the last frame.
        epoch: of the last frame.
        tracks: targets in the last frame.
        age_ms: from capture to publishing, of the last record.
        streams: its streams but this one.
        drops: messages it dropped, by stream and reason.
        control: whether live properties can be set at KEY/control.
        changes: properties that were set there, each with its last value.
        elements: of the pipeline, but for those in processes of their own.
    """

    schema: Literal["streamkit.status/1"]
    source: str
    state: Literal["starting", "playing", "ended"]
    run: int
    published_ns: int
    uptime_s: float
    frames: int
    seq: int | None = None
    epoch: int | None = None
    tracks: int
    age_ms: float | None = None
    streams: tuple[StreamStatus, ...]
    drops: tuple[DropCount, ...]
    control: bool = False
    changes: tuple[PropertyChange, ...] = ()
    elements: tuple[ElementStatus, ...] = ()


class ControlRequest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The payload of a query that sets a property; a query without payload asks for all live properties.

    Attributes:
        element: name in the pipeline.
        property: its live property.
        value: the new value; a text is read as in a description.
    """

    element: str
    property: str
    value: Value


class LiveProperty(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A property that may change while the pipeline plays.

    Attributes:
        element, property: names, as in a request.
        factory: type of the element.
        type: bool, int, float, str, Fraction, Caps, or the name of an enumeration.
        value: at the moment.
        choices: the words of an enumeration.
        minimum, maximum, unit, doc: as `streamkit inspect` prints them.
    """

    element: str
    factory: str
    property: str
    type: str
    value: Value = None
    choices: tuple[str, ...] = ()
    minimum: Value = None
    maximum: Value = None
    unit: str = ""
    doc: str = ""


class ControlReply(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The reply to a query.

    Attributes:
        schema: name and version of the schema.
        error: why nothing was set.
        properties: all live properties, or the one that was set.
    """

    schema: Literal["streamkit.control/1"]
    error: str | None = None
    properties: tuple[LiveProperty, ...] = ()


def read_request(data: bytes) -> ControlRequest:
    """Decodes and validates a request.

    Raises:
        ValueError: it is too large, or none.
    """
    if len(data) > REQUEST_LIMIT_BYTES:
        raise ValueError(f"a request has at most {REQUEST_LIMIT_BYTES} bytes, got {len(data)}")
    try:
        return decode_json(data, ControlRequest)
    except ValueError as error:
        raise ValueError(f'{error}; write {{"element": NAME, "property": NAME, "value": VALUE}}') from None


RECORD_TYPES: dict[str, type[msgspec.Struct]] = {
    CONTROL_SCHEMA: ControlReply,
    f"{CONTROL_SCHEMA}/request": ControlRequest,
    FRAME_SCHEMA: FrameHeader,
    STATUS_SCHEMA: StatusRecord,
    TRACKS_SCHEMA: TrackRecord,
    VIDEO_SCHEMA: VideoHeader,
}


@lru_cache(maxsize=1)
def json_schemas() -> dict[str, dict[str, Any]]:
    """JSON Schemas by the schema's name, `streamkit.tracks/1`."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return {name: {**head, "title": name, **msgspec.json.schema(kind)} for name, kind in RECORD_TYPES.items()}


@lru_cache(maxsize=1)
def schema_files() -> dict[str, bytes]:
    """Content of each schema file by name, `streamkit.tracks-1.schema.json`."""
    files = {PROTO_FILE.name: PROTO_FILE.read_bytes()}
    for name, schema in json_schemas().items():
        files[f"{name.replace('/', '-')}.schema.json"] = (json.dumps(schema, indent=1) + "\n").encode()
    return files


@lru_cache(maxsize=1)
def schema_index() -> bytes:
    """All schemas in one JSON object: JSON Schemas by name under `json_schemas`, the text of `proto`."""
    return json.dumps({"json_schemas": json_schemas(), "proto": PROTO_FILE.read_text("utf-8")}).encode()

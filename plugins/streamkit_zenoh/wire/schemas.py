"""The schemas of what is published: JSON Schema, generated from the record types, and streamkit.proto."""

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec

from streamkit import TRACKS_SCHEMA, TrackRecord
from streamkit_zenoh.wire.control import CONTROL_SCHEMA, ControlReply, ControlRequest
from streamkit_zenoh.wire.frame_header import FRAME_SCHEMA, FrameHeader
from streamkit_zenoh.wire.status import STATUS_SCHEMA, StatusRecord
from streamkit_zenoh.wire.video_header import VIDEO_SCHEMA, VideoHeader

PROTO_FILE = Path(__file__).with_name("streamkit.proto")
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

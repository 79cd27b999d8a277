"""Writes the schema files from the records' types: python -m streamkit_zenoh.wire.schemas.write."""

import json
from pathlib import Path

import msgspec

from streamkit import TrackRecord
from streamkit_zenoh.wire.frame_header import FRAME_SCHEMA, FrameHeader
from streamkit_zenoh.wire.protobuf import proto_text
from streamkit_zenoh.wire.records import TRACKS_SCHEMA
from streamkit_zenoh.wire.schemas import FOLDER, PROTO_FILE
from streamkit_zenoh.wire.status import STATUS_SCHEMA, StatusRecord

KINDS: dict[str, type[msgspec.Struct]] = {
    TRACKS_SCHEMA: TrackRecord,
    STATUS_SCHEMA: StatusRecord,
    FRAME_SCHEMA: FrameHeader,
}


def rendered() -> dict[str, str]:
    """Name and content of each file, as the types are now."""
    files = {PROTO_FILE: proto_text()}
    for name, kind in KINDS.items():
        schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": name}
        schema |= msgspec.json.schema(kind)
        files[f"{name.replace('/', '-')}.schema.json"] = json.dumps(schema, indent=1) + "\n"
    return files


def write(folder: Path = FOLDER) -> None:
    """Writes the files."""
    for name, content in rendered().items():
        (folder / name).write_text(content, encoding="utf-8")


if __name__ == "__main__":
    write()

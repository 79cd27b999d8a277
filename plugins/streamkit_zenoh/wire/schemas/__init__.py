"""The schemas of what travels, as files: JSON Schema and .proto, made from the records' types.

Write the files anew after a change: python -m streamkit_zenoh.wire.schemas.write
"""

import json
from functools import lru_cache
from pathlib import Path

FOLDER = Path(__file__).parent
PROTO_FILE = "streamkit.proto"


@lru_cache(maxsize=1)
def schema_files() -> dict[str, bytes]:
    """Name and content of each file."""
    paths = [path for path in sorted(FOLDER.iterdir()) if path.suffix in (".json", ".proto")]
    return {path.name: path.read_bytes() for path in paths}


@lru_cache(maxsize=1)
def schema_index() -> bytes:
    """All of them in one JSON object: JSON Schemas by the schema's name, and `proto` as text."""
    files = schema_files()
    schemas = {
        name.removesuffix(".schema.json").replace("-", "/"): json.loads(content)
        for name, content in files.items()
        if name.endswith(".json")
    }
    return json.dumps({"json_schemas": schemas, "proto": files[PROTO_FILE].decode()}).encode()

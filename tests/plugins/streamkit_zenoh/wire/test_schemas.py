"""The schema files of the package are those of the records."""

import json

import zenoh

from streamkit_zenoh.publish.answers import schema_answers
from streamkit_zenoh.wire.protobuf import MESSAGES
from streamkit_zenoh.wire.schemas import FOLDER, schema_files, schema_index
from streamkit_zenoh.wire.schemas.write import KINDS, rendered


def test_the_files_are_current() -> None:
    """After a change of a record: python -m streamkit_zenoh.wire.schemas.write."""
    assert {name: content.decode() for name, content in schema_files().items()} == rendered()
    assert {path.suffix for path in FOLDER.iterdir() if path.is_file()} == {".py", ".json", ".proto"}


def test_every_field_has_its_place_in_the_proto() -> None:
    """A field that is added to a record and not to the table would be lost on the way in protobuf."""
    for kind in KINDS.values():
        if kind.__name__ in MESSAGES:
            assert [field.name for field in MESSAGES[kind.__name__]] == list(kind.__struct_fields__)


def test_queries_are_answered_as_they_ask() -> None:
    """The whole at the key itself, one file by its name, all by a wildcard."""
    root = "uav/1/schema"
    assert [answer.key for answer in schema_answers(zenoh.KeyExpr(root), root)] == [root]
    (proto,) = schema_answers(zenoh.KeyExpr(f"{root}/streamkit.proto"), root)
    assert proto.payload.startswith(b"// Track records")
    assert len(list(schema_answers(zenoh.KeyExpr("uav/1/**"), root))) == 1 + len(schema_files())
    assert not list(schema_answers(zenoh.KeyExpr("uav/2/**"), root))


def test_the_index_has_everything() -> None:
    """One answer is enough to know all kinds."""
    index = json.loads(schema_index())
    assert set(index["json_schemas"]) == set(KINDS)
    assert "message TrackRecord {" in index["proto"]
    properties = index["json_schemas"]["streamkit.tracks/1"]["$defs"]["TrackRecord"]["properties"]
    assert {"seq", "epoch", "pts_ns", "capture_ns", "published_ns", "tracks"} <= set(properties)

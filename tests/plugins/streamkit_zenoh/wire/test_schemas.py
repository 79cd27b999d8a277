"""The schemas that are published are those of the records."""

import json

import pytest
import zenoh

from streamkit_zenoh.publish.publication import schema_replies
from streamkit_zenoh.wire.messages import RECORD_TYPES, json_schemas, schema_files, schema_index
from streamkit_zenoh.wire.protobuf import COLUMNS, PROTO_FILE, file_descriptor

# Fields of the published schemas, optional ones with a question mark. A field may be added as an optional one
# at the end; any other change needs a new schema number, `streamkit.tracks/2`.
FIELDS = {
    "ControlReply": "schema error? properties?",
    "ControlRequest": "element property value",
    "DetectionRecord": "centroid bbox area score label?",
    "DropCount": "stream reason count",
    "ElementDrop": "reason count",
    "ElementStatus": "name busy_ns drops",
    "FrameHeader": (
        "schema record format picture_width picture_height duration_ns? motion? detections? are_objects? "
        "pose?"
    ),
    "GeoRecord": "lat lon error_m?",
    "LiveProperty": "element factory property type value? choices? minimum? maximum? unit? doc?",
    "MatchRecord": "row gate? centroid bbox area score label?",
    "MotionRecord": "reference status to_previous? to_reference? reference_change? keyframe? matches? "
    "inliers? rmse? corner_std?",
    "PropertyChange": "element property value",
    "ProvenanceRecord": "predicted? detection? shared? similarity? learnt? cause?",
    "RegistrationRecord": "reference to_reference? status matches? inliers? rmse? corner_std?",
    "StatusRecord": "schema source state run published_ns uptime_s frames seq? epoch? tracks age_ms? streams "
    "drops control? changes? elements?",
    "StreamStatus": "name run settled_number published bytes has_subscriber next_number? first_number?",
    "TargetRecord": "id state x y length width angle bbox vx? vy? position_covariance? score age_ns geo? "
    "provenance?",
    "TrackRecord": "schema source seq epoch pts_ns? capture_ns? capture_origin? published_ns? age_ms? width? "
    "height? registration? tracks dropped",
    "VideoHeader": "schema source seq epoch pts_ns? duration_ns? capture_ns? published_ns keyframe? codec? "
    "codec_data? width? height? flipped? rotation?",
}


def _numbers() -> dict[str, dict[str, int]]:
    """Field numbers of streamkit.proto by message and field."""
    messages = file_descriptor(PROTO_FILE.read_text(encoding="utf-8")).message_type
    return {message.name: {field.name: field.number for field in message.field} for message in messages}


def test_the_fields_of_the_schemas_never_change() -> None:
    """Programs are written against the published JSON Schemas."""
    found = {}
    for schema in json_schemas().values():
        for name, kind in schema["$defs"].items():
            if "properties" in kind:
                required = kind["required"]
                found[name] = " ".join(f if f in required else f"{f}?" for f in kind["properties"])
    assert found == FIELDS


def test_every_field_is_in_the_proto() -> None:
    """A field that is added to a record and not to streamkit.proto would be lost in protobuf."""
    numbers = _numbers()
    for kind in RECORD_TYPES.values():
        if kind.__name__ in numbers:
            assert list(numbers[kind.__name__]) == list(kind.__struct_fields__)
    assert {name for fields in numbers.values() for name in fields} >= set(COLUMNS)


def test_the_numbers_of_fields_never_change() -> None:
    """Publishers and receivers of different versions read each other's records."""
    numbers = _numbers()
    for fields in numbers.values():
        assert list(fields.values()) == list(range(1, len(fields) + 1))
    assert numbers["TargetRecord"]["position_covariance"] == 11
    assert numbers["TargetRecord"]["provenance"] == 15
    assert (numbers["TrackRecord"]["tracks"], numbers["TrackRecord"]["dropped"]) == (13, 14)
    assert (numbers["StatusRecord"]["drops"], numbers["StreamStatus"]["first_number"]) == (13, 8)


@pytest.mark.parametrize("line", ["enum State {", "  map<string, int64> counts = 1;", "  double data;"])
def test_an_unknown_statement_is_refused(line: str) -> None:
    """The parser raises for anything but messages and fields."""
    with pytest.raises(ValueError, match="not a message, field, syntax or package"):
        file_descriptor(f"message A {{\n{line}\n}}")


def test_schema_replies_match_the_query() -> None:
    """All schemas at the key itself, one file by its name, everything by a wildcard."""
    root = "uav/1/schema"
    assert [reply.key for reply in schema_replies(zenoh.KeyExpr(root), root)] == [root]
    (proto,) = schema_replies(zenoh.KeyExpr(f"{root}/streamkit.proto"), root)
    assert proto.payload.startswith(b"// Track records")
    assert len(list(schema_replies(zenoh.KeyExpr("uav/1/**"), root))) == 1 + len(schema_files())
    assert not list(schema_replies(zenoh.KeyExpr("uav/2/**"), root))


def test_the_index_has_everything() -> None:
    """One reply holds all schemas."""
    index = json.loads(schema_index())
    assert set(index["json_schemas"]) == set(RECORD_TYPES)
    assert "message TrackRecord {" in index["proto"]
    properties = index["json_schemas"]["streamkit.tracks/1"]["$defs"]["TrackRecord"]["properties"]
    assert {"seq", "epoch", "pts_ns", "capture_ns", "published_ns", "tracks"} <= set(properties)

"""Every encoding gives the same record back, and refuses invalid data."""

import gc
import random
from typing import Any

import msgspec
import pytest

from streamkit import TRACKS_SCHEMA, TrackRecord, decode_record
from streamkit_zenoh.wire.encodings import RECORD_LIMIT_BYTES, BadPayload, Codec, Encoding, encoding_of
from streamkit_zenoh.wire.messages import STATUS_SCHEMA, DropCount, StatusRecord, StreamStatus

FULL = b"""{"schema": "streamkit.tracks/1", "source": "uav/1", "seq": 120, "epoch": 2,
 "pts_ns": -4800000000, "capture_ns": 1763690000123456789, "capture_origin": "rtcp",
 "published_ns": 1763690000171000000, "age_ms": 47.5, "width": 1920, "height": 1080,
 "registration": {"reference": 3, "to_reference": [[1, 0.5, 0], [0, 1, -7.25], [0, 0, 1]], "status": "weak"},
 "tracks": [{"id": 7, "state": "confirmed", "x": 812.4, "y": 377.0, "length": 31.2,
   "width": 14.8, "angle": 0.41, "bbox": [796.0, 366.1, 828.8, 387.9],
   "vx": 61.0, "vy": -4.2, "position_covariance": [[1.1, 0.25], [0.25, 0.9]],
   "score": 0.87, "age_ns": 3120000000, "geo": {"lat": 48.1, "lon": 11.5, "error_m": 3.5}}],
 "dropped": 5}"""
BARE = b'{"schema": "streamkit.tracks/1", "source": "", "seq": 0, "epoch": 0, "tracks": [], "dropped": 0}'
EMPTY_TARGET = FULL.replace(
    b'"vx": 61.0, "vy": -4.2, "position_covariance": [[1.1, 0.25], [0.25, 0.9]],', b""
)


def _codec(encoding: Encoding) -> Codec[TrackRecord]:
    return Codec(TrackRecord, TRACKS_SCHEMA, encoding)


@pytest.mark.parametrize("encoding", Encoding)
@pytest.mark.parametrize("text", [FULL, BARE, EMPTY_TARGET])
def test_a_record_survives_every_encoding(encoding: Encoding, text: bytes) -> None:
    """Numbers are exact, and missing fields stay missing."""
    record = decode_record(text)
    codec = _codec(encoding)
    assert codec.decode(codec.encode(record)) == record
    assert encoding_of(codec.content_type) is encoding
    assert codec.content_type.endswith(";streamkit.tracks/1")


@pytest.mark.parametrize("encoding", Encoding)
def test_the_status_survives_every_encoding(encoding: Encoding) -> None:
    """The status has the same encodings."""
    stream = StreamStatus(name="tracks", run=17, settled_number=5, published=4, bytes=999, has_subscriber=1)
    status = StatusRecord(
        schema=STATUS_SCHEMA, source="uav/1", state="playing", run=17, published_ns=18, uptime_s=1.5,
        frames=5, seq=4, epoch=0, tracks=3, age_ms=12.5, streams=(stream,),
        drops=(DropCount(stream="tracks", reason="queue full", count=2),),
    )  # fmt: skip
    codec = Codec(StatusRecord, STATUS_SCHEMA, encoding)
    assert codec.decode(codec.encode(status)) == status


def _changed(**changes: Any) -> dict[str, Any]:
    return {**msgspec.json.decode(FULL), **changes}


@pytest.mark.parametrize("encoding", [Encoding.MSGPACK, Encoding.CBOR, Encoding.PROTOBUF])
def test_numbers_must_be_finite(encoding: Encoding) -> None:
    """Other encodings than JSON have NaN; records must not."""
    record = decode_record(FULL)
    target = msgspec.structs.replace(record.tracks[0], x=float("nan"))
    broken = msgspec.structs.replace(record, tracks=(target,))
    codec = _codec(encoding)
    with pytest.raises(BadPayload, match="finite"):
        codec.decode(codec.encode(broken))


@pytest.mark.parametrize(
    "wrong",
    [
        {"schema": "streamkit.tracks/2"},
        {"seq": -1},
        {"seq": "x"},
        {"tracks": [{"id": 1}]},
        {"capture_origin": "guess"},
    ],
)
@pytest.mark.parametrize("encoding", [Encoding.JSON, Encoding.MSGPACK, Encoding.CBOR])
def test_what_breaks_the_schema_is_refused(encoding: Encoding, wrong: dict[str, Any]) -> None:
    """The error names schema and encoding."""
    import cbor2

    writers = {
        Encoding.JSON: msgspec.json.encode,
        Encoding.MSGPACK: msgspec.msgpack.encode,
        Encoding.CBOR: cbor2.dumps,
    }
    with pytest.raises(BadPayload, match=rf"no streamkit.tracks/1 in {encoding}: "):
        _codec(encoding).decode(writers[encoding](_changed(**wrong)))


@pytest.mark.parametrize("encoding", Encoding)
def test_mutated_payloads_are_refused_or_read(encoding: Encoding) -> None:
    """Any bytes give a record or BadPayload, never another error."""
    codec, generator = _codec(encoding), random.Random(f"{encoding}")
    good = codec.encode(decode_record(FULL))
    refused = 0
    for _ in range(2500):
        data = bytearray(good if generator.random() < 0.7 else generator.randbytes(generator.randrange(200)))
        for _ in range(generator.randrange(1, 6)):
            if data:
                data[generator.randrange(len(data))] = generator.randrange(256)
        if generator.random() < 0.3:
            del data[generator.randrange(len(data) + 1) :]
        try:
            codec.decode(bytes(data))
        except BadPayload:
            refused += 1
    assert refused > 500


@pytest.mark.parametrize("encoding", Encoding)
def test_bombs_are_refused(encoding: Encoding) -> None:
    """Deep nesting and wrong lengths cost no memory and no crash."""
    codec = _codec(encoding)
    for data in (
        b"[" * 100_000,
        b"\x81" * 100_000,
        b"\x9b" + b"\xff" * 8,
        b"\xdd\xff\xff\xff\xff",
        b"\xdf" * 50_000,
    ):
        with pytest.raises(BadPayload):
            codec.decode(data)
    with pytest.raises(BadPayload, match="too many"):
        codec.decode(bytes(RECORD_LIMIT_BYTES + 1))


@pytest.mark.parametrize("encoding", [Encoding.CBOR, Encoding.MSGPACK, Encoding.JSON])
def test_invalid_text_is_refused_and_leaks_nothing(encoding: Encoding) -> None:
    """Each text that is not UTF-8 is an error, which leaves nothing in memory."""
    codec = _codec(encoding)
    damaged = codec.encode(decode_record(FULL)).replace(b"uav/1", b"ua\xff\xfe1")

    def objects_after(count: int) -> int:
        for _ in range(count):
            with pytest.raises(BadPayload):
                codec.decode(damaged)
        gc.collect()
        return len(gc.get_objects())

    before = objects_after(10)
    assert objects_after(300) - before < 100


@pytest.mark.parametrize(
    ("content_type", "encoding"),
    [
        ("zenoh/bytes", Encoding.JSON),
        ("application/json", Encoding.JSON),
        ("application/cbor;anything", Encoding.CBOR),
        ("image/jpeg", None),
        ("application/xml", None),
    ],
)
def test_the_content_type_names_the_encoding(content_type: str, encoding: Encoding | None) -> None:
    """An unspecific content type is JSON; an unknown one has no encoding."""
    assert encoding_of(content_type) is encoding


@pytest.mark.parametrize(
    ("encoding", "module"), [(Encoding.CBOR, "cbor2"), (Encoding.PROTOBUF, "google.protobuf")]
)
def test_a_missing_library_is_named(encoding: Encoding, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The remedy is in the error."""
    import sys

    from streamkit_zenoh.wire.encodings import MissingLibrary

    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, "streamkit_zenoh.wire.protobuf", raising=False)
    with pytest.raises(
        MissingLibrary, match=rf"encoding={encoding} needs .* pip install 'streamkit\[encodings\]'"
    ):
        _codec(encoding)

"""A subscriber written against the published schema alone; imports nothing of streamkit.

    python zenoh_foreign_subscriber.py KEY ENDPOINT COUNT

Prints each record as JSON. What it needs to know of protocol buffers it reads from the .proto at KEY/schema.
"""

import copy
import json
import queue
import re
import struct
import sys

import cbor2
import msgspec
import zenoh

FIELD = re.compile(r"^\s*(optional |repeated )?(\w+) (\w+) = (\d+);")


def messages_of(proto):
    """The fields of each message: number to (name, type, label)."""
    found, fields = {}, {}
    for line in proto.splitlines():
        if line.startswith("message "):
            fields = found[line.split()[1]] = {}
        elif match := FIELD.match(line):
            fields[int(match[4])] = (match[3], match[2], (match[1] or "").strip())
    return found


def varint(data, place):
    """A varint of seven bits per byte, and the position after it."""
    value = shift = 0
    while True:
        byte = data[place]
        value |= (byte & 127) << shift
        place, shift = place + 1, shift + 7
        if byte < 128:
            return value, place


def signed(value):
    """An int64 from its unsigned value."""
    return value - 2**64 if value >= 2**63 else value


def decoded(data, name, messages):
    """A message by its fields."""
    defaults = {"repeated": [], "uint64": 0, "int64": 0, "double": 0, "string": ""}
    fields = [(field, label or kind) for field, kind, label in messages[name].values()]
    result = {field: copy.copy(defaults[what]) for field, what in fields if what in defaults}
    place = 0
    while place < len(data):
        tag, place = varint(data, place)
        field, kind, label = messages[name][tag >> 3]
        if tag & 7 == 0:
            value, place = varint(data, place)
            value = signed(value) if kind == "int64" else value
        elif tag & 7 == 1:
            (value,), place = struct.unpack_from("<d", data, place), place + 8
        else:
            size, place = varint(data, place)
            chunk, place = data[place : place + size], place + size
            if kind == "double":
                value = list(struct.unpack(f"<{size // 8}d", chunk))
            elif kind == "string":
                value = chunk.decode()
            else:
                value = decoded(chunk, kind, messages)
        if label == "repeated" and not (kind == "double" and isinstance(value, list)):
            result[field].append(value)
        else:
            result[field] = value
    return result


def rows(numbers, columns):
    """A matrix from its flattened numbers."""
    return [numbers[start : start + columns] for start in range(0, len(numbers), columns)]


def record_of(sample, messages):
    """The record, in the encoding that the sample names."""
    media_type, _, schema = str(sample.encoding).partition(";")
    assert schema == "streamkit.tracks/1", schema
    data = sample.payload.to_bytes()
    if media_type == "application/json":
        return json.loads(data)
    if media_type == "application/msgpack":
        return msgspec.msgpack.decode(data)
    if media_type == "application/cbor":
        return cbor2.loads(data)
    assert media_type == "application/protobuf", media_type
    record = decoded(data, "TrackRecord", messages)
    record["registration"]["to_reference"] = rows(record["registration"]["to_reference"], 3)
    for track in record["tracks"]:
        track["position_covariance"] = rows(track["position_covariance"], 2)
    return record


def main(key, endpoint, count):
    """Prints a number of records."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    samples = queue.Queue()
    with zenoh.open(config) as session:
        session.declare_subscriber(f"{key}/tracks", samples.put)
        (answer,) = [reply.ok for reply in session.get(f"{key}/schema")]
        messages = messages_of(json.loads(answer.payload.to_bytes())["proto"])
        for _ in range(count):
            print(json.dumps(record_of(samples.get(timeout=30), messages)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))

"""mcapsink: track records in an MCAP file, for Foxglove and other viewers of recordings."""

import json
from typing import Any, BinaryIO

import msgspec
from typing_extensions import override

from streamkit import Frame, Property, ResourceError, TrackRecord, encode_record
from streamkit_tracks.record_file import RecordFileSink

SCHEMA = "streamkit.tracks/1"


class McapSink(RecordFileSink):
    """Writes a record per frame to an MCAP file: JSON messages with their JSON Schema, indexed by time.

    Needs the extra `mcap`: pip install 'streamkit[mcap]'.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! mcapsink location=tracks.mcap
    """

    topic: str = Property("/tracks", doc="Topic of the messages.")

    @override
    def start(self) -> None:
        try:
            from mcap.writer import Writer
        except ImportError:
            raise ResourceError(
                "mcapsink needs the library mcap, which is not installed; "
                "install it with: pip install 'streamkit[mcap]'"
            ) from None
        self._writer_class = Writer
        super().start()

    @override
    def begin(self, file: BinaryIO) -> None:
        self._writer: Any = self._writer_class(file)
        self._writer.start(profile="", library="streamkit")
        schema = self._writer.register_schema(SCHEMA, "jsonschema", _json_schema())
        self._channel = self._writer.register_channel(self.topic, "json", schema)

    @override
    def write(self, file: BinaryIO, frame: Frame) -> None:
        now_ns = self.clock.utc_ns()
        record = self.record(frame, now_ns)
        published_ns = now_ns if record.published_ns is None else record.published_ns
        time_ns = published_ns if record.capture_ns is None else record.capture_ns
        data, sequence = encode_record(record), record.seq % 2**32
        self._writer.add_message(self._channel, max(0, time_ns), data, max(0, published_ns), sequence)

    @override
    def end(self, file: BinaryIO) -> None:
        self._writer.finish()


def _json_schema() -> bytes:
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": SCHEMA}
    return json.dumps(schema | msgspec.json.schema(TrackRecord), indent=1).encode()

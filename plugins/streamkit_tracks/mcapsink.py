"""mcapsink: track records in an MCAP file, for Foxglove and other viewers of recordings."""

from __future__ import annotations

import io
import json
import time
from typing import TYPE_CHECKING, Any

import msgspec
from typing_extensions import override

from streamkit import TRACKS_SCHEMA, Frame, Property, TrackRecord, encode_record, needs_extra
from streamkit_tracks.record_sink import RecordFileSink

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

FLUSH_S = 1.0


class McapSink(RecordFileSink):
    """Writes a record per frame to an MCAP file: JSON messages with their JSON Schema, with an index.

    Messages are in the file within a second. A file without its end, as after a kill, has no index;
    `mcap recover` adds it.

    Needs the extra `mcap`: pip install 'streamkit[mcap]'.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! mcapsink location=tracks.mcap
    """

    suffixes = (".mcap",)
    example = "tracks.mcap"
    topic: str = Property("/tracks", doc="Topic of the messages.")

    @override
    def start(self) -> None:
        super().start()
        with needs_extra("mcapsink", "mcap"):
            from mcap.writer import Writer
        self._open_writer: Any = Writer

    @override
    def begin(self) -> None:
        super().begin()
        assert self.file is not None
        self._writer: Any = self._open_writer(PositionedWriter(self.file))
        self._writer.start(profile="", library="streamkit")
        schema = self._writer.register_schema(TRACKS_SCHEMA, "jsonschema", _json_schema())
        self._channel = self._writer.register_channel(self.topic, "json", schema)
        self._due_s = 0.0

    @override
    def write(self, frame: Frame) -> None:
        now_ns = self.clock.utc_ns()
        record = self.record(frame, now_ns)
        published_ns = now_ns if record.published_ns is None else record.published_ns
        time_ns = published_ns if record.capture_ns is None else record.capture_ns
        data, sequence = encode_record(record), record.seq % 2**32
        self._writer.add_message(self._channel, max(0, time_ns), data, max(0, published_ns), sequence)
        if time.monotonic() >= self._due_s:
            self._flush()

    @override
    def end(self) -> None:
        self._writer.finish()
        self._flush()
        super().end()

    def _flush(self) -> None:
        assert self.file is not None
        self._writer.flush()
        self.file.publish()
        self._due_s = time.monotonic() + FLUSH_S


class PositionedWriter(io.BufferedWriter):
    """A buffer that knows its position, also before a pipe: the index of MCAP has positions."""

    _position = 0

    def write(self, data: ReadableBuffer, /) -> int:
        """Buffers data."""
        count = super().write(data)
        self._position += count
        return count

    def tell(self) -> int:
        """The number of bytes written so far."""
        return self._position


def _json_schema() -> bytes:
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": TRACKS_SCHEMA}
    return json.dumps(schema | msgspec.json.schema(TrackRecord), indent=1).encode()

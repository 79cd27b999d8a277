"""tracksink: the tracks of each frame in a file: JSON lines, MOT Challenge, CSV, GeoJSON, KML or CoT."""

from collections.abc import Mapping
from typing import ClassVar

import msgspec
from typing_extensions import override

from streamkit import TRACKS_CAPS, Frame, Property, TextFileSink, encode_record, record_line
from streamkit.output.text import TextFormat
from streamkit_tracks.cursor_on_target import CotFormat
from streamkit_tracks.file_formats import FORMATS, GEOGRAPHIC, KINDS, FileKind, RecordFormat
from streamkit_tracks.record_sink import RecordFileSink
from streamkit_tracks.trails import TRAILS


class TrackSink(TextFileSink[RecordFormat], RecordFileSink):
    """Writes one record per frame: as a line of JSON, as zenohsink publishes it, or in another format.

    JSON lines also hold the provenance of each target, which `streamkit explain` puts in words. GeoJSON and
    KML hold a line with times for each target with ground coordinates, CoT an event a line; coordinates are
    those of the records, or follow from pose and ground-altitude.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! tracksink location=tracks.jsonl
    """

    format: FileKind = Property(
        FileKind.AUTO,
        doc="auto is by the suffix of location: .jsonl, .txt (mot), .csv, .geojson, .kml or .cot.",
    )
    points: bool = Property(
        False, doc="In GeoJSON and KML, a point for each target and time in place of its line."
    )
    stamp: bool = Property(
        True, doc="Write when each record was made, and its age; off, equal runs write equal files."
    )
    provenance: bool = Property(
        True, doc="Write the provenance of each target into JSON lines, for `streamkit explain`."
    )

    formats: ClassVar[Mapping[str, type[TextFormat]]] = {**FORMATS, FileKind.COT: CotFormat}
    kinds = KINDS
    suffixes = tuple(KINDS)
    example = "tracks.jsonl"

    @override
    def make_content(self) -> RecordFormat:
        trails = None if self.points else TRAILS.get(self.kind())
        return super().make_content() if trails is None else trails()

    @override
    def needs_positions(self) -> bool:
        return self.kind() in GEOGRAPHIC

    @override
    def write(self, frame: Frame) -> None:
        now_ns = self.clock.utc_ns() if self.stamp else None
        kind = self.kind()
        if kind != FileKind.JSONL:
            fields = msgspec.to_builtins(self.record(frame, now_ns))
            rows = fields["tracks"]
            if kind in GEOGRAPHIC and rows and not any("geo" in row for row in rows):
                self.count_drop("no target with a place")
            self.append(self.content.record(fields))
        elif frame.caps.name == TRACKS_CAPS.name:
            self.append(record_line(frame) + b"\n")
        else:
            self.append(encode_record(self.record(frame, now_ns, provenance=self.provenance)) + b"\n")

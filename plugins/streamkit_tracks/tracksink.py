"""tracksink: the tracks of each frame in a file: JSON lines, MOT Challenge, CSV, GeoJSON or KML."""

from pathlib import Path
from typing import BinaryIO

import msgspec
from typing_extensions import override

from streamkit import TRACKS_CAPS, Frame, Property, encode_record, record_line
from streamkit_tracks.file_formats import FORMATS, GEOGRAPHIC, SUFFIXES, FileKind, RecordFormat
from streamkit_tracks.record_file import RecordFileSink


class TrackSink(RecordFileSink):
    """Writes one record per frame: as a line of JSON, as zenohsink publishes it, or in another format.

    JSON lines also hold the provenance of each target, which `streamkit explain` puts in words. GeoJSON and
    KML hold the targets with ground coordinates, from the records or from pose and ground-altitude.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! tracksink location=tracks.jsonl
    """

    format: FileKind = Property(
        FileKind.AUTO,
        doc="auto is by the suffix of location: .txt is mot, .csv, .geojson, .kml, else jsonl.",
    )
    stamp: bool = Property(
        True, doc="Write when each record was made, and its age; off, equal runs write equal files."
    )
    provenance: bool = Property(
        True, doc="Write the provenance of each target into JSON lines, for `streamkit explain`."
    )

    @override
    def begin(self, file: BinaryIO) -> None:
        kind = self.format
        if kind is FileKind.AUTO:
            kind = SUFFIXES.get(Path(self.location).suffix.lower(), FileKind.JSONL)
        self._is_geographic = kind in GEOGRAPHIC
        self._format: RecordFormat | None = None if kind is FileKind.JSONL else FORMATS[kind]()
        if self._format is not None:
            file.write(self._format.begin())

    @override
    def write(self, file: BinaryIO, frame: Frame) -> None:
        now_ns = self.clock.utc_ns() if self.stamp else None
        if self._format is not None:
            fields = msgspec.to_builtins(self.record(frame, now_ns))
            if self._is_geographic and fields["tracks"] and not any("geo" in row for row in fields["tracks"]):
                self.count_drop("no target with a place")
            file.write(self._format.record(fields))
        elif frame.caps.name == TRACKS_CAPS.name:
            file.write(record_line(frame) + b"\n")
        else:
            file.write(encode_record(self.record(frame, now_ns, provenance=self.provenance)) + b"\n")

    @override
    def end(self, file: BinaryIO) -> None:
        if self._format is not None:
            file.write(self._format.end())

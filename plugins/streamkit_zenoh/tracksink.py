"""tracksink: the tracks of each frame in a file: JSON lines, MOT Challenge, CSV, GeoJSON or KML."""

import contextlib
from io import BufferedWriter
from pathlib import Path

from streamkit import Frame, Property, ResourceError, Sink, encode_record, write_remedy
from streamkit_zenoh.export.files import KINDS, SUFFIXES, FileKind, RecordFile, needs_places
from streamkit_zenoh.wire.records import payload_of, plain_record, record_of


class TrackSink(Sink):
    """Writes one JSON record per frame, a line each, in the form that zenohsink publishes; or another form.

    JSON lines tell besides where each target comes from, which `streamkit explain` puts in words. GeoJSON
    and KML hold the targets whose place on the ground is known, from the records or from pose and
    ground-altitude.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! tracksink location=tracks.jsonl
    """

    sink = "video/x-raw; application/x-tracks"
    location: str = Property("", doc="File to write; one that is there is replaced.")
    format: FileKind = Property(
        FileKind.AUTO, doc="auto goes by the end of location: .txt is mot, .csv, .geojson, .kml, else jsonl."
    )
    source: str | None = Property(
        None, doc="Source named in the records; the file's name without its end if unset."
    )
    stamp: bool = Property(
        True, doc="Write when each record was made, and its age; off, equal runs write equal files."
    )
    provenance: bool = Property(
        True, doc="Write into JSON lines where each target comes from, for `streamkit explain`."
    )
    ground_altitude: float | None = Property(
        None, unit="m", doc="Of the ground, counted as the poses count it."
    )

    _file: BufferedWriter | None = None
    _form: RecordFile | None = None

    def start(self) -> None:
        """Opens the file."""
        self._file = self._form = None
        if not self.location:
            raise ResourceError("location must be set; write for example location=tracks.jsonl")
        try:
            self._file = Path(self.location).open("wb")  # noqa: SIM115  closed by `stop`
        except OSError as error:
            raise ResourceError(
                f"location={self.location}: cannot be written: {error.strerror}; name another file"
            ) from error
        kind = self.format
        if kind is FileKind.AUTO:
            kind = SUFFIXES.get(Path(self.location).suffix.lower(), FileKind.JSONL)
        self._needs_places = needs_places(kind)
        if kind is not FileKind.JSONL:
            self._form = KINDS[kind]()
            self._write(self._form.begin())

    def render(self, frame: Frame) -> None:
        """Writes the frame's record."""
        assert self._file is not None, "start() comes before frames"
        now_ns = self.clock.utc_ns() if self.stamp else None
        source = self.source or Path(self.location).stem
        if self._form is None and self.ground_altitude is None:
            self._write(payload_of(frame, source, now_ns, 0, provenance=self.provenance) + b"\n")
        elif self._form is None:
            record = record_of(frame, source, now_ns, 0, self.ground_altitude, provenance=self.provenance)
            self._write(encode_record(record) + b"\n")
        else:
            plain = plain_record(frame, source, now_ns, self.ground_altitude)
            if self._needs_places and plain["tracks"] and not any("geo" in row for row in plain["tracks"]):
                self.count_drop("no target with a place")
            self._write(self._form.record(plain))

    def drain(self) -> None:
        """Hands everything to the file system."""
        self._close()

    def stop(self) -> None:
        """Closes the file, whole lines in it."""
        self._close()

    def _close(self) -> None:
        file, form = self._file, self._form
        self._file = self._form = None
        if file is not None:
            try:
                with file:
                    file.write(b"" if form is None else form.end())
            except OSError as error:
                raise self._unwritten(error) from error

    def _write(self, data: bytes) -> None:
        assert self._file is not None, "start() comes before frames"
        try:
            self._file.write(data)
        except OSError as error:
            raise self._unwritten(error) from error

    def _unwritten(self, error: OSError) -> ResourceError:
        """The error; the file is let go of, for it not to be told again at the stop."""
        file, self._file = self._file, None
        if file is not None:
            with contextlib.suppress(OSError):
                file.close()
        return ResourceError(
            f"location={self.location}: a record was not written: {error.strerror}{write_remedy(error)}"
        )

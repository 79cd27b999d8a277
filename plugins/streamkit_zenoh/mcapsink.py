"""mcapsink: track records in an MCAP file, for Foxglove and other viewers of recordings."""

import contextlib
from pathlib import Path
from typing import IO, Any

from streamkit import Frame, Property, ResourceError, Sink, encode_record, write_remedy
from streamkit_zenoh.wire.records import TRACKS_SCHEMA, record_of
from streamkit_zenoh.wire.schemas import schema_files

SCHEMA_FILE = "streamkit.tracks-1.schema.json"


class McapSink(Sink):
    """Writes a record per frame to an MCAP file: JSON messages with their JSON Schema, indexed by time.

    Needs the extra `mcap`: pip install 'streamkit[mcap]'.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! mcapsink location=tracks.mcap
    """

    sink = "video/x-raw; application/x-tracks"
    location: str = Property("", doc="File to write; one that is there is replaced.")
    source: str | None = Property(
        None, doc="Source named in the records; the file's name without its end if unset."
    )
    topic: str = Property("/tracks", doc="Topic of the messages.")
    ground_altitude: float | None = Property(
        None, unit="m", doc="Of the ground, counted as the poses count it."
    )

    _file: IO[bytes] | None = None
    _writer: Any = None

    def start(self) -> None:
        """Opens the file and declares the channel."""
        self._file = self._writer = None
        try:
            from mcap.writer import Writer
        except ImportError:
            raise ResourceError(
                "mcapsink needs the library mcap, which is not installed; "
                "install it with: pip install 'streamkit[mcap]'"
            ) from None
        if not self.location:
            raise ResourceError("location must be set; write for example location=tracks.mcap")
        try:
            self._file = Path(self.location).open("wb")  # noqa: SIM115  closed by `stop`
        except OSError as error:
            raise ResourceError(
                f"location={self.location}: cannot be written: {error.strerror}; name another file"
            ) from error
        self._writer = Writer(self._file)
        self._writer.start(profile="", library="streamkit")
        schema = self._writer.register_schema(TRACKS_SCHEMA, "jsonschema", schema_files()[SCHEMA_FILE])
        self._channel = self._writer.register_channel(self.topic, "json", schema)

    def render(self, frame: Frame) -> None:
        """Writes the frame's record, at the time of capture where it is known."""
        now_ns = self.clock.utc_ns()
        record = record_of(frame, self.source or Path(self.location).stem, now_ns, 0, self.ground_altitude)
        time_ns = next(
            (time for time in (record.capture_ns, record.published_ns) if time is not None), now_ns
        )
        published_ns = now_ns if record.published_ns is None else record.published_ns
        try:
            self._writer.add_message(
                self._channel,
                max(0, time_ns),
                encode_record(record),
                max(0, published_ns),
                record.seq % 2**32,
            )
        except OSError as error:
            raise self._unwritten(error) from error

    def drain(self) -> None:
        """Writes the index."""
        self._close()

    def stop(self) -> None:
        """Closes the file, with its index."""
        self._close()

    def _close(self) -> None:
        file, writer = self._file, self._writer
        self._file = self._writer = None
        if file is None:
            return
        try:
            with file:
                if writer is not None:
                    writer.finish()
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

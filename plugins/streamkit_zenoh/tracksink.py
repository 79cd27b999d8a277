"""tracksink: the tracks of each frame as a line of a file."""

from io import BufferedWriter
from pathlib import Path

from streamkit import Frame, Property, ResourceError, Sink
from streamkit_zenoh.wire.records import payload_of


class TrackSink(Sink):
    """Writes one JSON record per frame, a line each, in the form that zenohsink publishes.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! tracksink location=tracks.jsonl
    """

    sink = "video/x-raw; application/x-tracks"
    location: str = Property("", doc="File to write; one that is there is replaced.")
    source: str | None = Property(
        None, doc="Source named in the records; the file's name without its end if unset."
    )
    stamp: bool = Property(
        True, doc="Write when each record was made, and its age; off, equal runs write equal files."
    )

    _file: BufferedWriter | None = None

    def start(self) -> None:
        """Opens the file."""
        self._file = None
        if not self.location:
            raise ResourceError("location must be set; write for example location=tracks.jsonl")
        try:
            self._file = Path(self.location).open("wb")  # noqa: SIM115  closed by `stop`
        except OSError as error:
            raise ResourceError(
                f"location={self.location}: cannot be written: {error.strerror}; name another file"
            ) from error

    def render(self, frame: Frame) -> None:
        """Writes the frame's record."""
        assert self._file is not None, "start() comes before frames"
        now_ns = self.clock.utc_ns() if self.stamp else None
        payload = payload_of(frame, self.source or Path(self.location).stem, now_ns, 0)
        try:
            self._file.write(payload + b"\n")
        except OSError as error:
            raise self._unwritten(error) from error

    def drain(self) -> None:
        """Hands everything to the file system."""
        self._close()

    def stop(self) -> None:
        """Closes the file, whole lines in it."""
        self._close()

    def _close(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError as error:
                raise self._unwritten(error) from error

    def _unwritten(self, error: OSError) -> ResourceError:
        return ResourceError(
            f"location={self.location}: a record was not written: {error.strerror}; free some space"
        )

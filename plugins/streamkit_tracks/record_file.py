"""RecordFileSink: base of sinks that write track records to a file."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from typing_extensions import override

from streamkit import Frame, Property, ResourceError, Sink, TrackRecord, track_record, write_remedy


class RecordFileSink(Sink):
    """Opens and closes the file and reports the first write error; override `begin`, `write` and `end`."""

    sink = "video/x-raw; application/x-tracks"
    location: str = Property("", doc="File to write; an existing file is replaced.")
    source: str | None = Property(
        None, doc="Source named in the records; the file's name without its suffix if unset."
    )
    ground_altitude: float | None = Property(
        None, unit="m", doc="Altitude of the ground, with the datum of the poses; adds ground coordinates."
    )

    _file: BinaryIO | None = None

    def begin(self, file: BinaryIO) -> None:
        """Writes what precedes the first record."""

    def write(self, file: BinaryIO, frame: Frame) -> None:
        """Writes the record of a frame."""
        raise NotImplementedError

    def end(self, file: BinaryIO) -> None:
        """Writes what follows the last record; also called at a stop without EOS."""

    def record(self, frame: Frame, published_ns: int | None, *, provenance: bool = False) -> TrackRecord:
        """The record of a frame, as the properties say."""
        return track_record(
            frame,
            source=self.source or Path(self.location).stem,
            published_ns=published_ns,
            ground_altitude_m=self.ground_altitude,
            provenance=provenance,
        )

    @override
    def start(self) -> None:
        self._file = None
        if not self.location:
            raise ResourceError("location must be set; write for example location=tracks.jsonl")
        try:
            self._file = file = Path(self.location).open("wb")  # noqa: SIM115  closed by `stop`
        except OSError as error:
            raise ResourceError(
                f"location={self.location}: cannot be written: {error.strerror}; name another file"
            ) from error
        with self._reported(file):
            self.begin(file)

    @override
    def render(self, frame: Frame) -> None:
        assert self._file is not None, "start() precedes frames"
        with self._reported(self._file):
            self.write(self._file, frame)

    @override
    def drain(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            with self._reported(file), file:
                self.end(file)

    @override
    def stop(self) -> None:
        self.drain()

    @contextlib.contextmanager
    def _reported(self, file: BinaryIO) -> Iterator[None]:
        """Closes the file at a write error and raises ResourceError; `stop` then has nothing to report."""
        try:
            yield
        except OSError as error:
            self._file = None
            with contextlib.suppress(OSError):
                file.close()
            raise ResourceError(
                f"location={self.location}: a record was not written: {error.strerror}{write_remedy(error)}"
            ) from error

"""tracksrc: the track records of a file of JSON lines, one frame each."""

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from typing_extensions import override

from streamkit import (
    TRACKS_CAPS,
    Caps,
    Frame,
    Property,
    ResourceError,
    RunCounter,
    Source,
    StreamError,
    decode_record,
)

# As for a record received over zenoh.
LINE_LIMIT_BYTES = 4 << 20


class TrackSrc(Source):
    """Reads the track records that tracksink has written as JSON lines, with the times of their frames.

    Example:
        tracksrc location=tracks.jsonl ! identity sync=true ! zenohsink key=uav/1
    """

    src = str(TRACKS_CAPS)
    location: str = Property("", doc="The file, as tracksink writes it.", file="read")
    run: int = Property(
        0, min=0, doc="The run that is read, of a file to which several were appended; 0: all."
    )

    _lines: BinaryIO | None = None

    @override
    def start(self) -> None:
        try:
            self._lines = Path(self.location).open("rb")  # noqa: SIM115 - closed by stop()
        except OSError as error:
            raise ResourceError(
                f"location={self.location}: {error.strerror}; name a file that tracksink wrote"
            ) from None

    @override
    def stop(self) -> None:
        if self._lines is not None:
            self._lines.close()

    @override
    def negotiate(self, allowed: Caps) -> Caps:
        return TRACKS_CAPS

    @override
    def frames(self) -> Iterator[Frame]:
        """One frame for each line; raises `StreamError` where a line is no record."""
        lines, number = self._lines, 0
        assert lines is not None, "start() precedes frames"
        runs = RunCounter()
        while line := lines.readline(LINE_LIMIT_BYTES):
            number += 1
            if not line.strip():
                continue
            frame = self._frame(line.strip(), number)
            if self.run in (0, runs.run_of(frame.epoch, frame.seq)):
                yield frame

    def _frame(self, line: bytes, number: int) -> Frame:
        try:
            record = decode_record(line)
        except StreamError as error:
            raise StreamError(f"{self.location}, line {number}: {error}") from None
        return Frame(
            line, TRACKS_CAPS, pts=record.pts_ns, epoch=record.epoch, seq=record.seq, capture=record.capture
        )

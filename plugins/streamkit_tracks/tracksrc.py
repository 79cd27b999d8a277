"""tracksrc: the track records of a file of JSON lines, one frame each."""

from collections.abc import Iterator
from pathlib import Path

from typing_extensions import override

from streamkit import TRACKS_CAPS, Caps, Frame, Property, RecordFile, ResourceError, Source


class TrackSrc(Source):
    """Reads the track records that tracksink has written as JSON lines, with the times of their frames.

    A last line that is only half written, as by a process that was killed, is left out with a warning.

    Example:
        tracksrc location=tracks.jsonl ! identity sync=true ! zenohsink key=uav/1
    """

    src = str(TRACKS_CAPS)
    location: str = Property("", doc="The file, as tracksink writes it.", file="read")
    run: int = Property(
        0, min=0, doc="The run that is read, of a file to which several were appended; 0: all."
    )

    @override
    def start(self) -> None:
        check_records(self.location)

    @override
    def negotiate(self, allowed: Caps) -> Caps:
        return TRACKS_CAPS

    @override
    def frames(self) -> Iterator[Frame]:
        """One frame for each line; raises `StreamError` where a line is no record."""
        records, runs = RecordFile(self.location), 0
        for run, record, line in records.lines():
            runs = max(runs, run)
            if self.run in (0, run):
                yield Frame(
                    line, TRACKS_CAPS, pts=record.pts_ns, epoch=record.epoch, seq=record.seq,
                    capture=record.capture,
                )  # fmt: skip
        if self.run > runs:
            self.post_warning(f"location={self.location}: no run {self.run}, it has {runs}", "shortfall")
        if records.is_cut_off:
            self.post_warning(f"the last line of {self.location} is only half written and left out")


def check_records(location: str) -> None:
    """Checks that a file of records can be opened; raises `ResourceError`."""
    if not location:
        raise ResourceError("location must be set; write for example location=tracks.jsonl")
    try:
        with Path(location).open("rb"):
            pass
    except OSError as error:
        raise ResourceError(
            f"location={location}: {error.strerror}; name a file that tracksink wrote"
        ) from None

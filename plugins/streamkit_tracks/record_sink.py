"""RecordFileSink: base of sinks that write track records to a file."""

from pathlib import Path

from streamkit import Frame, OutputFileSink, Property, RecordTally, TrackRecord, track_record
from streamkit.output.pipe import STANDARD_OUTPUT


class RecordFileSink(OutputFileSink):
    """Makes the records of frames, and explains at the end why none was of use."""

    sink = "video/x-raw; application/x-tracks"
    source: str | None = Property(
        None,
        doc="Source named in the records; if unset the file's name without its suffix, or the element's.",
    )
    ground_altitude: float | None = Property(
        None, unit="m", doc="Altitude of the ground with the datum of the poses; by default as reported."
    )

    def start(self) -> None:
        """Checks the file's name, and begins to count."""
        self._tally = RecordTally(needs_positions=self.needs_positions())
        super().start()

    def shortfall(self) -> str:
        """Why no record has a target, or a position where that is needed."""
        return self._tally.shortfall()

    def remark(self) -> str:
        """That no frame had a target, which an empty scene has not."""
        return self._tally.remark()

    def needs_positions(self) -> bool:
        """Whether targets without ground coordinates are of no use in the file."""
        return False

    def record(self, frame: Frame, published_ns: int | None, *, provenance: bool = False) -> TrackRecord:
        """The record of a frame, as the properties say."""
        stem = Path(self.location).stem
        record = track_record(
            frame,
            source=self.source or (self.name if self.location == STANDARD_OUTPUT else stem),
            published_ns=published_ns,
            ground_altitude_m=self.ground_altitude,
            provenance=provenance,
        )
        self._tally.note(frame, record, self.ground_altitude)
        return record

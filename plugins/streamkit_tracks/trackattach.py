"""trackattach: the tracks of a finished run on the frames of its video."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from typing_extensions import override

from streamkit import (
    CONTAINER_ROUNDING_NS,
    Frame,
    Property,
    RecordFile,
    StreamError,
    TrackRecord,
    Transform,
    attach_record,
)
from streamkit_tracks.tracksrc import check_records


class TrackAttach(Transform):
    """Attaches the tracks and registration of a finished run to the frames of its video.

    With it, an overlay is drawn without tracking again. A frame belongs to the record with its time, or,
    where one of them has none, with its epoch and number; one without a record passes as it is. Frames of
    another size than the records name are an error.

    Example:
        filesrc location=flight.mp4 ! decode ! trackattach location=tracks.jsonl ! trackoverlay ! fakesink
    """

    sink = src = "video/x-raw"
    location: str = Property("", doc="The file, as tracksink writes it.", file="read")
    run: int = Property(1, min=1, doc="The run that is read, of a file to which several were appended.")

    @override
    def start(self) -> None:
        check_records(self.location)
        self._run_count = 0
        self._records = self._read_run()
        self._record = next(self._records, None)
        self._has_match = False

    def _read_run(self) -> Iterator[TrackRecord]:
        for run, record in RecordFile(Path(self.location)):
            self._run_count = max(self._run_count, run)
            if run == self.run:
                yield record

    @override
    def transform(self, frame: Frame) -> Frame:
        """Attaches the record of the frame.

        Raises:
            StreamError: the record is of a frame of another size.
        """
        while self._record is not None and _side_of(frame, self._record) < 0:
            self._record = next(self._records, None)
        record = self._record
        if record is None or _side_of(frame, record):
            return frame
        self._record = next(self._records, None)
        recorded = record.width, record.height
        if None not in recorded and recorded != (frame.caps["width"], frame.caps["height"]):
            raise StreamError(
                "location={}: the tracks are of frames of {} x {} px, this one has {} x {}; give their own "
                "video".format(self.location, *recorded, frame.caps["width"], frame.caps["height"])
            )
        if not self._has_match and record.seq != frame.seq:
            self.post_warning(
                f"location={self.location}: the first {frame.describe()} that has a record has number "
                f"{record.seq} in it, by its time: right where the run began at start-s=, wrong where this "
                "is a copy of its video whose times begin elsewhere"
            )
        self._has_match = True
        return attach_record(frame, record)

    @override
    def drain(self) -> Iterable[Frame]:
        """Warns where the run is not in the file, or is not of these frames, or others follow it."""
        for _ in self._records:
            pass
        if self.run > self._run_count:
            text, code = f"no run {self.run}, it has {self._run_count}", "shortfall"
        elif not self._has_match:
            text, code = "no record has the time of a frame; name the file of its run", "shortfall"
        elif self.run < self._run_count:
            text, code = f"it has {self._run_count} runs, this is run {self.run}; see run=", ""
        else:
            return ()
        self.post_warning(f"location={self.location}: {text}", code)
        return ()


def _side_of(frame: Frame, record: TrackRecord) -> int:
    """Below 0 for a record of an earlier frame, 0 for that of this one, above 0 for that of a later one.

    A recording has the times of the live stream, but neither its epochs nor the numbers of all its frames.
    """
    if frame.pts is None or record.pts_ns is None or record.epoch < frame.epoch:
        place, wanted = (record.epoch, record.seq), (frame.epoch, frame.seq)
        return (place > wanted) - (place < wanted)
    later_ns = record.pts_ns - frame.pts
    return 0 if abs(later_ns) <= CONTAINER_ROUNDING_NS else later_ns

"""detectionsink: writes the detections of each frame to a file."""

from io import BufferedWriter
from pathlib import Path

import numpy as np

from streamkit import Detections, Frame, Property, ResourceError, Sink, write_remedy
from streamkit_differencer.sinks.detection_files import (
    FORMATS,
    SUFFIXES,
    DetectionFormat,
    FrameDetections,
    JsonLines,
)


class DetectionSink(Sink):
    """Writes the detections of each frame: JSON lines, COCO, or the det.txt of the MOT Challenge.

    Frames are numbered from 1 in their order, including those without detections.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! detectionsink location=detections.jsonl
    """

    sink = "video/x-raw"
    location: str = Property("", doc="File to write; an existing one is replaced.")
    format: DetectionFormat = Property(
        DetectionFormat.AUTO,
        doc="auto goes by the suffix of location: .txt is mot, .json is coco, else jsonl.",
    )
    first_number: int = Property(1, min=0, doc="Number of the first frame.")

    _file: BufferedWriter | None = None
    _writer: JsonLines | None = None

    def start(self) -> None:
        """Opens the file.

        Raises:
            ResourceError: location is not set, or cannot be written.
        """
        if not self.location:
            raise ResourceError("location must be set; write for example location=detections.jsonl")
        kind = self.format
        if kind is DetectionFormat.AUTO:
            kind = SUFFIXES.get(Path(self.location).suffix.lower(), DetectionFormat.JSONL)
        try:
            self._file = Path(self.location).open("wb")  # noqa: SIM115  closed by `stop`
        except OSError as error:
            raise ResourceError(
                f"location={self.location}: cannot be written: {error.strerror}; name another file"
            ) from error
        self._writer = FORMATS[kind]()
        self._number = self.first_number
        self._write(self._writer.header)

    def render(self, frame: Frame) -> None:
        """Writes the frame's detections."""
        assert self._writer is not None, "start() comes before frames"
        found = frame.get(Detections)
        if found is None:
            found = Detections(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))
        size = frame.caps.integer("width"), frame.caps.integer("height")
        rows = found.boxes, found.centroids, found.areas, found.scores, found.labels
        self._write(self._writer.frame(FrameDetections(self._number, frame.seq, frame.pts, size, *rows)))
        self._number += 1

    def drain(self) -> None:
        """Finishes the file, as `stop` does."""
        self.stop()

    def stop(self) -> None:
        """Finishes and closes the file."""
        file, writer = self._file, self._writer
        if file is None or writer is None:
            return
        try:
            self._write(writer.end())
        finally:
            self._file = self._writer = None
            file.close()

    def _write(self, piece: bytes) -> None:
        assert self._file is not None
        try:
            self._file.write(piece)
        except OSError as error:
            raise ResourceError(
                f"location={self.location}: cannot be written: {error.strerror}{write_remedy(error)}"
            ) from error

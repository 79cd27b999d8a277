"""detectionsink: writes the detections of each frame to a file."""

import numpy as np

from streamkit import Detections, Frame, Property, TextFileSink
from streamkit_differencer.sinks.detection_files import (
    FORMATS,
    KINDS,
    DetectionFormat,
    FrameDetections,
    JsonLines,
)


class DetectionSink(TextFileSink[JsonLines]):
    """Writes the detections of each frame: JSON lines, COCO, or the det.txt of the MOT Challenge.

    Frames are numbered from `first-number` in their order, including those without detections.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! detectionsink location=detections.jsonl
    """

    sink = "video/x-raw"
    format: DetectionFormat = Property(
        DetectionFormat.AUTO,
        doc="auto goes by the suffix of location: .jsonl, .txt (mot) or .json (coco).",
    )
    first_number: int = Property(1, min=0, doc="Number of the first frame.")

    formats = FORMATS
    kinds = KINDS
    suffixes = tuple(KINDS)
    example = "detections.jsonl"

    def begin(self) -> None:
        """Opens the file."""
        self._number = self.first_number
        self._has_found = False
        super().begin()

    def write(self, frame: Frame) -> None:
        """Writes the frame's detections."""
        found = frame.get(Detections)
        self._has_found |= found is not None
        if found is None:
            found = Detections(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))
        size = frame.caps.integer("width"), frame.caps.integer("height")
        rows = found.boxes, found.centroids, found.areas, found.scores, found.labels
        self.append(self.content.frame(FrameDetections(self._number, frame.seq, frame.pts, size, *rows)))
        self._number += 1

    def shortfall(self) -> str:
        """Whether there was no detector."""
        return "" if self._has_found else "no frame carried detections; put framediff before it"

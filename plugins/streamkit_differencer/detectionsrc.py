"""detectionsrc: attaches the detections of a file to frames."""

from __future__ import annotations

import math

from typing_extensions import override

from streamkit import Detections, Frame, Property, ResourceError, StreamError, Transform
from streamkit_differencer.detection_reader import DetectionTable, InvalidDetections, read_detections


class DetectionSrc(Transform):
    """Attaches the detections of a file to the frames with their numbers, in place of a detector.

    Reads the det.txt of the MOT Challenge and the JSON lines of `detectionsink`. Frames without a row get no
    detections, but count as searched. Scores outside 0 to 1 are scaled so that the file's lowest is 0 and its
    highest 1. With it, a tracker is judged apart from the detector, and any detector's results are tracked.

    Example:
        filesrc location=flight.mp4 ! decode ! detectionsrc location=det.txt ! particletrack ! fakesink
    """

    sink = src = "video/x-raw"
    location: str = Property("", doc="File of detections: MOT Challenge text (.txt) or JSON lines.")
    min_score: float = Property(-math.inf, live=True, doc="Lowest score used, in the units of the file.")
    first_number: int = Property(1, min=0, doc="Number of the first frame in the file.")

    @override
    def start(self) -> None:
        if not self.location:
            raise ResourceError("location must be set; write for example location=det.txt")
        try:
            self._table: DetectionTable = read_detections(self.location)
        except OSError as error:
            raise ResourceError(
                f"location={self.location}: cannot be read: {error.strerror}; check the path"
            ) from error
        except InvalidDetections as error:
            raise StreamError(str(error)) from None

    @override
    def transform(self, frame: Frame) -> Frame:
        rows = self._table.of_frame(frame.seq + self.first_number)
        rows = rows[self._table.scores[rows] >= self.min_score]
        boxes = self._table.boxes[rows]
        return frame.attach(
            Detections(
                centroids=(boxes[:, :2] + boxes[:, 2:]) / 2,
                boxes=boxes,
                areas=(boxes[:, 2:] - boxes[:, :2]).prod(axis=1),
                scores=self._table.relative_scores[rows],
                labels=("object",) * len(rows),
                are_objects=True,
            )
        )

"""detectionsink: writes the detections of each frame to a file.

Boxes here are the outer edges of pixels, with (0, 0) the centre of the top-left one. COCO counts from the
corner of the image, MOT from 1.
"""

import enum
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from streamkit import Detections, Frame, Property, TextFileSink
from streamkit.output.text import TextFormat

# From the centre of the first pixel to its outer corner.
CORNER = 0.5
MOT_FIRST = 1.0
NONE = Detections(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))


class DetectionFormat(enum.StrEnum):
    """Format of a file of detections."""

    AUTO = "auto"
    JSONL = "jsonl"
    COCO = "coco"
    MOT = "mot"


class JsonLines(TextFormat):
    """A JSON object per frame, a line each, in the stream's coordinates; base of the other formats."""

    def frame(self, number: int, frame: Frame, found: Detections) -> bytes:
        """The bytes of a frame with this number."""
        rows = []
        for index, box in enumerate(found.boxes):
            row: dict[str, Any] = {
                "box": rounded(box),
                "centroid": rounded(found.centroids[index]),
                "area": round(float(found.areas[index]), 1),
                "score": round(float(found.scores[index]), 4),
            }
            if found.labels:
                row["label"] = found.labels[index]
            rows.append(row)
        line = {"frame": number, "seq": frame.seq, "pts_ns": frame.pts, "detections": rows}
        return compact(line) + b"\n"


class Mot(JsonLines):
    """A line per detection: frame, -1, left, top, width, height, score, -1, -1, -1.

    Source: the det.txt of motchallenge.net, whose first pixel is 1, 1.
    """

    def frame(self, number: int, frame: Frame, found: Detections) -> bytes:
        """The lines of a frame; empty without detections."""
        lines = []
        for (left, top, right, bottom), score in zip(found.boxes, found.scores, strict=True):
            corner = left + CORNER + MOT_FIRST, top + CORNER + MOT_FIRST
            place = ",".join(f"{value:.2f}" for value in (*corner, right - left, bottom - top))
            lines.append(f"{number},-1,{place},{score:.4f},-1,-1,-1\n")
        return "".join(lines).encode()


class Coco(JsonLines):
    """One JSON object with images, annotations and categories in COCO's data format.

    Images are listed at the end; until then one short row per frame is kept.
    """

    has_end = True

    def __init__(self) -> None:
        self._images: list[bytes] = []
        self._categories: dict[str, int] = {}
        self._count = 0

    def begin(self) -> bytes:
        """The start of the annotations."""
        return b'{"annotations":['

    def frame(self, number: int, frame: Frame, found: Detections) -> bytes:
        """The annotations of a frame."""
        width, height = frame.caps.integer("width"), frame.caps.integer("height")
        image = {"id": number, "file_name": f"{number:06d}", "width": width, "height": height}
        self._images.append(compact(image))
        pieces = []
        for index, (left, top, right, bottom) in enumerate(found.boxes):
            label = found.labels[index] if found.labels else "moving"
            self._count += 1
            annotation = {
                "id": self._count,
                "image_id": number,
                "category_id": self._categories.setdefault(label, len(self._categories) + 1),
                "bbox": rounded([left + CORNER, top + CORNER, right - left, bottom - top]),
                "area": round(float(found.areas[index]), 1),
                "score": round(float(found.scores[index]), 4),
                "iscrowd": 0,
            }
            pieces.append((b"\n" if self._count == 1 else b",\n") + compact(annotation))
        return b"".join(pieces)

    def end(self) -> bytes:
        """The images and categories."""
        listed = compact([{"id": number, "name": name} for name, number in self._categories.items()])
        return b'],\n"images":[' + b",".join(self._images) + b'],"categories":' + listed + b"}\n"


FORMATS: Mapping[str, type[JsonLines]] = {
    DetectionFormat.JSONL: JsonLines,
    DetectionFormat.MOT: Mot,
    DetectionFormat.COCO: Coco,
}
KINDS = {".jsonl": DetectionFormat.JSONL, ".txt": DetectionFormat.MOT, ".json": DetectionFormat.COCO}


def rounded(values: Any) -> list[float]:
    """Numbers with two decimals."""
    return [round(float(value), 2) for value in values]


def compact(value: Any) -> bytes:
    """JSON without spaces."""
    return json.dumps(value, separators=(",", ":")).encode()


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
        self.append(self.content.frame(self._number, frame, NONE if found is None else found))
        self._number += 1

    def shortfall(self) -> str:
        """Whether there was no detector."""
        return "" if self._has_found else "no frame carried detections; put framediff before it"

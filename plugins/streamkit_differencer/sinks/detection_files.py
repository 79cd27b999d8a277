"""File formats of detections: JSON lines, COCO results, and the det.txt of the MOT Challenge.

Boxes here are the outer edges of pixels, with (0, 0) the centre of the top-left one. COCO counts from the
corner of the image, MOT from 1.
"""

from __future__ import annotations

import enum
import json
from dataclasses import dataclass
from typing import Any

from streamkit.output.text import TextFormat
from streamkit_differencer.arrays import FloatArray

# From the centre of the first pixel to its outer corner.
CORNER = 0.5
MOT_FIRST = 1.0


class DetectionFormat(enum.StrEnum):
    """Format of a file of detections."""

    AUTO = "auto"
    JSONL = "jsonl"
    COCO = "coco"
    MOT = "mot"


@dataclass(frozen=True, slots=True, eq=False)
class FrameDetections:
    """Detections of a frame.

    Attributes:
        number: of the frame, from 1.
        seq: of the frame in its stream.
        pts_ns: time of the frame, ns, or None.
        size: width and height of the frame, px.
        boxes: float64[n, 4], x0 y0 x1 y1, px.
        centroids: float64[n, 2], px.
        areas: float64[n], px.
        scores: float64[n].
        labels: n words, or empty.
    """

    number: int
    seq: int
    pts_ns: int | None
    size: tuple[int, int]
    boxes: FloatArray
    centroids: FloatArray
    areas: FloatArray
    scores: FloatArray
    labels: tuple[str, ...] = ()


class JsonLines(TextFormat):
    """A JSON object per frame, a line each, in the stream's coordinates; base of the other formats."""

    def frame(self, found: FrameDetections) -> bytes:
        """The bytes of a frame."""
        rows = []
        for index in range(len(found.boxes)):
            row: dict[str, Any] = {
                "box": rounded(found.boxes[index]),
                "centroid": rounded(found.centroids[index]),
                "area": round(float(found.areas[index]), 1),
                "score": round(float(found.scores[index]), 4),
            }
            if found.labels:
                row["label"] = found.labels[index]
            rows.append(row)
        line = {"frame": found.number, "seq": found.seq, "pts_ns": found.pts_ns, "detections": rows}
        return json.dumps(line, separators=(",", ":")).encode() + b"\n"


class Mot(JsonLines):
    """A line per detection: frame, -1, left, top, width, height, score, -1, -1, -1.

    Source: the det.txt of motchallenge.net, whose first pixel is 1, 1.
    """

    def frame(self, found: FrameDetections) -> bytes:
        """The lines of a frame; empty without detections."""
        lines = []
        for box, score in zip(found.boxes.tolist(), found.scores.tolist(), strict=True):
            left, top, width, height = box[0], box[1], box[2] - box[0], box[3] - box[1]
            corner = left + CORNER + MOT_FIRST, top + CORNER + MOT_FIRST
            place = ",".join(f"{value:.2f}" for value in (*corner, width, height))
            lines.append(f"{found.number},-1,{place},{score:.4f},-1,-1,-1\n")
        return "".join(lines).encode()


class Coco(JsonLines):
    """One JSON object with images, annotations and categories in COCO's data format.

    Images are listed at the end; until then one short row per frame is kept.
    """

    has_end = True

    def __init__(self) -> None:
        self._images = bytearray()
        self._categories: dict[str, int] = {}
        self._count = 0

    def begin(self) -> bytes:
        """The start of the annotations."""
        return b'{"annotations":['

    def frame(self, found: FrameDetections) -> bytes:
        """The annotations of a frame."""
        image = {"id": found.number, "file_name": f"{found.number:06d}"}
        image |= {"width": found.size[0], "height": found.size[1]}
        self._images += (b"," if self._images else b"") + json.dumps(image, separators=(",", ":")).encode()
        pieces = []
        for index, (left, top, right, bottom) in enumerate(found.boxes.tolist()):
            label = found.labels[index] if found.labels else "moving"
            category = self._categories.setdefault(label, len(self._categories) + 1)
            self._count += 1
            annotation = {
                "id": self._count,
                "image_id": found.number,
                "category_id": category,
                "bbox": rounded([left + CORNER, top + CORNER, right - left, bottom - top]),
                "area": round(float(found.areas[index]), 1),
                "score": round(float(found.scores[index]), 4),
                "iscrowd": 0,
            }
            comma = "" if self._count == 1 else ","
            pieces.append(comma + "\n" + json.dumps(annotation, separators=(",", ":")))
        return "".join(pieces).encode()

    def end(self) -> bytes:
        """The images and categories."""
        categories = [{"id": number, "name": name} for name, number in self._categories.items()]
        listed = json.dumps(categories, separators=(",", ":")).encode()
        return b'],\n"images":[' + self._images + b'],"categories":' + listed + b"}\n"


FORMATS: dict[str, type[JsonLines]] = {
    DetectionFormat.JSONL: JsonLines,
    DetectionFormat.MOT: Mot,
    DetectionFormat.COCO: Coco,
}
KINDS = {".jsonl": DetectionFormat.JSONL, ".txt": DetectionFormat.MOT, ".json": DetectionFormat.COCO}


def rounded(values: Any) -> list[float]:
    """Numbers with two decimals."""
    return [round(float(value), 2) for value in values]

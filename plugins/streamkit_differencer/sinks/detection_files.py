"""Detections in files: JSON lines, COCO's results, and the det.txt of the MOT Challenge.

Boxes here run over the outer edges of pixels, with (0, 0) the centre of the top-left one. COCO counts from
the corner of the picture, MOT from 1.
"""

from __future__ import annotations

import enum
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

# From the centre of the first pixel to its outer corner.
CORNER = 0.5
MOT_FIRST = 1.0


class DetectionFormat(enum.StrEnum):
    """What a file of detections looks like."""

    AUTO = "auto"
    JSONL = "jsonl"
    COCO = "coco"
    MOT = "mot"


@dataclass(frozen=True, slots=True, eq=False)
class FrameDetections:
    """What was found in a frame.

    Attributes:
        number: of the frame, from 1.
        seq: of the frame in its stream.
        pts_ns: time of the frame, ns, or None.
        size: width and height of the frame, px.
        boxes: float64[n, 4], x0 y0 x1 y1, px.
        centroids: float64[n, 2], px.
        areas: float64[n], px.
        scores: float64[n].
        labels: n words, or none at all.
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


class DetectionFile(Protocol):
    """Writes one kind of file, piece by piece."""

    def begin(self) -> bytes:
        """What the file opens with."""

    def frame(self, found: FrameDetections) -> bytes:
        """What a frame adds."""

    def end(self) -> bytes:
        """What the file closes with."""


class JsonLines:
    """A JSON object per frame, a line each, in the stream's own coordinates."""

    def begin(self) -> bytes:
        """Nothing."""
        return b""

    def frame(self, found: FrameDetections) -> bytes:
        """One line."""
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

    def end(self) -> bytes:
        """Nothing."""
        return b""


class Mot:
    """A line per detection: frame, -1, left, top, width, height, score, -1, -1, -1.

    Source: the det.txt of motchallenge.net, whose first pixel is 1, 1.
    """

    def begin(self) -> bytes:
        """Nothing."""
        return b""

    def frame(self, found: FrameDetections) -> bytes:
        """The frame's lines; none for a frame without detections."""
        lines = []
        for box, score in zip(found.boxes.tolist(), found.scores.tolist(), strict=True):
            left, top, width, height = box[0], box[1], box[2] - box[0], box[3] - box[1]
            place = f"{left + CORNER + MOT_FIRST:.2f},{top + CORNER + MOT_FIRST:.2f},{width:.2f},{height:.2f}"
            lines.append(f"{found.number},-1,{place},{score:.4f},-1,-1,-1\n")
        return "".join(lines).encode()

    def end(self) -> bytes:
        """Nothing."""
        return b""


class Coco:
    """One JSON object with images, annotations and categories, as COCO's data format has them.

    Images are listed at the end, so what is kept meanwhile is one short row per frame.
    """

    def __init__(self) -> None:
        self._images: list[tuple[int, int, int]] = []
        self._categories: dict[str, int] = {}
        self._count = 0

    def begin(self) -> bytes:
        """The annotations' opening."""
        return b'{"annotations":['

    def frame(self, found: FrameDetections) -> bytes:
        """The frame's annotations."""
        self._images.append((found.number, *found.size))
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
        images = [
            {"id": number, "file_name": f"{number:06d}", "width": width, "height": height}
            for number, width, height in self._images
        ]
        categories = [{"id": number, "name": name} for name, number in self._categories.items()]
        rest = json.dumps({"images": images, "categories": categories}, separators=(",", ":"))
        return b"],\n" + rest[1:].encode() + b"\n"


FILES: dict[DetectionFormat, type[JsonLines] | type[Mot] | type[Coco]] = {
    DetectionFormat.JSONL: JsonLines,
    DetectionFormat.MOT: Mot,
    DetectionFormat.COCO: Coco,
}
SUFFIXES = {".txt": DetectionFormat.MOT, ".json": DetectionFormat.COCO}


def rounded(values: Any) -> list[float]:
    """Numbers with two places."""
    return [round(float(value), 2) for value in values]

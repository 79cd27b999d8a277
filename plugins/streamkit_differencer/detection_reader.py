"""Reads detections from files: the det.txt of the MOT Challenge, or the JSON lines of `detectionsink`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from streamkit_differencer.arrays import FloatArray

MOT_COLUMNS = 7  # frame, id, left, top, width, height, score
MOT_CORNER = 1.5  # from the centre of the first pixel to the corner of MOT's pixel 1
LARGEST = 1e7

Row = tuple[int, float, float, float, float, float]  # frame, x0, y0, x1, y1, score


class InvalidDetections(ValueError):
    """A line of the file is not a detection."""


@dataclass(frozen=True, eq=False)
class DetectionTable:
    """All detections of a file, in the order of their frames.

    Attributes:
        frames: int64[n], number of the frame.
        boxes: float64[n, 4], x0 y0 x1 y1, px; (0, 0) is the centre of the first pixel.
        scores: float64[n], in the units of the file.
        relative_scores: float64[n], 0 to 1.
    """

    frames: NDArray[np.int64]
    boxes: FloatArray
    scores: FloatArray
    relative_scores: FloatArray

    def of_frame(self, number: int) -> NDArray[np.int64]:
        """The rows of a frame."""
        first, last = np.searchsorted(self.frames, [number, number + 1])
        return np.arange(first, last)


def read_detections(path: str) -> DetectionTable:
    """Reads a file; a name that ends in .txt is MOT text, any other JSON lines.

    Raises:
        OSError: it cannot be read.
        InvalidDetections: a line is no detection; the error names it.
    """
    read = _mot_rows if Path(path).suffix.lower() == ".txt" else _json_rows
    rows: list[Row] = []
    with Path(path).open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            if not line.strip():
                continue
            try:
                rows += read(line)
            except (ValueError, KeyError, TypeError, IndexError):
                raise InvalidDetections(
                    f"{path}:{number}: a detection has a frame, a box with a positive size and a score, "
                    f"got {line.strip()[:60]!r}"
                ) from None
    table = np.array(rows, np.float64).reshape(-1, 6)
    table = table[np.argsort(table[:, 0], kind="stable")]
    scores = table[:, 5]
    low, high = min(0.0, scores.min(initial=0.0)), max(1.0, scores.max(initial=1.0))
    is_relative = low >= 0 and high <= 1
    low, high = (0.0, 1.0) if is_relative else (float(scores.min()), float(scores.max()))
    relative = (scores - low) / (high - low) if high > low else np.ones(len(scores))
    return DetectionTable(table[:, 0].astype(np.int64), table[:, 1:5].copy(), scores.copy(), relative)


def _mot_rows(line: str) -> Iterator[Row]:
    numbers = [float(word) for word in line.replace(",", " ").split()]
    if len(numbers) < MOT_COLUMNS:
        raise ValueError("too few numbers")
    frame, _, left, top, width, height, score = numbers[:MOT_COLUMNS]
    left, top = left - MOT_CORNER, top - MOT_CORNER
    yield _row(frame, [left, top, left + width, top + height], score)


def _json_rows(line: str) -> Iterator[Row]:
    record = json.loads(line)
    for found in record["detections"]:
        yield _row(record["frame"], found["box"], found["score"])


def _row(frame: float, box: list[float], score: float) -> Row:
    left, top, right, bottom = (float(value) for value in box)
    is_sound = np.isfinite([frame, left, top, right, bottom, score]).all() and abs(frame) <= LARGEST
    if not is_sound or right <= left or bottom <= top:
        raise ValueError("not a box")
    return int(frame), left, top, right, bottom, float(score)

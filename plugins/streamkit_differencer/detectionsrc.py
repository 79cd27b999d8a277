"""detectionsrc: attaches the detections of a file to frames.

Files are the det.txt of the MOT Challenge, or the JSON lines of `detectionsink`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import (
    CONTAINER_ROUNDING_NS,
    Detections,
    Frame,
    Property,
    ResourceError,
    StreamError,
    Transform,
)
from streamkit_differencer.arrays import FloatArray, overlaps

MOT_CORNER = 1.5  # from the centre of the first pixel to the corner of MOT's pixel 1
MAX_FRAME = 1e7
MAX_OUTSIDE = 0.1  # of the boxes; those of tracked objects that leave may lie beyond the frame
NOT_IN_TEXT = frozenset("\0\N{REPLACEMENT CHARACTER}")

Row = tuple[float, float, float, float, float, float]  # frame, x0, y0, x1, y1, score


class DetectionSrc(Transform):
    """Attaches the detections of a file to the frames with their numbers, in place of a detector.

    Reads the det.txt of the MOT Challenge and the JSON lines of `detectionsink`. Frames without a row get no
    detections, but count as searched. Scores outside 0 to 1 are scaled so that the file's lowest is 0 and its
    highest 1. With it, a tracker is judged apart from the detector, and any detector's results are tracked.

    A warning at the end says that the file does not fit the video: no number matched, rows are numbered from
    0 or have the times of other frames, no score reached min-score, or boxes lie outside the frame.

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
            self._table = read_detections(self.location)
        except OSError as error:
            raise ResourceError(
                f"location={self.location}: cannot be read: {error.strerror}; check the path"
            ) from error
        except ValueError as error:
            raise StreamError(str(error)) from None
        self._fit = FileFit(self._table)

    @override
    def transform(self, frame: Frame) -> Frame:
        number = frame.seq + self.first_number
        matched = self._table.of_frame(number)
        rows = matched[self._table.scores[matched] >= self.min_score]
        boxes = self._table.boxes[rows]
        size = frame.caps.integer("width"), frame.caps.integer("height")
        self._fit.note(number, frame.pts, len(matched), boxes, size)
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

    @override
    def drain(self) -> Iterable[Frame]:
        if text := self._fit.shortfall(self.min_score):
            self.post_warning(f"location={self.location}: {text}", "shortfall")
        return ()


@dataclass(frozen=True, eq=False)
class DetectionTable:
    """All detections of a file, in the order of their frames.

    Attributes:
        frames: float64[n], number of the frame.
        boxes: float64[n, 4], x0 y0 x1 y1, px; (0, 0) is the centre of the first pixel.
        scores: float64[n], in the units of the file.
        relative_scores: float64[n], 0 to 1.
        lines: those of the file that are not blank.
        times: of the frames, ns, by their numbers, where the file has them.
    """

    frames: FloatArray
    boxes: FloatArray
    scores: FloatArray
    relative_scores: FloatArray
    lines: int
    times: dict[int, int]

    def of_frame(self, number: int) -> NDArray[np.int64]:
        """The rows of a frame."""
        return np.arange(*np.searchsorted(self.frames, [number, number + 1]))


def read_detections(path: str) -> DetectionTable:
    """Reads a file; a name that ends in .txt is MOT text, any other JSON lines.

    Raises:
        OSError: it cannot be read.
        ValueError: a line is no detection; the error names it.
    """
    count, times = 0, dict[int, int]()
    read = _mot_rows if Path(path).suffix.lower() == ".txt" else partial(_json_rows, times)
    rows: list[Row] = []
    with Path(path).open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            if not line.strip():
                continue
            count += 1
            try:
                rows += read(line)
            except (ValueError, KeyError, TypeError, IndexError):
                is_text = NOT_IN_TEXT.isdisjoint(line)
                found = repr(line.strip()[:60]) if is_text else "bytes that are no text; check the path"
                raise ValueError(
                    f"{path}:{number}: a detection has a frame, a box with a positive size and a score, "
                    f"got {found}"
                ) from None
    table = np.array(rows, np.float64).reshape(-1, 6)
    table = table[np.argsort(table[:, 0], kind="stable")]
    scores = relative = table[:, 5]
    if len(scores) and (scores.min() < 0.0 or scores.max() > 1.0):
        span = np.ptp(scores)
        relative = (scores - scores.min()) / span if span else np.ones(len(scores))
    return DetectionTable(table[:, 0], table[:, 1:5], scores, relative, count, times)


class FileFit:
    """Counts what the frames of a run took from a file, to say where the file belongs to another video.

    Args:
        table: the detections of the file.
    """

    def __init__(self, table: DetectionTable) -> None:
        self._table = table
        self._numbers: tuple[int, int] | None = None  # of the first and the last frame
        self._first_ns: int | None = None  # time of the first
        self._matched = self._used = self._outside = 0

    def note(
        self, number: int, pts: int | None, matched: int, boxes: FloatArray, size: tuple[int, int]
    ) -> None:
        """Notes a frame.

        Args:
            number: of the frame in the file.
            pts: of the frame, ns; None if unknown.
            matched: rows of the file with this number.
            boxes: float64[n, 4], those that are used.
            size: width and height of the frame, px.
        """
        self._first_ns = pts if self._numbers is None else self._first_ns
        self._numbers = (number if self._numbers is None else self._numbers[0]), number
        self._matched += matched
        if len(boxes):
            whole = np.array([[0.0, 0.0, *size]]) - 0.5
            self._used += len(boxes)
            self._outside += len(boxes) - int(overlaps(boxes, whole).sum())

    def shortfall(self, min_score: float) -> str:
        """How the file does not fit the frames, or ""."""
        table = self._table
        if self._numbers is None or (table.lines and not len(table.frames)):
            return ""  # no frame came, or a detector found nothing in any
        if not table.lines:
            return "the file is empty"
        if not self._matched:
            rows = f"{table.frames[0]:.0f}..{table.frames[-1]:.0f}"
            frames = "{}..{}".format(*self._numbers)
            return f"no row matched a frame: rows are numbered {rows}, frames {frames}; check first-number"
        if self._numbers[0] == 1 and table.frames[0] == 0:
            return "the rows are numbered from 0, the frames from 1; set first-number=0"
        if text := self._wrong_time(self._numbers[0]):
            return text
        if not self._used:
            scores = f"{table.scores.min():g} to {table.scores.max():g}"
            return f"no row has a score of min-score={min_score:g}: the scores are {scores}"
        if self._outside > MAX_OUTSIDE * self._used:
            outside = f"{self._outside} of {self._used} boxes lie outside the frame"
            return f"{outside}: are they of another video or scale?"
        return ""

    def _wrong_time(self, number: int) -> str:
        """That another frame of the file has the time of the first, as with start-s of filesrc, or ""."""
        first_ns, row_ns = self._first_ns, self._table.times.get(number)
        if first_ns is None or row_ns is None or abs(row_ns - first_ns) <= CONTAINER_ROUNDING_NS:
            return ""
        others = [at for at, ns in self._table.times.items() if abs(ns - first_ns) <= CONTAINER_ROUNDING_NS]
        if not others:
            return ""  # the file may be of the same frames in another container
        return (
            f"frame {number} of the file is of {row_ns / 1e9:.3f} s, the first frame of "
            f"{first_ns / 1e9:.3f} s, which is that of frame {others[0]}; check first-number"
        )


def _mot_rows(line: str) -> Iterator[Row]:
    # The world coordinates behind the score are not used.
    frame, _, left, top, width, height, score, *_ = map(float, line.replace(",", " ").split())
    left, top = left - MOT_CORNER, top - MOT_CORNER
    yield _row(frame, [left, top, left + width, top + height], score)


def _json_rows(times: dict[int, int], line: str) -> Iterator[Row]:
    record = json.loads(line)
    for found in record["detections"]:
        yield _row(record["frame"], found["box"], found["score"])
    frame, pts = record.get("frame"), record.get("pts_ns")
    if isinstance(frame, int) and isinstance(pts, int):
        times[frame] = pts


def _row(frame: float, box: list[float], score: float) -> Row:
    left, top, right, bottom = (float(value) for value in box)
    is_sound = np.isfinite([frame, left, top, right, bottom, score]).all() and abs(frame) <= MAX_FRAME
    if not is_sound or right <= left or bottom <= top:
        raise ValueError("not a box")
    return int(frame), left, top, right, bottom, float(score)

"""Reads tracks and ground truth from files."""

from __future__ import annotations

import csv
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from streamkit.geometry.homography import FloatArray
from streamkit.geometry.track import SHOWN_STATES
from streamkit_tracks.evaluation.scores import Labelled

ONE_TARGET_COLUMNS, MOT_COLUMNS = 4, 6
MOT_USED = 6  # column that says whether a ground truth box counts
MOT_CLASS, MOT_CLASS_COLUMNS = 7, 9  # of the layout from MOT16 on
CORNER = 0.5  # a box begins half a pixel before the centre of its first pixel

Row = tuple[int, int, list[float]]  # number of the frame, id, and left, top, width, height

RUN_STARTS = ("{", "source,")  # of track records and of their CSV


def read_tracks(path: Path) -> list[Labelled]:
    """Tracks for each frame from 1, as `tracksink` writes them: MOT text (.txt) or CSV.

    Raises:
        ValueError: a line is none of them, or a frame has the same id twice.
    """
    if path.suffix == ".csv":
        return tracks_by_frame(path, list(_csv_rows(path)))
    return tracks_by_frame(path, [row for row, numbers in _mot_rows(path, 1.0) if _is_counted(numbers)])


def tracks_by_frame(path: Path, rows: list[Row]) -> list[Labelled]:
    """Tracks for each frame from 1, of the rows of a file.

    Raises:
        ValueError: a frame has the same id twice.
    """
    for (frame, target), count in Counter(row[:2] for row in sorted(rows)).items():
        if count > 1:
            raise ValueError(
                f"{path}: frame {frame} has id {target} {count} times; "
                "give the tracks of one run, not detections, which particletrack follows behind detectionsrc"
            )
    return _by_frame(rows)


def read_truth(path: Path, first_pixel: float = 1.0) -> tuple[list[Labelled], list[Labelled]]:
    """Ground truth in the layout of MOT Challenge; rows whose seventh number is 0 do not count.

    Args:
        path: the file.
        first_pixel: number of the frame's first pixel; MOT Challenge counts from 1.

    Returns:
        Boxes for each frame from 1 in pixels of the frame as tracks have them, (0, 0) being the centre of the
        first one; and, where the layout has classes (MOT16 and later), every box with its class as its id.

    Raises:
        ValueError: a line has not at least six numbers.
    """
    rows = list(_mot_rows(path, first_pixel))
    classes = [
        (frame, int(numbers[MOT_CLASS]), box)
        for (frame, _, box), numbers in rows
        if len(numbers) == MOT_CLASS_COLUMNS
    ]
    return _by_frame([row for row, numbers in rows if _is_counted(numbers)]), _by_frame(classes)


def read_boxes(path: Path, first_pixel: float = 1.0) -> FloatArray:
    """Ground truth of one target: float64[n, 4], a line `left,top,width,height` for each frame.

    Boxes are in pixels of the frame as tracks have them, (0, 0) being the centre of the first one, which has
    the number `first_pixel` in the file; OTB and UAV123 count from 1.

    Raises:
        ValueError: a line has not four numbers.
    """
    rows = [numbers[:4] for _, numbers in _numbers(path, ONE_TARGET_COLUMNS)]
    shift = first_pixel + CORNER
    return np.array(rows).reshape(-1, 4) - [shift, shift, 0.0, 0.0]


def is_one_target(path: Path) -> bool:
    """Whether a ground truth file has four columns, as for one target, and not six or more.

    Raises:
        ValueError: the file has no line of numbers.
    """
    for _, numbers in _numbers(path, ONE_TARGET_COLUMNS):
        return len(numbers) < MOT_COLUMNS
    raise ValueError(f"{path}: no line of numbers in it")


def evidence_of_swap(tracks: Path, truth: Path) -> str:
    """What in their columns shows that tracks and ground truth are swapped; "" if nothing does.

    Raises:
        ValueError: a line has not the numbers of its layout.
    """
    if tracks.suffix == ".txt" and any(
        len(numbers) == MOT_CLASS_COLUMNS for _, numbers in _numbers(tracks, MOT_COLUMNS)
    ):
        return f"{tracks} has nine columns, the layout of ground truth from MOT16 on"
    for place, numbers in _numbers(truth, ONE_TARGET_COLUMNS):
        if len(numbers) > MOT_USED and not numbers[MOT_USED].is_integer():
            return f"{place} has the score {numbers[MOT_USED]:g} in column 7, which is 0 or 1 in ground truth"
    return ""


def longest_lived(tracks: list[Labelled], frames: int) -> FloatArray:
    """Boxes float64[frames, 4] of the id that is there most often; NaN where it is not."""
    boxes = np.full((frames, 4), np.nan)
    counts = Counter(number for tracked in tracks for number in sorted(tracked.ids.tolist()))
    chosen = min(counts, key=lambda number: (-counts[number], number), default=None)
    for index, tracked in enumerate(tracks[:frames]):
        for box in tracked.boxes[tracked.ids == chosen]:
            boxes[index] = box
    return boxes


def frames_of(labelled: list[Labelled], first: int, last: int) -> list[Labelled]:
    """The frames `first` to `last`, counted from 1; empty ones where the list is too short."""
    empty = Labelled(np.zeros(0, np.int64), np.zeros((0, 4)))
    kept = labelled[first - 1 : last]
    return kept + [empty] * (last - first + 1 - len(kept))


def frames_with_boxes(labelled: list[Labelled]) -> tuple[int, int]:
    """The first and the last frame, counted from 1, that have a box; (1, 0) where none has."""
    numbers = [number for number, frame in enumerate(labelled, 1) if len(frame.ids)]
    return (numbers[0], numbers[-1]) if numbers else (1, 0)


def _by_frame(rows: list[Row]) -> list[Labelled]:
    frames: dict[int, list[Row]] = defaultdict(list)
    for row in rows:
        frames[row[0]].append(row)
    labelled = []
    for number in range(1, max(frames, default=0) + 1):
        ids = np.array([target for _, target, _ in frames.get(number, [])], np.int64)
        boxes = np.array([box for _, _, box in frames.get(number, [])], np.float64)
        labelled.append(Labelled(ids, boxes.reshape(-1, 4)))
    return labelled


def _mot_rows(path: Path, first_pixel: float) -> Iterator[tuple[Row, list[float]]]:
    """Rows in the layout of MOT Challenge, with all their numbers."""
    shift = first_pixel + CORNER
    for place, numbers in _numbers(path, MOT_COLUMNS):
        if numbers[0] < 1 or numbers[0] > 1e7 or not np.isfinite(numbers[:MOT_COLUMNS]).all():
            raise ValueError(f"{place}: frames count from 1, got frame {numbers[0]:g}")
        left, top, width, height = numbers[2:6]
        yield (int(numbers[0]), int(numbers[1]), [left - shift, top - shift, width, height]), numbers


def _is_counted(numbers: list[float]) -> bool:
    """Whether a row of MOT Challenge counts: its seventh number, where it has one, is not 0."""
    return len(numbers) <= MOT_USED or numbers[MOT_USED] != 0


def _csv_rows(path: Path) -> Iterator[Row]:
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as lines:
        for number, row in enumerate(csv.DictReader(lines), 2):
            try:
                box = sides([float(row[name]) for name in ("x0", "y0", "x1", "y1")])
                if row["state"] in SHOWN_STATES:
                    yield int(row["seq"]) + 1, int(row["id"]), box
            except (ValueError, KeyError, TypeError) as error:
                raise ValueError(f"{path}:{number}: not a row of tracks as tracksink writes it") from error


def sides(corners: Sequence[float]) -> list[float]:
    """Left, top, width and height of a box given by left, top, right and bottom."""
    left, top, right, bottom = corners
    return [left, top, right - left, bottom - top]


def _numbers(path: Path, least: int) -> Iterator[tuple[str, list[float]]]:
    """The place of a line and its numbers, separated by commas, tabs or spaces."""
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            words = line.replace(",", " ").split()
            if not words:
                continue
            place = f"{path}:{number}"
            try:
                numbers = [float(word) for word in words]
            except ValueError:
                numbers = []
            if len(numbers) < least:
                is_run = line.startswith(RUN_STARTS)
                remedy = f"to compare with a run, streamkit convert {path} truth.txt; " if is_run else ""
                raise ValueError(
                    f"{place}: needs {least} numbers or more, got {line.strip()[:60]!r}; {remedy}"
                    "tracks come first, ground truth second"
                )
            yield place, numbers

"""Reads tracks and ground truth from files."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from streamkit_tracker.evaluation.boxes import Labelled
from streamkit_tracker.window_geometry import FloatArray

SHOWN = ("confirmed", "coasting")
ONE_TARGET_COLUMNS = 4
MOT_COLUMNS = 6
MOT_USED = 6  # column that says whether a ground truth box counts
MOT_CLASS, MOT_CLASS_COLUMNS = 7, 9  # of the layout from MOT16 on
CORNER = 0.5  # a box begins half a pixel before the centre of its first pixel

Rows = dict[int, list[tuple[int, list[float]]]]  # id and box, by the number of the frame


def read_tracked_boxes(path: Path) -> list[Labelled]:
    """Tracks for each frame from 1, as `tracksink` writes them: MOT Challenge text (.txt) or CSV.

    Raises:
        ValueError: a line is none of them, or a frame has the same id twice.
    """
    return tracked_by_frame(path, _mot_rows(path, 1.0) if path.suffix == ".txt" else _csv_rows(path))


def tracked_by_frame(path: Path, rows: Rows) -> list[Labelled]:
    """Tracks for each frame from 1, of the rows of a file.

    Raises:
        ValueError: a frame has the same id twice.
    """
    found = _by_frame(rows)
    for number, frame in enumerate(found, 1):
        ids, counts = np.unique(frame.ids, return_counts=True)
        if (counts > 1).any():
            raise ValueError(
                f"{path}: frame {number} has id {ids[counts.argmax()]} {counts.max()} times; "
                "give the tracks of one run, not detections, which particletrack follows behind detectionsrc"
            )
    return found


def read_identities(path: Path, first_pixel: float = 1.0) -> list[Labelled]:
    """Ground truth in the layout of MOT Challenge; rows whose seventh number is 0 do not count.

    Args:
        path: the file.
        first_pixel: number of the frame's first pixel; MOT Challenge counts from 1.

    Returns:
        Boxes in pixels of the frame as tracks have them, (0, 0) being the centre of the first one.

    Raises:
        ValueError: a line has not at least six numbers.
    """
    return _by_frame(_mot_rows(path, first_pixel))


def read_classes(path: Path, first_pixel: float = 1.0) -> list[Labelled]:
    """Every box of a ground truth that has classes (MOT16 and later), its class in place of its id.

    Empty for other layouts.
    """
    rows: Rows = {}
    for place, numbers in _numbers(path, MOT_COLUMNS):
        if len(numbers) == MOT_CLASS_COLUMNS:
            frame, _, box = _mot_row(place, numbers, first_pixel)
            rows.setdefault(frame, []).append((int(numbers[MOT_CLASS]), box))
    return _by_frame(rows)


def read_boxes(path: Path, first_pixel: float = 1.0) -> FloatArray:
    """Ground truth of one target: float64[n, 4], a line `left,top,width,height` for each frame.

    Args:
        path: the file.
        first_pixel: number of the frame's first pixel; OTB and UAV123 count from 1.

    Returns:
        Boxes in pixels of the frame as tracks have them, (0, 0) being the centre of the first one.

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


def longest_lived(tracks: list[Labelled], frames: int) -> FloatArray:
    """Boxes float64[frames, 4] of the id that is there most often; NaN where it is not."""
    boxes = np.full((frames, 4), np.nan)
    ids = np.concatenate([tracked.ids for tracked in tracks]) if tracks else np.zeros(0, np.int64)
    if not len(ids):
        return boxes
    numbers, counts = np.unique(ids, return_counts=True)
    chosen = numbers[np.argmax(counts)]
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


def _by_frame(rows: Rows) -> list[Labelled]:
    frames = []
    for number in range(1, max(rows, default=0) + 1):
        found = rows.get(number, [])
        ids = np.array([target for target, _ in found], np.int64)
        frames.append(Labelled(ids, np.array([box for _, box in found], np.float64).reshape(-1, 4)))
    return frames


def _mot_rows(path: Path, first_pixel: float) -> Rows:
    rows: Rows = {}
    for place, numbers in _numbers(path, MOT_COLUMNS):
        frame, target, box = _mot_row(place, numbers, first_pixel)
        if len(numbers) <= MOT_USED or numbers[MOT_USED] != 0:
            rows.setdefault(frame, []).append((target, box))
    return rows


def _mot_row(place: str, numbers: list[float], first_pixel: float) -> tuple[int, int, list[float]]:
    """Frame, id and box of a row."""
    if numbers[0] < 1 or numbers[0] > 1e7 or not np.isfinite(numbers[:MOT_COLUMNS]).all():
        raise ValueError(f"{place}: frames count from 1, got frame {numbers[0]:g}")
    left, top, width, height = numbers[2:6]
    shift = first_pixel + CORNER
    return int(numbers[0]), int(numbers[1]), [left - shift, top - shift, width, height]


def _csv_rows(path: Path) -> Rows:
    rows: Rows = {}
    with path.open(encoding="utf-8", errors="replace", newline="") as lines:
        for number, row in enumerate(csv.DictReader(lines), 2):
            try:
                box = sides([float(row[name]) for name in ("x0", "y0", "x1", "y1")])
                if row["state"] in SHOWN:
                    rows.setdefault(int(row["seq"]) + 1, []).append((int(row["id"]), box))
            except (ValueError, KeyError, TypeError) as error:
                raise ValueError(f"{path}:{number}: not a row of tracks as tracksink writes it") from error
    return rows


def sides(corners: Sequence[float]) -> list[float]:
    """Left, top, width and height of a box given by left, top, right and bottom."""
    left, top, right, bottom = corners
    return [left, top, right - left, bottom - top]


def _numbers(path: Path, least: int) -> Iterable[tuple[str, list[float]]]:
    """Where a line is and its numbers, parted by commas, tabs or spaces."""
    with path.open(encoding="utf-8", errors="replace") as lines:
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
                raise ValueError(f"{place}: needs {least} numbers or more, got {line.strip()[:60]!r}")
            yield place, numbers

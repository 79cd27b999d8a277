"""Reads track records back from CSV and MOT Challenge text, as far as these hold them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping
from itertools import groupby
from pathlib import Path

import msgspec

from streamkit import TRACKS_SCHEMA, StreamError, TrackRecord, decode_record, encode_record
from streamkit_tracks.file_formats import CSV_COLUMNS, MOT_CORNER

MOT_COLUMNS = 7
ENCODING = "utf-8-sig"  # spreadsheets begin a file with a byte order mark
MISSING = {
    ".csv": "CSV has no registration, covariance, provenance, frame size, origin of the time of capture or "
    "frame without targets",
    ".txt": "MOT text has only boxes and scores: every target counts as confirmed, with angle and age 0; "
    "there are no times, velocities and positions",
}


def read_csv(path: Path) -> Iterator[TrackRecord]:
    """Records of the frames with targets in a file that tracksink wrote as CSV.

    Raises:
        OSError: it cannot be read.
        StreamError: a row is not as tracksink writes it.
    """
    with path.open(encoding=ENCODING, errors="replace", newline="") as file:
        rows = csv.DictReader(file)
        try:
            if missing := sorted(set(CSV_COLUMNS) - {"error_m"} - set(rows.fieldnames or ())):
                rule = "the first line must name the columns, with commas between"
                raise ValueError(f"no column {', '.join(missing)}; {rule}")
            for _, group in groupby(rows, lambda row: (row["source"], row["epoch"], row["seq"])):
                targets = [{name: text for name, text in row.items() if text} for row in group]
                # The width in a row is the target's, not the frame's.
                frame = {name: text for name, text in targets[0].items() if name != "width"}
                yield _record(frame, [_csv_target(row) for row in targets])
        except (ValueError, KeyError, TypeError, csv.Error, StreamError) as error:
            raise StreamError(
                f"{path}, near line {rows.line_num}: not a row of tracks as tracksink writes CSV: {error}"
            ) from None


def read_mot(path: Path) -> Iterator[TrackRecord]:
    """Records of the frames in MOT Challenge text, by number; see `MISSING`.

    Raises:
        OSError: it cannot be read.
        StreamError: a line has not frame, id, left, top, width, height and score.
    """
    rows: list[tuple[int, dict[str, object]]] = []
    with path.open(encoding=ENCODING, errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            if not line.strip():
                continue
            try:
                frame, target, left, top, width, height, score = map(float, line.split(",")[:MOT_COLUMNS])
                rows.append((int(frame), _mot_target(int(target), (left, top, width, height), score)))
            except (ValueError, OverflowError):
                raise StreamError(
                    f"{path}:{number}: MOT text has frame,id,left,top,width,height,score, "
                    f"got {line.strip()[:60]!r}"
                ) from None
    rows.sort(key=lambda row: row[0])
    for frame_number, group in groupby(rows, lambda row: row[0]):
        try:
            fields = {"source": path.stem, "seq": frame_number - 1, "epoch": 0}
            yield _record(fields, [target for _, target in group])
        except (ValueError, StreamError) as error:
            raise StreamError(f"{path}: frame {frame_number}: {error}; frames count from 1") from None


READERS: dict[str, Callable[[Path], Iterator[TrackRecord]]] = {".csv": read_csv, ".txt": read_mot}


def write_lines(path: Path, output: Path) -> None:
    """Writes the records of a file with a suffix of `READERS` as JSON lines; raises as its reader does."""
    with output.open("wb") as file:
        file.writelines(encode_record(record) + b"\n" for record in READERS[path.suffix.lower()](path))


def _record(frame: Mapping[str, object], targets: list[dict[str, object]]) -> TrackRecord:
    fields = {**frame, "schema": TRACKS_SCHEMA, "tracks": targets, "dropped": 0}
    # Numbers are text in CSV; those that are not finite become null in JSON, which is refused.
    return decode_record(encode_record(msgspec.convert(fields, TrackRecord, strict=False)))


def _csv_target(row: dict[str, str]) -> dict[str, object]:
    position = {name: row[name] for name in ("lat", "lon", "error_m") if name in row}
    geo = {"geo": position} if "lat" in row else {}
    return {**row, **geo, "bbox": [row[name] for name in ("x0", "y0", "x1", "y1")]}


def _mot_target(number: int, box: tuple[float, float, float, float], score: float) -> dict[str, object]:
    left, top, width, height = box
    left, top = left - MOT_CORNER, top - MOT_CORNER
    return {
        "id": number, "state": "confirmed", "x": left + width / 2, "y": top + height / 2,
        "length": width, "width": height, "angle": 0.0,
        "bbox": [left, top, left + width, top + height], "score": score, "age_ns": 0,
    }  # fmt: skip

"""Files of finished runs, for the commands that read them: arguments, formats, and the choice of a run."""

from __future__ import annotations

import contextlib
import csv
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from streamkit import (
    TRACKS_SCHEMA,
    RecordFile,
    ResourceError,
    StreamError,
    TrackRecord,
    decode_record,
    encode_record,
    write_remedy,
)
from streamkit.output.file import write_whole
from streamkit.output.pipe import STANDARD_INPUT
from streamkit_tracks.file_formats import CSV_COLUMNS, MOT_CORNER

MOT_COLUMNS = 7
ENCODING = "utf-8-sig"  # spreadsheets begin a file with a byte order mark
MISSING = {
    ".csv": "CSV has no registration, covariance, provenance, frame size, origin of the time of capture or "
    "frame without targets",
    ".txt": "MOT text has only boxes and scores: every target counts as confirmed, with angle and age 0; "
    "there are no times, velocities and positions",
}
RecordsArgument = Annotated[
    Path, typer.Argument(help="JSON lines from tracksink.", exists=True, dir_okay=False, readable=True)
]
RecordsOrStandardInput = Annotated[
    Path,
    typer.Argument(
        help="JSON lines from tracksink. - is the standard input.",
        exists=True,
        dir_okay=False,
        readable=True,
        allow_dash=True,
    ),
]
RunOption = Annotated[
    int | None, typer.Option(min=1, help="Of a file with several runs; without it, the last.")
]


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


@contextlib.contextmanager
def named_file(file: Path) -> Iterator[Path]:
    """The file itself, or for - a temporary one with what the standard input has."""
    if str(file) != STANDARD_INPUT:
        yield file
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "standard-input.jsonl")
        with path.open("wb") as copy:
            shutil.copyfileobj(sys.stdin.buffer, copy)
        yield path


def choose_run(
    path: Path, wanted: int | None, name: Path | None = None, is_meant: Callable[[TrackRecord], bool] = bool
) -> int:
    """The run of a file that is read; a note tells which of several it is, and of a last line left out.

    Args:
        path: JSON lines from tracksink.
        wanted: number of the run, from 1; None is the last with a record that is meant, else the last.
        name: of the file for people, where it is not its path.
        is_meant: by default any record is.

    Raises:
        OSError: the file cannot be read.
        StreamError: there is no such run or no record at all, or a line is no track record.
    """
    name, records = name or path, RecordFile(path)
    last = last_meant = 0
    for run, record in records:
        last = max(last, run)
        if run > last_meant and is_meant(record):
            last_meant = run
    if not last:
        raise StreamError(f"{name}: no record in it")
    if wanted is not None and wanted > last:
        raise StreamError(f"{name}: no run {wanted}, it has {last}")
    chosen = wanted or last_meant or last
    if wanted is None and last > 1:
        typer.echo(f"note: {name} has {last} runs, this is run {chosen}; see --run", err=True)
    note_cut_off(records, name)
    return chosen


def records_of(path: Path, chosen: int) -> Iterator[TrackRecord]:
    """The records of one run of a file."""
    return (record for run, record in RecordFile(path) if run == chosen)


def note_cut_off(records: RecordFile, name: Path) -> None:
    """Notes on the standard error output that the last line of a file, which was read, is left out."""
    if records.is_cut_off:
        typer.echo(f"note: the last line of {name} is only half written and left out", err=True)


def write_output(path: Path, content: bytes) -> None:
    """Writes a file, in place of an older one when it is whole; raises `ResourceError` where it cannot."""
    try:
        write_whole(path, content)
    except OSError as error:
        raise ResourceError(f"{path}: cannot be written: {error.strerror}{write_remedy(error)}") from error


def reason(error: Exception) -> str:
    """What an error says; of the system's with the file, and without its number."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; check the path"
    return str(error)

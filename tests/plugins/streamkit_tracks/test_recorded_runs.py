"""Records read back from CSV and MOT text."""

from itertools import chain
from pathlib import Path

import msgspec
import pytest

from streamkit import StreamError, decode_record
from streamkit_tracks.file_formats import FORMATS, FileKind, RecordFormat
from streamkit_tracks.recorded_runs import READERS, read_csv, read_mot

TARGET = {
    "id": 7, "state": "coasting", "x": 20.1, "y": 30.0, "length": 8.0, "width": 4.25, "angle": 0.5,
    "bbox": [16.0, 27.5, 24.0, 32.5], "score": 0.875, "age_ns": 5, "vx": 1.5, "vy": -1 / 3,
    "geo": {"lat": 48.1, "lon": 11.5, "error_m": 7.25},
}  # fmt: skip
YOUNG = {**TARGET, "id": 8, "state": "tentative", "geo": None, "vx": None}
FRAME = {
    "schema": "streamkit.tracks/1", "source": "uav, 1", "epoch": 0, "pts_ns": 40, "capture_ns": 3,
    "dropped": 0,
}  # fmt: skip
RECORDS = [
    {**FRAME, "seq": 0, "tracks": [TARGET, YOUNG]},
    {**FRAME, "seq": 2, "pts_ns": None, "tracks": [TARGET]},
]


def written(kind: FileKind, records: object) -> bytes:
    """The bytes of a format."""
    form: RecordFormat = FORMATS[kind]()
    return form.begin() + b"".join(form.record(msgspec.to_builtins(record)) for record in records)


@pytest.mark.parametrize("kind", [FileKind.CSV, FileKind.MOT])
def test_what_is_read_is_written_the_same(tmp_path: Path, kind: FileKind) -> None:
    """Byte for byte; a record of CSV has all that its columns hold."""
    records = [decode_record(msgspec.json.encode(record)) for record in RECORDS]
    file = tmp_path / ("a.csv" if kind == FileKind.CSV else "a.txt")
    file.write_bytes(written(kind, records))
    found = list(READERS[file.suffix](file))
    assert written(kind, found) == file.read_bytes()
    if kind == FileKind.CSV:
        assert found == records


@pytest.mark.parametrize("kind", [FileKind.CSV, FileKind.MOT])
def test_a_byte_order_mark_is_skipped(tmp_path: Path, kind: FileKind) -> None:
    """Spreadsheets and editors of Windows write one."""
    file = tmp_path / ("a.csv" if kind == FileKind.CSV else "a.txt")
    file.write_bytes(written(kind, [decode_record(msgspec.json.encode(record)) for record in RECORDS]))
    found = list(READERS[file.suffix](file))
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert list(READERS[file.suffix](file)) == found


def test_mot_text_is_sorted_by_frame(tmp_path: Path) -> None:
    """Ground truth goes target by target; boxes become those of the frame."""
    file = tmp_path / "gt.txt"
    file.write_text("2,1,1,1,10,20,1,-1,-1,-1\n\n1,2,1,1,10,20,0.5\n2,3,1,1,10,20,1,1,0.2\n")
    first, second = read_mot(file)
    assert (first.source, first.seq, second.seq) == ("gt", 0, 1)
    assert [target.id for target in chain(first.tracks, second.tracks)] == [2, 1, 3]
    assert first.tracks[0].bbox == (-0.5, -0.5, 9.5, 19.5)
    assert (first.tracks[0].x, first.tracks[0].y, first.tracks[0].score) == (4.5, 9.5, 0.5)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.txt", "1,2\n", r"a\.txt:1: MOT text has frame,id,.*got '1,2'"),
        ("a.txt", "0,1,1,1,10,20,1\n", r"frame 0: .* frames count from 1"),
        ("a.txt", "1,1,nan,1,10,20,1\n", r"frame 1: not a track record"),
        ("a.csv", "id,x\n1,2\n", r"a\.csv, near line 1: .*no column age_ns, angle.*with commas between"),
        ("a.csv", None, r"a\.csv, near line 3: .*Invalid enum value 'flying'"),
    ],
)
def test_other_text_is_refused(tmp_path: Path, name: str, text: str | None, words: str) -> None:
    """The error names the place and what is there."""
    file = tmp_path / name
    file.write_bytes(
        written(FileKind.CSV, [decode_record(msgspec.json.encode(RECORDS[0]))]).replace(
            b"coasting", b"flying"
        )
        if text is None
        else text.encode()
    )
    with pytest.raises(StreamError, match=words):
        list((read_csv if name.endswith("csv") else read_mot)(file))


def test_a_table_without_a_later_column_is_read(tmp_path: Path) -> None:
    """A file of before `error_m`."""
    file = tmp_path / "a.csv"
    rows = written(FileKind.CSV, [decode_record(msgspec.json.encode(RECORDS[0]))]).decode().splitlines()
    file.write_text("".join(row.rpartition(",")[0] + "\n" for row in rows))
    (found,) = read_csv(file)
    assert [target.geo is not None for target in found.tracks] == [True, False]

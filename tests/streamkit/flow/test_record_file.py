"""Files of track records: runs, a cut line, and the table of their targets."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from streamkit import (
    RecordFile,
    StreamError,
    TargetRecord,
    TrackRecord,
    TrackState,
    encode_record,
    read_tracks,
)
from streamkit.flow.record import GeoRecord


def record(
    seq: int, *targets: TargetRecord, epoch: int = 0, pts_ns: int | None = None, source: str = "uav"
) -> bytes:
    """A line of a file."""
    made = TrackRecord(
        schema="streamkit.tracks/1", source=source, seq=seq, epoch=epoch, pts_ns=pts_ns, tracks=targets,
        dropped=0,
    )  # fmt: skip
    return encode_record(made) + b"\n"


def target(number: int, geo: GeoRecord | None = None, vx: float | None = None) -> TargetRecord:
    """A confirmed target."""
    return TargetRecord(
        id=number, state=TrackState.CONFIRMED, x=10.0, y=20.0, length=8.0, width=4.0, angle=0.5,
        bbox=(6.0, 18.0, 14.0, 22.0), vx=vx, vy=vx, score=0.75, age_ns=40, geo=geo,
    )  # fmt: skip


def test_a_run_begins_where_numbers_do_not_go_up(tmp_path: Path) -> None:
    """A new epoch is the same run; an older frame number of the same epoch is another."""
    path = tmp_path / "tracks.jsonl"
    lines = record(0), record(5), record(2, epoch=1), record(0), b"\n", record(0)
    path.write_bytes(b"".join(lines))
    assert [(run, one.epoch, one.seq) for run, one in RecordFile(path)] == [
        (1, 0, 0), (1, 0, 5), (1, 1, 2), (2, 0, 0), (3, 0, 0)
    ]  # fmt: skip


def test_each_source_has_runs_of_its_own(tmp_path: Path) -> None:
    """As where zenohsrc receives several publishers, whose records alternate."""
    path = tmp_path / "tracks.jsonl"
    lines = (
        record(7),
        record(2, source="b"),
        record(8),
        record(3, source="b"),
        record(0, source="b"),
        record(9),
    )
    path.write_bytes(b"".join(lines))
    assert [(run, one.source, one.seq) for run, one in RecordFile(path)] == [
        (1, "uav", 7), (2, "b", 2), (1, "uav", 8), (2, "b", 3), (3, "b", 0), (1, "uav", 9)
    ]  # fmt: skip


def test_a_half_written_last_line_is_left_out(tmp_path: Path) -> None:
    """As after a kill; elsewhere it is an error that names the line."""
    path = tmp_path / "tracks.jsonl"
    path.write_bytes(record(0) + record(1)[:-9])
    records = RecordFile(path)
    assert len(list(records)) == 1
    assert records.is_cut_off
    path.write_bytes(record(0)[:-9] + b"\n" + record(1))
    with pytest.raises(StreamError, match=r"tracks\.jsonl:1: not a track record.*a \.jsonl file.*convert"):
        list(RecordFile(str(path)))


def test_the_table_has_a_row_for_each_target_and_frame(tmp_path: Path) -> None:
    """Unknown numbers are NaN; a file without targets has no rows."""
    path = tmp_path / "tracks.jsonl"
    located = target(7, GeoRecord(lat=48.0, lon=11.0), vx=2.0)
    path.write_bytes(record(0) + record(3, target(6), located, pts_ns=120))
    table = read_tracks(path)
    assert table["id"].tolist() == [6, 7]
    assert set(table["seq"].tolist()) == {3}
    assert table["state"].tolist() == ["confirmed", "confirmed"]
    assert np.array_equal(table["lat"], [np.nan, 48.0], equal_nan=True)
    assert np.array_equal(table["vx"], [np.nan, 2.0], equal_nan=True)
    assert np.isnan(table["error_m"]).all()
    assert table["pts_ns"].tolist() == [120, 120]
    assert table["capture_ns"].tolist() == [-(2**63)] * 2
    timed = msgspec.json.decode(record(0, target(6))) | {"capture_ns": 1_763_690_000_123_456_789}
    path.write_bytes(msgspec.json.encode(timed | {"capture_origin": "misb"}))
    assert read_tracks(path)["capture_ns"].tolist() == [1_763_690_000_123_456_789]
    path.write_bytes(record(0))
    assert read_tracks(path).shape == (0,)
    assert read_tracks(path)["pts_ns"].dtype == np.int64

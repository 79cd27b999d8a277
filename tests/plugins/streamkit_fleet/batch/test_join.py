"""Joining the records of parts."""

from pathlib import Path

import pytest

from streamkit import RecordFile, StreamError, TargetRecord, TrackRecord, TrackState, encode_record
from streamkit.flow.record import RegistrationRecord
from streamkit_fleet.batch.join import join_records

FRAME_NS = 40_000_000


def target(identity: int, x: float, age: int) -> TargetRecord:
    """A square of 10 px."""
    return TargetRecord(
        id=identity, state=TrackState.CONFIRMED, x=x, y=5.0, length=10.0, width=10.0, angle=0.0,
        bbox=(x - 5, 0.0, x + 5, 10.0), score=1.0, age_ns=age * FRAME_NS,
    )  # fmt: skip


def write(path: Path, first: int, last: int, ids: dict[int, float], new: tuple[int, int] = (0, 0)) -> Path:
    """A part with frames first ... last - 1; `new` appears at a frame: id, frame."""
    with path.open("wb") as file:
        for n in range(first, last):
            rows = [target(identity, x + n, n - first) for identity, x in ids.items()]
            if new[0] and n >= new[1]:
                rows.append(target(new[0], 300.0, n - new[1]))
            record = TrackRecord(
                schema="streamkit.tracks/1", source="", seq=n - first, epoch=0, pts_ns=n * FRAME_NS,
                dropped=0, tracks=tuple(rows), registration=RegistrationRecord(reference=0, status="ok"),
            )  # fmt: skip
            file.write(encode_record(record) + b"\n")
    return path


def test_a_target_keeps_its_id_and_age_across_seams(tmp_path: Path) -> None:
    """As in one run: each frame once, numbers go on, a new target has a new id, each part its own plane."""
    parts = [
        write(tmp_path / "0", 0, 10, {1: 0.0, 2: 100.0}),
        write(tmp_path / "1", 6, 20, {1: 100.0, 2: 0.0}, new=(3, 12)),
        write(tmp_path / "2", 15, 25, {5: 0.0}),
    ]
    joined = list(join_records(parts))
    assert [record.seq for record in joined] == list(range(25))
    assert [record.pts_ns for record in joined] == [n * FRAME_NS for n in range(25)]
    for n, record in enumerate(joined):
        mine = {row.id: row for row in record.tracks}
        assert mine[1].x == n
        assert mine[1].age_ns == n * FRAME_NS
        expected = {1} | ({2} if n < 20 else set()) | ({3} if 12 <= n < 20 else set())
        assert set(mine) == expected
    assert [joined[n].registration.reference for n in (9, 10, 20)] == [0, 1, 2]


def test_parts_without_a_common_frame_are_refused(tmp_path: Path) -> None:
    """The error names the part and the option."""
    parts = [write(tmp_path / "0", 0, 5, {1: 0.0}), write(tmp_path / "1", 5, 9, {1: 0.0})]
    with pytest.raises(StreamError, match=r"1: has no frame in common .* --overlap-s"):
        list(join_records(parts))


def test_one_part_is_its_own_records(tmp_path: Path) -> None:
    """Nothing changes."""
    path = write(tmp_path / "0", 0, 5, {3: 0.0})
    assert list(join_records([path])) == [record for _, record in RecordFile(path)]

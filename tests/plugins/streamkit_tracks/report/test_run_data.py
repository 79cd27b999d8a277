"""RecordedRun: frames and paths of the records."""

import math

import msgspec

from streamkit import TargetRecord, TrackRecord, TrackState
from streamkit.flow.record import GeoRecord, RegistrationRecord
from streamkit_tracks.report.run_data import RecordedRun

SHIFT = ((1.0, 0.0, 100.0), (0.0, 1.0, 50.0), (0.0, 0.0, 1.0))


def _record(seq: int, *targets: TargetRecord, reference: int | None = 2) -> TrackRecord:
    registration = None
    if reference is not None:
        registration = RegistrationRecord(
            reference=reference, to_reference=SHIFT, status="ok", corner_std=0.3
        )
    return TrackRecord(
        schema="streamkit.tracks/1", source="uav/1", seq=seq, epoch=0, pts_ns=10**9 + seq * 40_000_000,
        width=64, height=48, registration=registration, tracks=targets, dropped=seq,
    )  # fmt: skip


def _target(
    number: int, x: float, state: TrackState = TrackState.CONFIRMED, length: float = 8
) -> TargetRecord:
    return TargetRecord(
        id=number, state=state, x=x, y=5, length=length, width=4, angle=0, bbox=(x - 4, 3, x + 4, 7),
        score=1, age_ns=0, geo=GeoRecord(lat=48, lon=11 + x),
    )  # fmt: skip


def collect_run(records: list[TrackRecord]) -> RecordedRun:
    """The run of these records."""
    run = RecordedRun()
    for record in records:
        run.add(record)
    return run


def test_positions_are_on_the_plane_and_on_the_ground() -> None:
    """Those of shown states; times count from the first frame."""
    lost = _target(1, 7, TrackState.LOST)
    run = collect_run([_record(0, _target(1, 3)), _record(1, _target(1, 4, length=9)), _record(2, lost)])
    path = run.paths[1]
    assert list(path.plane[2]) == [0.0, 103.0, 55.0, 0.04, 104.0, 55.0]
    assert list(path.ground) == [0.0, 14.0, 48.0, 0.04, 15.0, 48.0]
    assert path.states == ["confirmed", "confirmed", "lost"]
    assert path.largest == (9, 1, (0, 3, 8, 7))
    assert list(run.shown) == [1, 1, 0]
    assert list(run.lost) == [0, 1, 2]
    assert run.statuses == ["ok"] * 3


def test_the_main_plane_has_the_most_positions() -> None:
    """Without registration, the frame is plane 0."""
    records = [_record(n, _target(1, 3), reference=[2, 5, 5][n]) for n in range(3)]
    assert collect_run(records).main_plane() == 5
    bare = collect_run([_record(0, _target(1, 3), reference=None)])
    assert bare.main_plane() == 0
    assert math.isnan(bare.corner_std[0])
    assert collect_run([]).main_plane() is None


def test_the_busiest_frame_has_the_most_shown_targets() -> None:
    """Confirmed or coasting; targets that were never confirmed are not listed."""
    tentative = _target(3, 9, TrackState.TENTATIVE)
    run = collect_run(
        [_record(0, _target(1, 3)), _record(1, _target(1, 3), _target(2, 6)), _record(2, tentative)]
    )
    assert run.busiest == 1
    assert list(run.busiest_boxes) == [1, 2]
    assert [path.id for path in run.shown_paths()] == [1, 2]


def test_frames_without_a_record_are_counted_within_an_epoch() -> None:
    """A new epoch may begin at any number."""
    records = [_record(0), _record(1), _record(4), msgspec.structs.replace(_record(90), epoch=1), _record(92)]
    records[-1] = msgspec.structs.replace(records[-1], epoch=1)
    assert list(collect_run(records).missing) == [0, 0, 2, 2, 3]

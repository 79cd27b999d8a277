"""Joins the track records of the parts of a file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from msgspec import structs

from streamkit import RecordFile, StreamError, TrackRecord
from streamkit_fleet.batch.seam import Boxes, match_ids


def join_records(parts: Sequence[Path]) -> Iterator[TrackRecord]:
    """The records of a file from those of its parts, in order.

    Each part begins with frames that the one before has, too. There its targets are matched, and keep their
    id and age; frame numbers go on; each part has a reference plane of its own, with the next free number.

    Args:
        parts: files of records; all but the last end with their overlap.

    Raises:
        OSError: a file cannot be read.
        StreamError: a line is no record, or two parts have no frame in common.
    """
    earlier: list[TrackRecord] = []
    next_id, next_plane = 0, 0
    for path in parts:
        mine = [record for _, record in RecordFile(path)]
        if earlier:
            mine = _continue(earlier, mine, path, next_id, next_plane)
            seam_ns = earlier[-1].pts_ns or 0
            mine = [record for record in mine if (record.pts_ns or 0) > seam_ns]
        for record in mine:
            next_id = max(next_id, *(target.id + 1 for target in record.tracks), 0)
            if record.registration is not None:
                next_plane = max(next_plane, record.registration.reference + 1)
        yield from mine
        earlier = mine or earlier


def _continue(
    earlier: Sequence[TrackRecord], later: Sequence[TrackRecord], path: Path, next_id: int, next_plane: int
) -> list[TrackRecord]:
    """The records of a part in the numbers of the part before."""
    before = {record.pts_ns: record for record in earlier if record.pts_ns is not None}
    pairs = [(before[record.pts_ns], record) for record in later if record.pts_ns in before]
    if not pairs:
        raise StreamError(f"{path}: has no frame in common with the part before; set a longer --overlap-s")
    ids = match_ids((_boxes(first), _boxes(second)) for first, second in pairs)
    ages = _age_offsets(pairs, ids)
    offset = pairs[-1][0].seq - pairs[-1][1].seq
    for target in sorted({target.id for record in later for target in record.tracks} - ids.keys()):
        ids[target] = next_id
        next_id += 1

    def renumbered(record: TrackRecord) -> TrackRecord:
        tracks = (
            structs.replace(target, id=ids[target.id], age_ns=target.age_ns + ages.get(target.id, 0))
            for target in record.tracks
        )
        plane = record.registration
        return structs.replace(
            record,
            seq=record.seq + offset,
            tracks=tuple(sorted(tracks, key=lambda target: target.id)),
            registration=plane and structs.replace(plane, reference=plane.reference + next_plane),
        )

    return [renumbered(record) for record in later if record.seq + offset >= 0]


def _age_offsets(pairs: Iterable[tuple[TrackRecord, TrackRecord]], ids: dict[int, int]) -> dict[int, int]:
    """How much older each matched target is than its part knows, ns."""
    found = {}
    for first, second in pairs:
        ages = {target.id: target.age_ns for target in first.tracks}
        for target in second.tracks:
            if (age := ages.get(ids.get(target.id, -1))) is not None:
                found[target.id] = age - target.age_ns
    return found


def _boxes(record: TrackRecord) -> Boxes:
    return {target.id: target.bbox for target in record.tracks}

"""Reads the moments of one track from a file of track records."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from streamkit import StreamError, TrackRecord, decode_record
from streamkit_tracker.explanation.moment import FramePlace, Match, Moment
from streamkit_tracker.report.reports import TargetProvenance


@dataclass
class TrackFile:
    """What a file says about one track.

    Attributes:
        moments: of the track, in the order of the file.
        others: ids of all tracks that were ever confirmed.
        frames: number of records.
        cut_off: whether the last line was only half written, as by a process that was killed.
    """

    moments: list[Moment] = field(default_factory=list)
    others: set[int] = field(default_factory=set)
    frames: int = 0
    cut_off: bool = False


def read_track(path: Path, number: int) -> TrackFile:
    """Reads a file of JSON lines as `tracksink` writes it.

    Args:
        path: the file.
        number: id of the track.

    Raises:
        OSError: the file cannot be read.
        ValueError: a line is no track record; names file and line.
    """
    found = TrackFile()
    for place, line in _lines(path):
        try:
            record = decode_record(line)
        except StreamError as error:
            if not line.endswith(b"\n") and found.frames:
                found.cut_off = True
                break
            raise ValueError(f"{place}: {error}; give a .jsonl file that tracksink wrote") from None
        found.frames += 1
        for index, target in enumerate(record.tracks):
            if target.state == "confirmed":
                found.others.add(target.id)
            if target.id == number:
                found.moments.append(moment(record, index))
    return found


def moment(record: TrackRecord, index: int) -> Moment:
    """The track that stands at an index in a record."""
    target = record.tracks[index]
    covariance = target.position_covariance
    registration, told = record.registration, target.provenance
    match = None if told is None else told.detection
    return Moment(
        frame=record.seq,
        epoch=record.epoch,
        seconds=None if record.pts_ns is None else record.pts_ns / 1e9,
        state=target.state.value,
        window=(target.x, target.y, target.length, target.width, target.angle),
        velocity=None if target.vx is None or target.vy is None else (target.vx, target.vy),
        spread=None
        if covariance is None
        else (math.sqrt(max(covariance[0][0], 0.0)), math.sqrt(max(covariance[1][1], 0.0))),
        score=target.score,
        age_s=target.age_ns / 1e9,
        place=None
        if registration is None
        else FramePlace(
            registration.status.value,
            registration.reference,
            registration.matches,
            registration.inliers,
            registration.rmse,
        ),
        provenance=None
        if told is None
        else TargetProvenance(
            told.predicted,
            None if match is None else match.row,
            None if match is None else match.gate,
            told.shared,
            told.similarity,
            told.learnt,
            told.cause or "",
        ),
        match=None
        if match is None
        else Match(match.centroid, match.bbox, match.area, match.score, match.label),
    )


def _lines(path: Path) -> Iterator[tuple[str, bytes]]:
    """Where a line is, and the line."""
    with path.open("rb") as file:
        for number, line in enumerate(file, 1):
            if line.strip():
                yield f"{path}:{number}", line

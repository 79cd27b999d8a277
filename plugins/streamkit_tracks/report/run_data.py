"""What a report shows of one run: its frames, and the path of each target."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from streamkit import SHOWN_STATES, TargetRecord, TrackRecord

FRAME_S = 1 / 25  # between frames without a time
Box = tuple[float, float, float, float]  # bounds x0 y0 x1 y1, px of the frame


@dataclass
class TargetPath:
    """The path of one target.

    Attributes:
        id: of the target.
        times_s: of its frames, from the beginning of the run.
        states: of it in these frames.
        plane: for each reference plane with a shown position: time (s), x and y (px), one after another.
        ground: the same with longitude and latitude, degrees.
        largest: length (px) where it is longest, the index of that frame, and its bounds there.
    """

    id: int
    times_s: array[float] = field(default_factory=lambda: array("d"))
    states: list[str] = field(default_factory=list)
    plane: dict[int, array[float]] = field(default_factory=dict)
    ground: array[float] = field(default_factory=lambda: array("d"))
    largest: tuple[float, int, Box] = (0.0, 0, (0.0, 0.0, 0.0, 0.0))


@dataclass
class RecordedRun:
    """One run of a file.

    Attributes:
        source: as the records name it.
        times_s: of the frames, from the first one.
        pts_ns: of the frames, as in the video; None where unknown.
        ages_ms: from capture to publishing; NaN where unknown.
        lost: records that the publisher could not deliver, up to each frame.
        shown: targets in each frame that are confirmed or coasting.
        statuses: of the registration of each frame; "" without one.
        corner_std: its predicted error, px; NaN where unknown.
        paths: by id.
        size: width and height of the frames, px; None where unknown.
        busiest: index of the frame with the most shown targets.
        busiest_boxes: their bounds there, by id.
    """

    source: str = ""
    times_s: array[float] = field(default_factory=lambda: array("d"))
    pts_ns: list[int | None] = field(default_factory=list)
    ages_ms: array[float] = field(default_factory=lambda: array("d"))
    lost: array[int] = field(default_factory=lambda: array("q"))
    shown: array[int] = field(default_factory=lambda: array("q"))
    statuses: list[str] = field(default_factory=list)
    corner_std: array[float] = field(default_factory=lambda: array("d"))
    paths: dict[int, TargetPath] = field(default_factory=dict)
    size: tuple[int, int] | None = None
    busiest: int = 0
    busiest_boxes: dict[int, Box] = field(default_factory=dict)

    def shown_paths(self) -> list[TargetPath]:
        """Those that were confirmed in any frame, the longest first."""
        found = [path for path in self.paths.values() if "confirmed" in path.states]
        return sorted(found, key=lambda path: (-len(path.times_s), path.id))

    def main_plane(self) -> int | None:
        """The reference plane with the most positions; None without any."""
        counts: Counter[int] = Counter()
        for path in self.paths.values():
            counts.update({plane: len(points) for plane, points in path.plane.items()})
        return counts.most_common(1)[0][0] if counts else None


def collect_run(records: Iterable[TrackRecord]) -> RecordedRun:
    """The frames and paths of the records of one run."""
    run, first_ns = RecordedRun(), None
    for index, record in enumerate(records):
        first_ns = record.pts_ns if first_ns is None else first_ns
        is_timed = record.pts_ns is not None and first_ns is not None
        time_s = (record.pts_ns - first_ns) / 1e9 if is_timed else index * FRAME_S  # type: ignore[operator]
        _add_frame(run, record, time_s)
        for target in record.tracks:
            _add_position(
                run.paths.setdefault(target.id, TargetPath(target.id)), record, target, time_s, index
            )
    return run


def _add_frame(run: RecordedRun, record: TrackRecord, time_s: float) -> None:
    registration = record.registration
    run.source = record.source
    run.times_s.append(time_s)
    run.pts_ns.append(record.pts_ns)
    run.ages_ms.append(float("nan") if record.age_ms is None else record.age_ms)
    run.lost.append(record.dropped)
    boxes = {target.id: target.bbox for target in record.tracks if target.state in SHOWN_STATES}
    run.shown.append(len(boxes))
    if len(boxes) > len(run.busiest_boxes):
        run.busiest, run.busiest_boxes = len(run.shown) - 1, boxes
    run.statuses.append("" if registration is None else str(registration.status))
    known = registration is not None and registration.corner_std is not None
    run.corner_std.append(registration.corner_std if known else float("nan"))  # type: ignore[union-attr,arg-type]
    if record.width and record.height:
        run.size = record.width, record.height


def _add_position(
    path: TargetPath, record: TrackRecord, target: TargetRecord, time_s: float, index: int
) -> None:
    path.times_s.append(time_s)
    path.states.append(target.state.value)
    if target.state not in SHOWN_STATES:
        return
    if target.length > path.largest[0]:
        path.largest = target.length, index, target.bbox
    if target.geo is not None:
        path.ground.extend((time_s, target.geo.lon, target.geo.lat))
    place = _on_plane(record, target)
    if place is not None:
        path.plane.setdefault(place[0], array("d")).extend((time_s, *place[1:]))


def _on_plane(record: TrackRecord, target: TargetRecord) -> tuple[int, float, float] | None:
    """Reference plane and position on it, px; without registration the frame is the plane."""
    registration = record.registration
    if registration is None:
        return 0, target.x, target.y
    if registration.to_reference is None:
        return None
    x, y, w = (row[0] * target.x + row[1] * target.y + row[2] for row in registration.to_reference)
    return registration.reference, x / w, y / w

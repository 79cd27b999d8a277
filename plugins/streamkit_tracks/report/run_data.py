"""What a report shows of one run: its frames, and the path of each target."""

from __future__ import annotations

from array import array
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from streamkit import SHOWN_STATES, TargetRecord, TrackRecord
from streamkit.geometry.homography import project

FRAME_S = 1 / 25  # between frames without a time
UNKNOWN = float("nan")
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
        missing: frames of the source without a record, up to each frame: gaps in `seq` within an epoch.
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
    missing: array[int] = field(default_factory=lambda: array("q"))
    shown: array[int] = field(default_factory=lambda: array("q"))
    statuses: list[str] = field(default_factory=list)
    corner_std: array[float] = field(default_factory=lambda: array("d"))
    paths: dict[int, TargetPath] = field(default_factory=dict)
    size: tuple[int, int] | None = None
    busiest: int = 0
    busiest_boxes: dict[int, Box] = field(default_factory=dict)
    _first_ns: int | None = None
    _last: tuple[int, int] | None = None  # epoch and seq of the last record

    def add(self, record: TrackRecord) -> None:
        """Adds a frame, and the positions of its targets."""
        index = len(self.times_s)
        self._first_ns = record.pts_ns if self._first_ns is None else self._first_ns
        time_s = index * FRAME_S
        if record.pts_ns is not None and self._first_ns is not None:
            time_s = (record.pts_ns - self._first_ns) / 1e9
        registration = record.registration
        shown = [target for target in record.tracks if target.state in SHOWN_STATES]
        if len(shown) > len(self.busiest_boxes):
            self.busiest, self.busiest_boxes = index, {target.id: target.bbox for target in shown}
        if record.width and record.height:
            self.size = record.width, record.height
        self.source = record.source
        self.times_s.append(time_s)
        self.pts_ns.append(record.pts_ns)
        self.ages_ms.append(UNKNOWN if record.age_ms is None else record.age_ms)
        self.lost.append(record.dropped)
        self.missing.append((self.missing[-1] if self.missing else 0) + self._gap(record))
        self.shown.append(len(shown))
        self.statuses.append("" if registration is None else str(registration.status))
        std = None if registration is None else registration.corner_std
        self.corner_std.append(UNKNOWN if std is None else std)
        for target in record.tracks:
            path = self.paths.setdefault(target.id, TargetPath(target.id))
            path.times_s.append(time_s)
            path.states.append(target.state.value)
        for target in shown:
            self._add_position(self.paths[target.id], record, target)

    def _gap(self, record: TrackRecord) -> int:
        """Frames of the source between the last record and this one."""
        last, self._last = self._last, (record.epoch, record.seq)
        if last is None or last[0] != record.epoch:
            return 0
        return max(0, record.seq - last[1] - 1)

    def _add_position(self, path: TargetPath, record: TrackRecord, target: TargetRecord) -> None:
        time_s = self.times_s[-1]
        if target.length > path.largest[0]:
            path.largest = target.length, len(self.times_s) - 1, target.bbox
        if target.geo is not None:
            path.ground.extend((time_s, target.geo.lon, target.geo.lat))
        plane, place = 0, (target.x, target.y)  # without registration, the frame is the plane
        if record.registration is not None:
            if record.registration.to_reference is None:
                return
            plane, matrix = record.registration.reference, np.array(record.registration.to_reference)
            place = tuple(project(matrix, np.array([place]))[0].tolist())
        path.plane.setdefault(plane, array("d")).extend((time_s, *place))

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

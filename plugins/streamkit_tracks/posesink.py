"""posesink: the flight path of the camera, from telemetry, as KML."""

from __future__ import annotations

from pathlib import Path

from typing_extensions import override

from streamkit import SECOND_NS, Frame, OutputFileSink, Pose, Property
from streamkit_tracks.file_formats import KML, utc_time
from streamkit_tracks.flight_path import HEAD, PathPoint, path_placemark, view_outline, view_placemark

# The path is written anew when it has grown by this part: a long flight is not written every second.
GROWTH = 1 / 50


class PoseSink(OutputFileSink):
    """Writes the flight path of the camera to KML: positions with times and headings, and what it saw.

    Frames need poses, as `posesync` attaches them; those too far from any telemetry are left out. The outline
    of the view is that of the telemetry, else computed from field of view, height and angles. A viewer's time
    slider plays both, beside the targets of `tracksink location=tracks.kml`.

    Example:
        filesrc name=s location=flight.ts  s.video ! decode ! posesync name=p ! posesink location=flight.kml \
            s.klv ! p.telemetry
    """

    sink = "ANY"
    suffixes = (".kml",)
    example = "flight.kml"

    interval_s: float = Property(1.0, min=0.0, unit="s", doc="Least time between two positions.")
    views: bool = Property(True, doc="Write the outline of the view on the ground where it is known.")
    ground_altitude: float | None = Property(
        None, unit="m", doc="Altitude of the ground with the datum of the poses; by default as reported."
    )

    @override
    def begin(self) -> None:
        self._points: list[PathPoint] = []
        self._stale = 0
        self._views, self._next_length = HEAD, 1
        self._last = -1, 0  # epoch and pts of the last position
        self.file = self.open_file(is_whole=True)

    @override
    def write(self, frame: Frame) -> None:
        pose = frame.get(Pose)
        self._stale += pose is not None and pose.is_stale
        if pose is None or pose.is_stale or not self._is_due(frame):
            return
        time = utc_time(frame.capture.utc_ns if frame.capture else None)
        self._points.append(PathPoint(pose, time))
        if self.views and (outline := view_outline(pose, _shape(frame), self.ground_altitude)):
            self._views += view_placemark(outline, time, self.interval_s)
        if len(self._points) >= self._next_length:
            self._next_length = len(self._points) + 1 + int(GROWTH * len(self._points))
            self._flush()

    @override
    def has_content(self) -> bool:
        return bool(self._points)

    @override
    def end(self) -> None:
        self._flush()
        super().end()

    @override
    def shortfall(self) -> str:
        if self._points:
            return ""
        if self._stale:
            return (
                f"the poses of all {self._stale} frames that have one are stale, too far from any telemetry; "
                "check offset-s and max-gap-s of posesync"
            )
        return "no frame has a pose; pair telemetry with posesync"

    def _is_due(self, frame: Frame) -> bool:
        """Whether the interval is over, or another epoch begins."""
        epoch, pts = self._last
        if frame.epoch == epoch and (frame.pts or 0) - pts < self.interval_s * SECOND_NS:
            return False
        self._last = frame.epoch, frame.pts or 0
        return True

    def _flush(self) -> None:
        assert self.file is not None
        views, self._views = self._views, ""
        self.file.append(views.encode(), self._tail)

    def _tail(self) -> bytes:
        path = path_placemark(self._points, Path(self.location).stem) if self._points else ""
        return (path + KML.tail).encode()


def _shape(frame: Frame) -> tuple[int, int] | None:
    """Height and width of a frame of video, px."""
    height, width = frame.caps.get("height"), frame.caps.get("width")
    return (height, width) if isinstance(height, int) and isinstance(width, int) else None

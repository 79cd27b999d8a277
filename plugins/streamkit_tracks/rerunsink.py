"""rerunsink: frames and tracks in a recording for the Rerun viewer."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from typing_extensions import override

from streamkit import SHOWN_STATES, Frame, Property, TrackRecord, needs_extra
from streamkit.geometry.homography import project
from streamkit_tracks.record_sink import RecordFileSink

APPLICATION = "streamkit"


class RerunSink(RecordFileSink):
    """Writes a recording for Rerun, with the types of its own library.

    Frames are JPEG images at `camera`, with the upright boxes of targets at `camera/tracks`. Positions on the
    reference plane are points at `plane/tracks`, those on the ground geographic points at `ground/tracks`;
    `targets` and `age_ms` are scalars. The timelines are `frame`, `pts`, and `capture` where it is known.

    Needs the extra `rerun`: pip install 'streamkit[rerun]'.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! rerunsink location=run.rrd
    """

    sink = "video/x-raw, format={ BGR, GRAY8 }; application/x-tracks"
    suffixes = (".rrd",)
    example = "run.rrd"
    images: bool = Property(True, doc="Write the frames, too.")
    image_quality: int = Property(75, min=1, max=100, doc="Quality of their JPEG.")

    _recording: Any = None

    @override
    def start(self) -> None:
        super().start()
        with needs_extra("rerunsink", "rerun"):
            import rerun
        self._rerun: Any = rerun

    @override
    def begin(self) -> None:
        super().begin()
        self._recording = self._rerun.RecordingStream(APPLICATION)
        assert self.file is not None
        # The library writes the file itself: pieces of its byte stream do not make one recording.
        self._recording.save(self.file.name)

    @override
    def write(self, frame: Frame) -> None:
        record = self.record(frame, self.clock.utc_ns())
        self._set_times(record)
        if self.images and frame.caps.name == "video/x-raw":
            model = "L" if frame.caps["format"] == "GRAY8" else "BGR"
            image = self._rerun.Image(np.asarray(frame.data), color_model=model)
            self._recording.log("camera", image.compress(jpeg_quality=self.image_quality))
        self._log_targets(record)
        if record.age_ms is not None:
            self._recording.log("age_ms", self._rerun.Scalars(record.age_ms))

    @override
    def end(self) -> None:
        self._recording.disconnect()
        super().end()

    @override
    def abandon(self) -> None:
        if self._recording is not None:
            self._recording.disconnect()
        super().abandon()

    def _set_times(self, record: TrackRecord) -> None:
        recording = self._recording
        recording.set_time("frame", sequence=record.seq)
        if record.pts_ns is not None:
            recording.set_time("pts", duration=np.timedelta64(record.pts_ns, "ns"))
        if record.capture_ns is not None:
            recording.set_time("capture", timestamp=np.datetime64(record.capture_ns, "ns"))

    def _log_targets(self, record: TrackRecord) -> None:
        rerun, log = self._rerun, self._recording.log
        shown = [row for row in record.tracks if row.state in SHOWN_STATES]
        labels = [str(row.id) for row in shown]
        boxes = np.array([row.bbox for row in shown]).reshape(-1, 4)
        sizes = boxes[:, 2:] - boxes[:, :2]
        log("camera/tracks", rerun.Boxes2D(mins=boxes[:, :2], sizes=sizes, labels=labels))
        log("plane/tracks", rerun.Points2D(on_plane(record, shown), labels=labels))
        places = [(row.geo.lat, row.geo.lon) for row in shown if row.geo is not None]
        if places:
            log("ground/tracks", rerun.GeoPoints(lat_lon=places))
        log("targets", rerun.Scalars(len(shown)))


def on_plane(record: TrackRecord, shown: Sequence[Any]) -> np.ndarray[Any, Any]:
    """Positions on the reference plane, float64[n, 2]; none where the registration is unknown."""
    if record.registration is None or record.registration.to_reference is None:
        return np.zeros((0, 2))
    points = np.array([(row.x, row.y) for row in shown], np.float64).reshape(-1, 2)
    return project(np.array(record.registration.to_reference), points)

"""zenohsink: publishes the tracks of each frame, pictures, and how the pipeline is doing."""

import threading
from collections.abc import Callable

from streamkit import (
    TRACKS_CAPS,
    Caps,
    Direction,
    Flushing,
    Frame,
    PadTemplate,
    Presence,
    Property,
    ResourceError,
    Sink,
)
from streamkit_zenoh.connection import Connection
from streamkit_zenoh.keys import InvalidKey, publication_key, root_of
from streamkit_zenoh.presence import wait_for_receivers
from streamkit_zenoh.publish.publication import Publication, PublicationSettings
from streamkit_zenoh.publish.quality import InvalidQuality, quality
from streamkit_zenoh.session import close_session, plain
from streamkit_zenoh.wire.forms import Form, MissingLibrary
from streamkit_zenoh.wire.pictures import PictureFormat

# At the end of the stream zenoh may take its time to hand over the last records; a stop may not.
FINISH_LIMIT_S = 12.0
STOP_LIMIT_S = 2.0


class ZenohSink(Connection, Sink):
    """Publishes a record per frame at KEY/tracks, each target at KEY/track/ID, and a status at KEY/status.

    With frame-rate, pictures at KEY/frame; what comes in at the pads `frame` and `mosaic` at KEY/frame and
    KEY/mosaic. Nothing here holds the pipeline up: what waits to be sent is bounded, the oldest is dropped,
    counted, and seen by receivers as a gap in the numbers. The last message of each key is answered to
    queries, the schemas at KEY/schema. A liveliness token at KEY/alive ends after the last record. Without
    connect and listen, receivers on this machine find it by themselves.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! zenohsink key=uav/1
    """

    sink = "video/x-raw; application/x-tracks"
    templates = (
        PadTemplate("mosaic", Direction.SINK, Caps("video/x-raw"), Presence.REQUEST),
        PadTemplate("frame", Direction.SINK, Caps("video/x-raw"), Presence.REQUEST),
    )
    key: str = Property(
        "streamkit", doc="Where to publish: records go to KEY/tracks, and name KEY as source."
    )
    encoding: Form = Property(Form.JSON, doc="How records and status become bytes.")
    tracks: bool = Property(True, doc="Publish a record per frame at KEY/tracks.")
    track: bool = Property(
        True, doc="Publish each confirmed target at KEY/track/ID, and delete it when it ends."
    )
    status: bool = Property(True, doc="Publish state, counters and age at KEY/status, once a second.")
    frame_rate: float = Property(
        0.0, min=0.0, max=1000.0, unit="/s", doc="Pictures published at KEY/frame; 0 publishes none."
    )
    frame_width: int = Property(
        960, min=0, max=16384, unit="px", doc="Wider frames are scaled to it; 0 leaves them as they are."
    )
    frame_format: PictureFormat = Property(PictureFormat.JPEG, doc="Of the pictures at KEY/frame.")
    mosaic_format: PictureFormat = Property(PictureFormat.JPEG, doc="Of the pictures at KEY/mosaic.")
    picture_quality: int = Property(80, min=1, max=100, doc="Of JPEG.")
    max_queue: int = Property(256, min=1, max=100_000, doc="Records that may wait to be sent.")
    patience_s: float = Property(
        0.0,
        min=0.0,
        max=86_400.0,
        unit="s",
        doc="How long a frame may wait for room in the queue before the oldest record is dropped.",
    )
    cut_off_s: float = Property(
        5.0, min=1.0, max=3600.0, unit="s", doc="A receiver that takes nothing for so long is cut off."
    )
    ground_altitude: float | None = Property(
        None,
        unit="m",
        doc="Of the ground, counted as the poses count it: targets then have their place on it.",
    )
    tracks_qos: str = Property(
        "block,data-high", doc="Of KEY/tracks: block or drop, a priority (real-time to background), express."
    )
    track_qos: str = Property("drop,data", doc="Of KEY/track/ID, in the same words.")
    frame_qos: str = Property("drop,data-low", doc="Of KEY/frame, in the same words.")
    mosaic_qos: str = Property("block,background", doc="Of KEY/mosaic, in the same words.")
    status_qos: str = Property("block,data-high", doc="Of KEY/status, in the same words.")
    wait_subscribers: int = Property(
        0,
        min=0,
        doc="Receivers to wait for before the first record; of 2 and more only zenohsrc is counted.",
    )
    wait_timeout_s: float = Property(30.0, min=0.0, unit="s", doc="How long to wait for them before failing.")

    _publication: Publication | None = None

    def start(self) -> None:
        """Opens the session and shows that a publisher is there."""
        self._publication = None
        self._waited = not self.wait_subscribers
        self._warned = False
        self._shows_frames = bool(self.frame_rate) and "frame" not in self.pads
        try:
            settings = self._settings_of_publication()
        except (InvalidKey, InvalidQuality) as error:
            raise ResourceError(str(error)) from None
        session = self.open_zenoh(self.cut_off_s)
        try:
            self._publication = Publication(session, settings, self.clock.utc_ns, self._failed)
        except MissingLibrary as error:
            close_session(session, STOP_LIMIT_S)
            raise ResourceError(str(error)) from None

    def receiver(self, pad: object) -> Callable[[Frame], None]:
        """What takes the frames of a pad: `sink` the records, `frame` and `mosaic` the pictures."""
        name = getattr(pad, "name", "sink")
        if name == "sink":
            return super().receiver(pad)  # type: ignore[arg-type]
        return self._take_mosaic if name == "mosaic" else self._take_picture

    def render(self, frame: Frame) -> None:
        """Lines up the frame's record, and the frame where a picture is due."""
        publication = self._publication
        assert publication is not None, "start() comes before frames"
        if not self._waited:
            self._wait_for_receivers(publication)
        dropped = publication.records.submit(frame, self.stopping)
        if dropped:
            publication.records.count_lost(dropped, "queue full")
            self.count_drop("tracks: queue full", dropped)
        if self._shows_frames and frame.caps.name != TRACKS_CAPS.name:
            self._take_picture(frame)

    def drain(self) -> None:
        """Sends what waits, then ends the session, by which receivers know that nothing follows."""
        publication = self._publication
        if publication is not None:
            left = publication.flush(self.cut_off_s, self.stopping)
            if left:
                self.post_warning(f"{left} records could not be sent before the end: receivers are too slow")
            try:
                publication.records.demand_sound()
            finally:
                self._close(FINISH_LIMIT_S, self.stopping)

    def stop(self) -> None:
        """Ends the session within bounds."""
        self._close(STOP_LIMIT_S)

    def _settings_of_publication(self) -> PublicationSettings:
        return PublicationSettings(
            root=root_of(publication_key(self.key)),
            source=self.key,
            form=self.encoding,
            tracks=self.tracks,
            track=self.track,
            status=self.status,
            frame_every_ns=round(1e9 / self.frame_rate) if self.frame_rate else 0,
            has_frame=bool(self.frame_rate) or "frame" in self.pads,
            has_mosaic="mosaic" in self.pads,
            frame_width=self.frame_width,
            frame_format=self.frame_format,
            mosaic_format=self.mosaic_format,
            picture_quality=self.picture_quality,
            max_queue=self.max_queue,
            patience_s=self.patience_s,
            cut_off_s=self.cut_off_s,
            ground_altitude_m=self.ground_altitude,
            qualities={
                "tracks": quality(self.tracks_qos),
                "track": quality(self.track_qos),
                "frame": quality(self.frame_qos),
                "mosaic": quality(self.mosaic_qos),
                "status": quality(self.status_qos),
            },
        )

    def _take_picture(self, frame: Frame) -> None:
        if self._publication is not None and self._publication.pictures is not None:
            self._publication.pictures.submit(frame, self.clock_ns())

    def _take_mosaic(self, frame: Frame) -> None:
        if self._publication is not None and self._publication.mosaics is not None:
            self._publication.mosaics.submit(frame, self.clock_ns())

    def _wait_for_receivers(self, publication: Publication) -> None:
        publisher = publication.tracks.publisher
        there = wait_for_receivers(
            publisher, publication.receivers, self.wait_subscribers, self.wait_timeout_s, self.stopping
        )
        if not there and self.stopping.is_set():
            raise Flushing(self.name)
        if not there:
            raise ResourceError(
                f"wait-subscribers={self.wait_subscribers}: not there at {publisher.key_expr} within "
                f"{self.wait_timeout_s:g} s; start them first, or give both sides the same endpoint"
            )
        publication.tracks.is_wanted = True
        self._waited = True

    def _failed(self, error: Exception) -> None:
        if not self._warned and not self.stopping.is_set():
            self._warned = True
            self.post_warning(f"something was not published: {plain(error)}")

    def _close(self, limit_s: float, cancelled: threading.Event | None = None) -> None:
        publication, self._publication = self._publication, None
        if publication is None:
            return
        is_closed = publication.close(limit_s, cancelled)
        for stream, reason, count in publication.drops():
            counted = self.drops[f"{stream}: {reason}"]
            self.count_drop(f"{stream}: {reason}", count - counted)
        if not is_closed:
            self.post_warning("a receiver takes nothing: the last records may be lost to it")

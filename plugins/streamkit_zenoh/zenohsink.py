"""zenohsink: publishes the tracks of each frame, frames as images, and the status of the pipeline."""

import threading
from collections.abc import Callable

from typing_extensions import override

from streamkit import (
    TRACKS_CAPS,
    Caps,
    Direction,
    Flushing,
    Frame,
    Pad,
    PadTemplate,
    Presence,
    Property,
    RecordTally,
    ResourceError,
    SettingsOf,
    Sink,
)
from streamkit_zenoh.configuration import error_line
from streamkit_zenoh.keys import FRAME, MOSAIC, VIDEO, InvalidKey, publication_root
from streamkit_zenoh.presence import KeyInUse, wait_for_receivers
from streamkit_zenoh.publish.numbered_stream import Publisher
from streamkit_zenoh.publish.publication import Publication
from streamkit_zenoh.publish.settings import InvalidQos, PublicationSettings
from streamkit_zenoh.session import SessionElement, close_session
from streamkit_zenoh.wire.encodings import MissingLibrary
from streamkit_zenoh.wire.messages import ElementDrop, ElementStatus
from streamkit_zenoh.wire.video_header import VIDEO_CAPS

# At EOS zenoh is given time to deliver the last records; at a stop it is not.
FINISH_LIMIT_S = 12.0
STOP_LIMIT_S = 2.0


class ZenohSink(SessionElement, Sink):
    """Publishes a record per frame at KEY/tracks, each target at KEY/track/ID, and a status at KEY/status.

    With frame-rate, frames are published as images at KEY/frame; frames of the pads `frame` and `mosaic` at
    KEY/frame and KEY/mosaic; coded packets of the pad `video`, unchanged, at KEY/video. A slow network does
    not delay the pipeline: the queue is bounded, the oldest message is dropped and counted, and receivers see
    a gap in the numbers. Queries are answered with the last message of each key, and at KEY/schema with the
    schemas; with control=true queries at KEY/control set live properties. The liveliness token KEY/alive ends
    after the last record. Without connect and listen, receivers on this machine find the publisher by
    themselves.

    A second publisher at a key is refused, unless takeover or shared says otherwise.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! zenohsink key=uav/1
    """

    sink = "video/x-raw; application/x-tracks"
    templates = (
        PadTemplate(MOSAIC, Direction.SINK, Caps("video/x-raw"), Presence.REQUEST),
        PadTemplate(FRAME, Direction.SINK, Caps("video/x-raw"), Presence.REQUEST),
        PadTemplate(VIDEO, Direction.SINK, Caps(VIDEO_CAPS), Presence.REQUEST),
    )
    settings = SettingsOf(PublicationSettings)
    wait_subscribers: int = Property(
        0,
        min=0,
        doc="Receivers to wait for before the first message; for 2 and more only zenohsrc is counted.",
    )
    wait_timeout_s: float = Property(30.0, min=0.0, unit="s", doc="How long to wait for them before failing.")

    _publication: Publication | None = None

    @override
    def start(self) -> None:
        self._publication = None
        self._has_waited = not self.wait_subscribers
        self._tally = RecordTally()
        settings = self.settings
        self._publishes_frames = bool(settings.frame_rate) and FRAME not in self.pads
        streams = [name for name in (FRAME, MOSAIC, VIDEO) if name in self.pads]
        if self._publishes_frames:
            streams.insert(0, FRAME)
        try:
            root = publication_root(settings.key)
        except InvalidKey as error:
            raise ResourceError(str(error)) from None
        session = self.open_zenoh(settings.cut_off_s)
        try:
            publisher = Publisher(
                session, root, settings, self.clock.utc_ns, self.clock.utc_ns(), self._failed,
                self._count_dropped, self.stopping,
            )  # fmt: skip
            self._publication = Publication(publisher, streams, self.host.elements, self._element_statuses)
        except (InvalidQos, MissingLibrary, KeyInUse) as error:
            close_session(session, STOP_LIMIT_S)
            raise ResourceError(str(error)) from None

    @override
    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        if pad.name in (FRAME, MOSAIC, VIDEO):
            return lambda frame: self._publish_media(pad.name, frame)
        return super().receiver(pad)

    @override
    def render(self, frame: Frame) -> None:
        publication = self._publication
        assert publication is not None, "start() precedes frames"
        if not self._has_waited:
            self._wait_for_receivers(publication)
        self._tally.note(frame)
        publication.records.submit(frame)
        if self._publishes_frames and frame.caps.name != TRACKS_CAPS.name:
            self._publish_media(FRAME, frame)

    @override
    def drain(self) -> None:
        publication = self._publication
        if publication is not None:
            if left := publication.drain():
                self.post_warning(f"{left} messages could not be sent before the end: receivers are too slow")
            try:
                publication.records.raise_fault()
            finally:
                self._close(FINISH_LIMIT_S, self.stopping)

    @override
    def stop(self) -> None:
        self._close(STOP_LIMIT_S)

    def _publish_media(self, stream: str, frame: Frame) -> None:
        publication = self._publication
        if publication is not None:
            if not self._has_waited:
                self._wait_for_receivers(publication)
            publication.media[stream].submit(frame)

    def _wait_for_receivers(self, publication: Publication) -> None:
        records = publication.records
        there = wait_for_receivers(
            records.declared, publication.receivers, self.wait_subscribers, self.wait_timeout_s, self.stopping
        )
        if not there and self.stopping.is_set():
            raise Flushing(self.name)
        if not there:
            raise ResourceError(
                f"wait-subscribers={self.wait_subscribers}: not there at {records.key} within "
                f"{self.wait_timeout_s:g} s; start them first, or give both sides the same endpoint"
            )
        self._has_waited = True

    def _element_statuses(self) -> tuple[ElementStatus, ...]:
        return tuple(
            ElementStatus(
                name=f"{row.parent}/{row.element}" if row.parent else row.element,
                busy_ns=row.busy_ns if row.queue is None else 0,
                drops=tuple(
                    ElementDrop(reason=reason, count=count)
                    for reason, count in row.dropped.items()
                    if row.element != self.name  # the status has its own by stream
                ),
            )
            for row in self.host.statistics(self.clock_ns())
        )

    def _failed(self, error: Exception) -> None:
        if not self.stopping.is_set():
            self.warn_once(f"something was not published: {error_line(error)}", "failure")

    def _close(self, limit_s: float, cancelled: threading.Event | None = None) -> None:
        publication, self._publication = self._publication, None
        if publication is None:
            return
        settings = self.settings
        publishes_images = self._publishes_frames or FRAME in self.pads
        needs_tracks = (settings.tracks or settings.track) and not publishes_images
        if needs_tracks and (text := self._tally.shortfall()):
            self.post_warning(f"key={settings.key}: {text}", "shortfall")
        elif needs_tracks and (text := self._tally.remark()):
            self.post_message("note", text=f"key={settings.key}: {text}")
        if not publication.close(limit_s, cancelled):
            self.post_warning("a receiver takes nothing: the last records may be lost to it")

    def _count_dropped(self, reason: str, count: int) -> None:
        """Counts what the senders drop in their own threads."""
        with self.lock:
            self.count_drop(reason, count)

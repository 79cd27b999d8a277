"""Senders: what is published of each frame: its record and targets, images, and coded packets."""

import time
import zlib
from collections.abc import Callable, Iterable

import msgspec
import numpy as np
import zenoh
from typing_extensions import override

from streamkit import (
    SHOWN_STATES,
    TRACKS_CAPS,
    TRACKS_SCHEMA,
    Detections,
    Frame,
    Pose,
    Registration,
    StreamError,
    TrackRecord,
    Tracks,
    record_line,
    track_record,
)
from streamkit_zenoh.keys import FRAME, MOSAIC, TRACK, TRACKS, VIDEO
from streamkit_zenoh.presence import is_matching
from streamkit_zenoh.publish.numbered_stream import Outgoing, Publisher, Reply, Sender
from streamkit_zenoh.wire.encodings import Codec, Encoding
from streamkit_zenoh.wire.frame_header import FRAME_SCHEMA, frame_header
from streamkit_zenoh.wire.images import ImageFormat, encode_image, grey_or_bgr, scaled_to_width
from streamkit_zenoh.wire.video_header import VIDEO_SCHEMA, video_header

RECORDED: tuple[type, ...] = (Tracks, Registration, Pose, Detections)  # metadata that a record is made of
# Two seconds may wait for a slow network; then receivers see a gap, and go on at the next keyframe.
PACKET_CAPACITY = 64


class RecordSender(Sender):
    """Makes and publishes the records of frames, and the status once a second and before the first record.

    Attributes:
        age_ms: from capture to publishing, of the last record sent.
        targets: number of targets in the last record sent.
        last_frame: the last one, without pixels.

    Raises:
        MissingLibrary: the encoding's library is not installed.
    """

    def __init__(self, publisher: Publisher, publish_status: Callable[[], None]) -> None:
        settings, session = publisher.settings, publisher.session
        self._codec = Codec(TrackRecord, TRACKS_SCHEMA, settings.encoding)
        self.age_ms: float | None = None
        self.targets = 0
        self.last_frame: Frame | None = None
        self._fault: Exception | None = None
        self._publish_status = publish_status
        self._has_begun = False
        self._track_key = f"{publisher.root}/{TRACK}"
        self._track_qos = settings.qos()[TRACK]
        self._shown: set[int] = set()
        super().__init__(
            publisher, TRACKS, self._codec.content_type, settings.max_queue, settings.patience_s,
            publish_status,
        )  # fmt: skip
        # Targets are published by the session: this only shows whether anyone wants them.
        key = f"{self._track_key}/*"
        self.part_publisher = session.declare_publisher(key) if settings.track else None

    @override
    def submit(self, frame: Frame) -> None:
        """Queues a frame.

        Raises:
            ValueError: a track of an earlier frame is not finite.
            StreamError: the data of an earlier frame with record caps is no record.
            ResourceError: another publisher has taken the key.
        """
        if self._fault is not None:
            self.raise_fault()
        if frame.caps.name != TRACKS_CAPS.name:
            # Only what its record needs, so that a queue of frames holds no pixels.
            kept = {kind: item for kind, item in frame.metadata.items() if kind in RECORDED}
            frame = Frame(
                b"", frame.caps, pts=frame.pts, epoch=frame.epoch, seq=frame.seq, capture=frame.capture,
                metadata=kept,
            )  # fmt: skip
        self.last_frame = frame
        super().submit(frame)

    def end_with(self, fault: Exception) -> None:
        """Ends the stream: the next frame raises this, or what was given before it."""
        self._fault = self._fault or fault

    def raise_fault(self) -> None:
        """Raises why the stream must end, once: a record that could not be made, or a key that was taken."""
        fault, self._fault = self._fault, None
        if fault is not None:
            raise fault

    def end_tracks(self) -> None:
        """Deletes the keys of all targets."""
        self._delete(self._shown, self.next_stamp.attachment())
        self._shown = set()

    @override
    def replies(self, asked: zenoh.KeyExpr) -> Iterable[Reply]:
        """The last record sent, and that of each of its targets, for a query that matches their keys.

        A queued record is no reply: it would overtake the records before it.
        """
        settings = self.publisher.settings
        asks_all = settings.tracks and asked.intersects(self.key)
        asks_one = settings.track and asked.intersects(f"{self._track_key}/*")
        if self.last is None or not (asks_all or asks_one):
            return
        attachment, encoding = self.last.stamp.attachment(), self.encoding
        record = self._record(self.last.frame, self.last.made_ns)
        if asks_all:
            yield Reply(self.key, self._payload(self.last.frame, record), encoding, attachment)
        for key, payload in self._track_payloads(record):
            if asks_one and asked.intersects(key):
                yield Reply(key, payload, encoding, attachment)

    @override
    def send(self, item: Outgoing) -> None:
        try:
            record = self._record(item.frame, self.publisher.utc_ns())
            payload = self._payload(item.frame, record)
        except (ValueError, StreamError) as error:
            self.end_with(error)
            return
        attachment = item.stamp.attachment()
        if not self._has_begun:
            # Before the first record: a receiver then knows that a publisher without `ended` was cut off.
            self._has_begun = True
            self._publish_status()
        if self.publisher.settings.tracks and self.has_subscriber:
            self.put(payload, attachment)
        if is_matching(self.part_publisher):
            self._send_tracks(record, attachment)
        self.settle(item)
        self.age_ms, self.targets = record.age_ms, len(record.tracks)

    def _send_tracks(self, record: TrackRecord, attachment: bytes) -> None:
        options = {"encoding": self.encoding, "attachment": attachment, **self._track_qos._asdict()}
        for key, payload in self._track_payloads(record):
            self.publisher.session.put(key, payload, **options)
        shown = {target.id for target in record.tracks if target.state in SHOWN_STATES}
        self._delete(self._shown - shown, attachment)
        self._shown = shown

    def _delete(self, ids: Iterable[int], attachment: bytes) -> None:
        # Never dropped: receivers would keep an ended target forever.
        qos = self._track_qos._replace(congestion_control=zenoh.CongestionControl.BLOCK)
        for number in sorted(ids):
            self.publisher.session.delete(
                f"{self._track_key}/{number}", attachment=attachment, **qos._asdict()
            )

    def _track_payloads(self, record: TrackRecord) -> Iterable[tuple[str, bytes]]:
        """Key and payload of each target: the same record, with this target alone."""
        for target in record.tracks:
            if target.state in SHOWN_STATES:
                alone = msgspec.structs.replace(record, tracks=(target,))
                yield f"{self._track_key}/{target.id}", self._codec.encode(alone)

    def _record(self, frame: Frame, published_ns: int) -> TrackRecord:
        settings = self.publisher.settings
        return track_record(
            frame,
            source=settings.key,
            published_ns=published_ns,
            dropped=self.dropped,
            ground_altitude_m=settings.ground_altitude,
            provenance=settings.provenance,
        )

    def _payload(self, frame: Frame, record: TrackRecord) -> bytes:
        if frame.caps.name == TRACKS_CAPS.name and self._codec.encoding is Encoding.JSON:
            return record_line(frame)
        return self._codec.encode(record)


class ImageSender(Sender):
    """Publishes the newest frame as an image, scaled down to a width; 0 is its own."""

    drop_reason = "replaced by a newer one"

    def __init__(self, publisher: Publisher, name: str, image_format: ImageFormat, width: int) -> None:
        self._format, self._width = image_format, width
        super().__init__(publisher, name, f"image/{image_format};{FRAME_SCHEMA}", capacity=1)

    @override
    def send(self, item: Outgoing) -> None:
        self.put(*self.encoded(item))
        self.settle(item)

    @override
    def replies(self, asked: zenoh.KeyExpr) -> Iterable[Reply]:
        if self.last is not None and asked.intersects(self.key):
            payload, attachment = self.encoded(self.last)
            yield Reply(self.key, payload, self.encoding, attachment)

    def encoded(self, item: Outgoing) -> tuple[bytes, bytes]:
        """Payload and attachment."""
        settings, frame = self.publisher.settings, item.frame
        image = scaled_to_width(grey_or_bgr(frame.data, str(frame.caps["format"])), self._width)
        now_ns, dropped = self.publisher.utc_ns(), self.dropped
        header = frame_header(frame, settings.key, now_ns, dropped, image.shape)
        return encode_image(image, self._format, settings.picture_quality), item.stamp.attachment(header)


class FrameSender(ImageSender):
    """Publishes frames by their own clock, at the rate of the settings."""

    def __init__(self, publisher: Publisher) -> None:
        settings = publisher.settings
        super().__init__(publisher, FRAME, settings.frame_format, settings.frame_width)
        self._due = 0, -1  # when the next frame is due, ns, in which epoch

    @override
    def submit(self, frame: Frame) -> None:
        if self._is_due(frame):
            super().submit(frame)

    def _is_due(self, frame: Frame) -> bool:
        if not self.publisher.settings.frame_rate:
            return True
        period_ns = round(1e9 / self.publisher.settings.frame_rate)
        time_ns = time.monotonic_ns() if frame.pts is None else frame.pts
        due_ns, epoch = self._due
        if epoch != frame.epoch:
            due_ns = time_ns
        if time_ns < due_ns:
            return False
        # Due times stay multiples of the period: else 30 frames a second at a rate of 20 would become 15.
        self._due = due_ns + ((time_ns - due_ns) // period_ns + 1) * period_ns, frame.epoch
        return True


class MosaicSender(ImageSender):
    """Publishes a mosaic whole, and only when its pixels or their place on the ground have changed."""

    def __init__(self, publisher: Publisher) -> None:
        super().__init__(publisher, MOSAIC, publisher.settings.mosaic_format, 0)
        self._last_seen: object = None

    @override
    def submit(self, frame: Frame) -> None:
        registration = frame.get(Registration)
        place = registration and (registration.reference, registration.to_reference.tobytes())
        before, self._last_seen = self._last_seen, (zlib.crc32(np.ascontiguousarray(frame.data).data), place)
        if self._last_seen != before:
            super().submit(frame)


class VideoSender(Sender):
    """Publishes packets unchanged, if there is a subscriber."""

    def __init__(self, publisher: Publisher) -> None:
        super().__init__(publisher, VIDEO, f"application/octet-stream;{VIDEO_SCHEMA}", PACKET_CAPACITY)

    @override
    def send(self, item: Outgoing) -> None:
        header = video_header(item.frame, self.publisher.settings.key, self.publisher.utc_ns())
        self.put(bytes(item.frame.data), item.stamp.attachment(header))
        self.settle(item)


MEDIA_SENDERS: dict[str, Callable[[Publisher], Sender]] = {
    FRAME: FrameSender,
    MOSAIC: MosaicSender,
    VIDEO: VideoSender,
}

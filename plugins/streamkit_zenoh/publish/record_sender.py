"""RecordSender: the track record of each frame at KEY/tracks, and of each target at KEY/track/ID."""

import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import msgspec
import zenoh

from streamkit import SHOWN_STATES, TRACKS_CAPS, Frame, StreamError, TrackRecord, record_line, track_record
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_zenoh.keys import TRACK, TRACKS
from streamkit_zenoh.presence import is_matching
from streamkit_zenoh.publish.numbered_stream import NumberedStream, Reply
from streamkit_zenoh.publish.settings import PublicationSettings, parse_qos
from streamkit_zenoh.wire.encodings import Codec, Encoding
from streamkit_zenoh.wire.numbering import Stamp
from streamkit_zenoh.wire.records import without_pixels


@dataclass(frozen=True, slots=True, eq=False)
class Outgoing:
    """A frame whose record is to be published; the record is made in the sending thread."""

    frame: Frame
    stamp: Stamp
    made_ns: int


class RecordSender:
    """Numbers frames, and makes and publishes their records in a thread of its own.

    A record without subscriber is made only when a query asks for it.

    Args:
        session: an open session.
        stream: of KEY/tracks.
        codec: of the records.
        settings: what to publish.
        utc_ns: the clock.
        failed: called in the thread with what sending raised.
        publish_status: called in the thread once a second, and before the first record.

    Attributes:
        age_ms: from capture to publishing, of the last record sent.
        targets: number of targets in the last record sent.
        frames: frames received.
        last_frame: the last frame received, without pixels.
        executor: the thread.
    """

    def __init__(
        self,
        session: zenoh.Session,
        stream: NumberedStream,
        codec: Codec[TrackRecord],
        settings: PublicationSettings,
        utc_ns: Callable[[], int],
        failed: Callable[[Exception], None],
        publish_status: Callable[[], None],
    ) -> None:
        self._fault: Exception | None = None
        self.age_ms: float | None = None
        self.targets = 0
        self.frames = 0
        self._session = session
        self._stream = stream
        self._track_key = stream.key.removesuffix(TRACKS) + TRACK
        self._codec = codec
        self._settings = settings
        self._track_qos = parse_qos(settings.track_qos)
        # Never dropped: receivers would keep an ended target forever.
        self._delete_qos = replace(self._track_qos, congestion=zenoh.CongestionControl.BLOCK)
        self._utc_ns = utc_ns
        self._last: Outgoing | None = None
        self._last_settled: Outgoing | None = None
        self._shown: set[int] = set()
        self._lost = 0
        self._has_track_subscriber = False
        if settings.track:
            self._track_publisher = session.declare_publisher(f"{self._track_key}/*")
            handler = zenoh.handlers.Callback(self._matching_changed, indirect=False)
            self._listener = self._track_publisher.declare_matching_listener(handler)
            self._has_track_subscriber |= is_matching(self._track_publisher)
        self._failed = failed
        self._publish_status = publish_status
        self._has_begun = False
        self.executor = BackgroundExecutor(
            "zenoh records", self._not_sent, capacity=settings.max_queue, periodic=publish_status
        )

    def submit(self, frame: Frame, cancelled: threading.Event) -> None:
        """Queues a frame if there is a subscriber; a full queue drops the oldest, after `patience_s`.

        Raises:
            ValueError: a track of an earlier frame is not finite.
            StreamError: the data of an earlier frame with record caps is no record.
            ResourceError: another publisher has taken the key.
        """
        self.raise_fault()
        self.frames += 1
        self._last = item = Outgoing(without_pixels(frame), self._stream.stamp(), self._utc_ns())
        if not (self._stream.has_subscriber or self._has_track_subscriber):
            self._last_settled = item
            self._stream.settle(item.stamp)
            return
        patience_s = self._settings.patience_s
        if dropped := self.executor.submit_dropping(lambda: self._send(item), patience_s, cancelled):
            self.count_lost(dropped, "queue full")

    @property
    def last_frame(self) -> Frame | None:
        """The last frame received, without pixels."""
        return None if self._last is None else self._last.frame

    def end_with(self, fault: Exception) -> None:
        """Ends the stream: the next frame raises this, or what was given before it."""
        self._fault = self._fault or fault

    def raise_fault(self) -> None:
        """Raises why the stream must end, once: a record that could not be made, or a key that was taken."""
        fault, self._fault = self._fault, None
        if fault is not None:
            raise fault

    def count_lost(self, count: int, reason: str) -> None:
        """Counts records that were not sent; the next record holds their number."""
        self._lost += count
        self._stream.count_drop(reason, count)

    def end_tracks(self) -> None:
        """Deletes the keys of all targets."""
        if self._last is not None and self._shown:
            stamp = self._last.stamp
            self._delete(self._shown, stamp._replace(number=stamp.number + 1).attachment())
            self._shown = set()

    def replies(self, asked: zenoh.KeyExpr) -> Iterable[Reply]:
        """The last record sent, and that of each of its targets, for a query that matches their keys.

        A queued record is no reply: it would overtake the records before it.
        """
        item = self._last_settled
        if item is None:
            return
        attachment, encoding = item.stamp.attachment(), self._stream.encoding
        if self._settings.tracks and asked.intersects(self._stream.key):
            payload = self._payload(item, self._record(item, item.made_ns))
            yield Reply(self._stream.key, payload, encoding, attachment)
        if self._settings.track and asked.intersects(f"{self._track_key}/*"):
            for key, payload in self._track_payloads(self._record(item, item.made_ns)):
                if asked.intersects(key):
                    yield Reply(key, payload, encoding, attachment)

    def _send(self, item: Outgoing) -> None:
        try:
            record = self._record(item, self._utc_ns())
            payload = self._payload(item, record)
        except (ValueError, StreamError) as error:
            self.end_with(error)
            return
        attachment = item.stamp.attachment()
        if not self._has_begun:
            # Before the first record: a receiver then knows that a publisher without `ended` was cut off.
            self._has_begun = True
            self._publish_status()
        if self._settings.tracks and self._stream.has_subscriber:
            self._stream.put(payload, attachment)
        if self._has_track_subscriber:
            self._send_tracks(record, attachment)
        self._last_settled = item
        self._stream.settle(item.stamp)
        self.age_ms, self.targets = record.age_ms, len(record.tracks)

    def _send_tracks(self, record: TrackRecord, attachment: bytes) -> None:
        options = self._track_qos.options()
        for key, payload in self._track_payloads(record):
            self._session.put(key, payload, encoding=self._stream.encoding, attachment=attachment, **options)
        shown = {target.id for target in record.tracks if target.state in SHOWN_STATES}
        self._delete(self._shown - shown, attachment)
        self._shown = shown

    def _delete(self, ids: Iterable[int], attachment: bytes) -> None:
        for number in sorted(ids):
            self._session.delete(
                f"{self._track_key}/{number}", attachment=attachment, **self._delete_qos.options()
            )

    def _track_payloads(self, record: TrackRecord) -> Iterable[tuple[str, bytes]]:
        """Key and payload of each target: the same record, with this target alone."""
        for target in record.tracks:
            if target.state in SHOWN_STATES:
                alone = msgspec.structs.replace(record, tracks=(target,))
                yield f"{self._track_key}/{target.id}", self._codec.encode(alone)

    def _record(self, item: Outgoing, published_ns: int) -> TrackRecord:
        return track_record(
            item.frame,
            source=self._settings.key,
            published_ns=published_ns,
            dropped=self._lost,
            ground_altitude_m=self._settings.ground_altitude,
            provenance=self._settings.provenance,
        )

    def _payload(self, item: Outgoing, record: TrackRecord) -> bytes:
        if item.frame.caps.name == TRACKS_CAPS.name and self._codec.encoding is Encoding.JSON:
            return record_line(item.frame)
        return self._codec.encode(record)

    def _not_sent(self, error: Exception) -> None:
        self.count_lost(1, "not sent")
        self._failed(error)

    def _matching_changed(self, status: zenoh.MatchingStatus) -> None:
        self._has_track_subscriber = status.matching

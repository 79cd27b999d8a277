"""From frames to the records that are published: KEY/tracks, and KEY/track/ID for each target."""

import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import msgspec
import zenoh

from streamkit import TRACKS_CAPS, Frame, StreamError, TrackRecord, TrackState, record_line, track_record
from streamkit_zenoh.keys import RECORDS, TRACK
from streamkit_zenoh.publish.answers import Answer
from streamkit_zenoh.publish.line import SendingLine
from streamkit_zenoh.publish.outlet import Outlet
from streamkit_zenoh.publish.quality import Quality
from streamkit_zenoh.wire.forms import Codec, Form
from streamkit_zenoh.wire.numbering import Stamp
from streamkit_zenoh.wire.records import without_pixels

SHOWN = (TrackState.CONFIRMED, TrackState.COASTING)


@dataclass(frozen=True, slots=True, eq=False)
class Outgoing:
    """A frame whose record is to be sent: made in the sending thread, for the stream not to wait for it."""

    frame: Frame
    stamp: Stamp
    made_ns: int


@dataclass(frozen=True)
class FeedSettings:
    """How records are published.

    Attributes:
        source: named in the records.
        tracks: whether KEY/tracks is published.
        each: whether KEY/track/ID is published.
        patience_s: how long a frame may wait for room in the line.
        max_queue: most records that wait.
        each_quality: quality of service of KEY/track/ID.
        ground_altitude_m: of the ground that is looked at, or None.
    """

    source: str
    tracks: bool
    each: bool
    patience_s: float
    max_queue: int
    each_quality: Quality
    ground_altitude_m: float | None = None


class RecordsFeed:
    """Numbers, lines up, makes and sends records.

    A frame costs the stream little: what its record needs is set aside, and the rest is done in the sending
    thread, where somebody listens; where nobody does, the record is only made when it is asked for.

    Attributes:
        fault: why a record could not be made; the stream is to end with it.
        age_ms: from capture to publishing, of the last record sent.
        targets: in the last record made.
        frames: that came in.
    """

    def __init__(
        self,
        session: zenoh.Session,
        outlet: Outlet,
        watcher: zenoh.Publisher | None,
        codec: Codec[TrackRecord],
        settings: FeedSettings,
        utc_ns: Callable[[], int],
        failed: Callable[[Exception], None],
        tick: Callable[[], None],
    ) -> None:
        self.fault: Exception | None = None
        self.age_ms: float | None = None
        self.targets = 0
        self.frames = 0
        self._session = session
        self._outlet = outlet
        self._root = outlet.key.removesuffix(f"/{RECORDS}")
        self._codec = codec
        self._settings = settings
        self._utc_ns = utc_ns
        self._last: Outgoing | None = None
        self._answerable: Outgoing | None = None
        self._shown: set[int] = set()
        self._lost = 0
        self._each_is_wanted = False
        if watcher is not None:
            self._watch = watcher.declare_matching_listener(
                zenoh.handlers.Callback(self._each_changed, indirect=False)
            )
            if getattr(watcher.matching_status, "matching", False):
                self._each_is_wanted = True
        self._failed = failed
        self._tick = tick
        self._has_told = False
        self.line: SendingLine[Outgoing] = SendingLine(
            self._send, settings.max_queue, self._not_sent, tick, tick_every_s=1.0
        )

    def submit(self, frame: Frame, cancelled: threading.Event) -> int:
        """Lines a frame up, where anybody listens; how many were dropped for it.

        Raises:
            ValueError: the record of an earlier frame could not be made, as its tracks have no place.
            StreamError: an earlier frame said that it was a record, and was none.
        """
        if self.fault is not None:
            self.demand_sound()
        self.frames += 1
        self._last = item = Outgoing(without_pixels(frame), self._outlet.stamp(), self._utc_ns())
        if not (self._outlet.is_wanted or self._each_is_wanted):
            self._answerable = item
            self._outlet.settle(item.stamp)
            return 0
        return self.line.submit(item, self._settings.patience_s, cancelled)

    @property
    def last_frame(self) -> Frame | None:
        """The last frame that came in, without its picture."""
        return None if self._last is None else self._last.frame

    def demand_sound(self) -> None:
        """Raises why a record could not be made, once."""
        fault, self.fault = self.fault, None
        if fault is not None:
            raise fault

    def count_lost(self, count: int, reason: str) -> None:
        """Counts records that were not sent; the next record tells their number."""
        self._lost += count
        self._outlet.count_drop(reason, count)

    def end_tracks(self) -> None:
        """Deletes what is shown of each target: none is followed any more."""
        last = self._last
        if last is not None and self._shown:
            behind = last.stamp._replace(number=last.stamp.number + 1)
            self._delete(self._shown, behind.attachment())
            self._shown = set()

    def answers(self, asked: zenoh.KeyExpr) -> Iterable[Answer]:
        """The last record, and that of each target, where they are asked for.

        What still waits to be sent is no answer: it would overtake the records before it.
        """
        item = self._answerable
        if item is None:
            return
        attachment, encoding = item.stamp.attachment(), self._outlet.encoding
        if self._settings.tracks and asked.intersects(self._outlet.key):
            payload = self._payload(item, item.made_ns)[1]
            yield Answer(self._outlet.key, payload, encoding, attachment)
        if self._settings.each and asked.intersects(f"{self._root}/{TRACK}/*"):
            for key, payload in self._of_each(self._record(item, item.made_ns)):
                if asked.intersects(key):
                    yield Answer(key, payload, encoding, attachment)

    def _send(self, item: Outgoing) -> None:
        try:
            record, payload = self._payload(item, self._utc_ns())
        except (ValueError, StreamError) as error:
            self.fault = self.fault or error
            return
        attachment = item.stamp.attachment()
        if not self._has_told:
            # Before the first record: whoever has a record and then nothing knows that this is no end.
            self._has_told = True
            self._tick()
        if self._settings.tracks and self._outlet.is_wanted:
            self._outlet.put(payload, attachment)
        if self._each_is_wanted:
            self._send_each(record, attachment)
        self._answerable = item
        self._outlet.settle(item.stamp)
        self.age_ms, self.targets = record.age_ms, len(record.tracks)

    def _send_each(self, record: TrackRecord, attachment: bytes) -> None:
        quality = self._settings.each_quality
        for key, payload in self._of_each(record):
            self._session.put(
                key,
                payload,
                encoding=self._outlet.encoding,
                congestion_control=quality.congestion,
                priority=quality.priority,
                express=quality.express,
                attachment=attachment,
            )
        shown = {target.id for target in record.tracks if target.state in SHOWN}
        self._delete(self._shown - shown, attachment)
        self._shown = shown

    def _delete(self, ids: Iterable[int], attachment: bytes) -> None:
        quality = self._settings.each_quality
        for number in sorted(ids):
            # Never thrown away: a target that has ended would be shown for ever.
            self._session.delete(
                f"{self._root}/{TRACK}/{number}",
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=quality.priority,
                express=quality.express,
                attachment=attachment,
            )

    def _of_each(self, record: TrackRecord) -> Iterable[tuple[str, bytes]]:
        """Key and payload of each target: the same record, with this target alone."""
        for target in record.tracks:
            if target.state in SHOWN:
                alone = msgspec.structs.replace(record, tracks=(target,))
                yield f"{self._root}/{TRACK}/{target.id}", self._codec.encode(alone)

    def _record(self, item: Outgoing, published_ns: int) -> TrackRecord:
        settings = self._settings
        return track_record(
            item.frame,
            source=settings.source,
            published_ns=published_ns,
            dropped=self._lost,
            ground_altitude_m=settings.ground_altitude_m,
        )

    def _payload(self, item: Outgoing, published_ns: int) -> tuple[TrackRecord, bytes]:
        record = self._record(item, published_ns)
        if item.frame.caps.name == TRACKS_CAPS.name and self._codec.form is Form.JSON:
            return record, record_line(item.frame)
        return record, self._codec.encode(record)

    def _not_sent(self, error: Exception) -> None:
        self.count_lost(1, "not sent")
        self._failed(error)

    def _each_changed(self, status: zenoh.MatchingStatus) -> None:
        self._each_is_wanted = status.matching

"""Everything that is published below one key, put together."""

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import zenoh

from streamkit import TrackRecord
from streamkit_zenoh.keys import FRAME, LISTENING, MOSAIC, RECORDS, SCHEMA, STATUS, TRACK, listens_to
from streamkit_zenoh.presence import show_publisher, wait_until_taken, watch_receivers
from streamkit_zenoh.publish.answers import Answer, Answers, schema_answers
from streamkit_zenoh.publish.outlet import Outlet
from streamkit_zenoh.publish.picture_feed import PictureFeed, PictureSettings
from streamkit_zenoh.publish.quality import Quality
from streamkit_zenoh.publish.records_feed import FeedSettings, RecordsFeed
from streamkit_zenoh.session import close_session
from streamkit_zenoh.wire.forms import Codec, Form
from streamkit_zenoh.wire.pictures import PictureFormat
from streamkit_zenoh.wire.records import TRACKS_SCHEMA
from streamkit_zenoh.wire.status import STATUS_SCHEMA, StatusRecord

JOIN_LIMIT_S = 1.0


@dataclass(frozen=True, kw_only=True)
class PublicationSettings:
    """What is published below `root`, and how; see the properties of zenohsink."""

    root: str
    source: str
    form: Form
    tracks: bool
    track: bool
    status: bool
    frame_every_ns: int
    has_frame: bool
    has_mosaic: bool
    frame_width: int
    frame_format: PictureFormat
    mosaic_format: PictureFormat
    picture_quality: int
    max_queue: int
    patience_s: float
    cut_off_s: float
    ground_altitude_m: float | None
    qualities: Mapping[str, Quality]


class Publication:
    """The streams of one publisher, its answers, and the token that shows that it lives.

    Args:
        session: an open session; closed by `close`.
        settings: what to publish.
        utc_ns: the clock.
        failed: called with what went wrong, from the sending threads.

    Attributes:
        tracks: the outlet of the records.
        records: takes frames for their records.
        pictures: takes frames for their pictures, or None.
        mosaics: takes mosaics, or None.
        receivers: watches who listens.
    """

    def __init__(
        self,
        session: zenoh.Session,
        settings: PublicationSettings,
        utc_ns: Callable[[], int],
        failed: Callable[[Exception], None],
    ) -> None:
        self._session = session
        self._settings = settings
        self._utc_ns = utc_ns
        self._began_s = time.monotonic()
        self._run = utc_ns()
        self._has_ended = False
        # Made first: where a library is missing, nothing has been declared yet.
        records = Codec(TrackRecord, TRACKS_SCHEMA, settings.form)
        self._status_codec = Codec(StatusRecord, STATUS_SCHEMA, settings.form)
        self.tracks = self._outlet(RECORDS, records.encoding)
        self._status = self._outlet(STATUS, self._status_codec.encoding) if settings.status else None
        self._each = session.declare_publisher(f"{settings.root}/{TRACK}/*") if settings.track else None
        self.records = RecordsFeed(
            session, self.tracks, self._each, records, self._feed_settings(), utc_ns, failed, self._tick
        )
        self.pictures = self._picture_feed(FRAME, failed) if settings.has_frame else None
        self.mosaics = self._picture_feed(MOSAIC, failed) if settings.has_mosaic else None
        self.receivers = watch_receivers(session, self._receiver_appeared)
        self._answers = self._answer(failed)
        # The token is left to the session's close: its end must not overtake the last records.
        self._alive = show_publisher(session, self.tracks.key)

    def flush(self, patience_s: float, cancelled: threading.Event) -> int:
        """Waits until everything is sent; how many messages are left."""
        left = self.records.line.flush(patience_s, cancelled)
        for feed in (self.pictures, self.mosaics):
            if feed is not None:
                left += feed.line.flush(patience_s, cancelled)
        if not left and not cancelled.is_set():
            self.records.end_tracks()
        self._end()
        wait_until_taken(self._session, self.tracks.key, self.receivers, patience_s, cancelled)
        return left

    def _end(self) -> None:
        """Tells once that the stream has ended."""
        if not self._has_ended:
            self._has_ended = True
            self._tick()

    def close(self, limit_s: float, cancelled: threading.Event | None = None) -> bool:
        """Ends all streams and the session; whether that was done within the limit."""
        left = self.records.line.close()
        if left:
            self.records.count_lost(left, "not sent before the end")
        lines = [self.records.line]
        for feed in (self.pictures, self.mosaics):
            if feed is not None:
                feed.line.close()
        outlets = [outlet for outlet in (*self._outlets(), self._status) if outlet is not None]
        undeclare: list[Callable[[], object]] = [self._end, self.receivers.close, self._answers.close]
        undeclare += [outlet.close for outlet in outlets]
        is_closed = close_session(self._session, limit_s, cancelled, undeclare)
        for feed in (self.pictures, self.mosaics):
            if feed is not None:
                is_closed &= feed.line.join(JOIN_LIMIT_S)
        return all(line.join(JOIN_LIMIT_S) for line in lines) and is_closed

    def drops(self) -> Iterator[tuple[str, str, int]]:
        """Stream, reason and number of what was not delivered."""
        for outlet in self._outlets():
            for drop in outlet.drop_counts():
                yield drop.stream, drop.reason, drop.count

    def _outlets(self) -> list[Outlet]:
        feeds = (self.pictures, self.mosaics)
        return [self.tracks, *(feed.outlet for feed in feeds if feed is not None)]

    def _outlet(self, name: str, encoding: str) -> Outlet:
        key = f"{self._settings.root}/{name}" if self._settings.root else name
        return Outlet(
            self._session,
            key,
            name,
            self._run,
            encoding,
            self._settings.qualities[name],
            self._settings.cut_off_s,
        )

    def _feed_settings(self) -> FeedSettings:
        settings = self._settings
        return FeedSettings(
            settings.source,
            settings.tracks,
            settings.track,
            settings.patience_s,
            settings.max_queue,
            settings.qualities[TRACK],
            settings.ground_altitude_m,
        )

    def _picture_feed(self, name: str, failed: Callable[[Exception], None]) -> PictureFeed:
        settings = self._settings
        is_frame = name == FRAME
        form = settings.frame_format if is_frame else settings.mosaic_format
        chosen = PictureSettings(
            settings.source,
            form,
            settings.picture_quality,
            settings.frame_width if is_frame else 0,
            settings.frame_every_ns if is_frame else 0,
            on_change=not is_frame,
        )
        outlet = self._outlet(name, f"image/{form};streamkit.frame/1")
        return PictureFeed(outlet, chosen, self._utc_ns, failed)

    def _answer(self, failed: Callable[[Exception], None]) -> Answers:
        answers = Answers(self._session, self._settings.root, failed)
        answers.add(self.records.answers)
        for feed in (self.pictures, self.mosaics):
            if feed is not None:
                answers.add(feed.answers)
        answers.add_personal(self._status_answer)
        root = f"{self._settings.root}/{SCHEMA}"
        answers.add(lambda asked: schema_answers(asked, root))
        return answers

    def _receiver_appeared(self, token: str) -> None:
        name = token.removeprefix(f"{LISTENING}/")
        for outlet in self._outlets():
            if listens_to(token, outlet.key):
                outlet.receiver_appeared(name)

    def _status_answer(self, asked: zenoh.KeyExpr, receiver: str | None) -> Iterable[Answer]:
        if self._status is not None and asked.intersects(self._status.key):
            # Whoever asks listens already: from the next number on, everything is sent to it.
            self.tracks.look()
            payload = self._status_codec.encode(self._status_record(receiver))
            yield Answer(self._status.key, payload, self._status.encoding)

    def _tick(self) -> None:
        if self._status is None:
            return
        self._status.look()
        if self._status.is_wanted:
            payload = self._status_codec.encode(self._status_record())
            self._status.put(payload, self._status.stamp().attachment())

    def _status_record(self, receiver: str | None = None) -> StatusRecord:
        frame, frames = self.records.last_frame, self.records.frames
        playing: Literal["starting", "playing"] = "playing" if frames else "starting"
        return StatusRecord(
            schema=STATUS_SCHEMA,
            source=self._settings.source,
            state="ended" if self._has_ended else playing,
            run=self._run,
            published_ns=self._utc_ns(),
            uptime_s=round(time.monotonic() - self._began_s, 3),
            frames=frames,
            seq=None if frame is None else frame.seq,
            epoch=None if frame is None else frame.epoch,
            tracks=self.records.targets,
            age_ms=self.records.age_ms,
            streams=tuple(outlet.status(receiver) for outlet in self._outlets()),
            drops=tuple(drop for outlet in self._outlets() for drop in outlet.drop_counts()),
        )

"""Publication: all streams of one publisher, its replies to queries, and its liveliness token."""

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Literal

import zenoh

from streamkit import Element, ResourceError, TrackRecord
from streamkit_zenoh.keys import LISTENING, MOSAIC, RECEIVER, SCHEMA, STATUS, TRACKS, VIDEO, listens_to
from streamkit_zenoh.presence import declare_publisher_token, wait_until_delivered, watch_receivers
from streamkit_zenoh.publish.control import Control
from streamkit_zenoh.publish.media_sender import FrameSender, MediaSender, VideoSender
from streamkit_zenoh.publish.numbered_stream import NumberedStream, Reply
from streamkit_zenoh.publish.record_sender import RecordSender
from streamkit_zenoh.publish.rivals import EXCLUSIVE, Claimant, KeyInUse, RivalWatch, refuse_rivals
from streamkit_zenoh.publish.settings import PublicationSettings
from streamkit_zenoh.session import close_session
from streamkit_zenoh.wire.encodings import Codec
from streamkit_zenoh.wire.frame_header import FRAME_SCHEMA
from streamkit_zenoh.wire.records import TRACKS_SCHEMA
from streamkit_zenoh.wire.schemas import schema_files, schema_index
from streamkit_zenoh.wire.status import STATUS_SCHEMA, ElementStatus, StatusRecord
from streamkit_zenoh.wire.video_header import VIDEO_SCHEMA

JOIN_LIMIT_S = 1.0


class Publication:
    """The streams of one publisher.

    Args:
        session: an open session; closed by `close`.
        root: the key below which everything is published.
        settings: what to publish.
        media: which of `frame`, `mosaic` and `video` to publish.
        utc_ns: the clock.
        failed: called with what went wrong, from any thread.
        dropped: called with stream and reason, and the number of messages not delivered, from any thread.
        cancelled: ends a wait for another publisher at the key.
        elements: gives the elements that can be controlled.
        statuses: gives what the elements have done so far.

    Attributes:
        tracks: stream of the records.
        records: takes frames for their records.
        media: takes frames for their images, and coded packets, by stream.
        receivers: watches the tokens of receivers.

    Raises:
        InvalidQos: a quality of service is malformed.
        MissingLibrary: the encoding's library is not installed.
        KeyInUse: another publisher is at the key. Before any of these, nothing is declared.
    """

    def __init__(
        self,
        session: zenoh.Session,
        root: str,
        settings: PublicationSettings,
        media: Iterable[str],
        utc_ns: Callable[[], int],
        failed: Callable[[Exception], None],
        dropped: Callable[[str, int], object],
        cancelled: threading.Event,
        elements: Callable[[], Sequence[Element]],
        statuses: Callable[[], tuple[ElementStatus, ...]],
    ) -> None:
        self._statuses = statuses
        self._qos = settings.qos()
        codec = Codec(TrackRecord, TRACKS_SCHEMA, settings.encoding)
        self._status_codec = Codec(StatusRecord, STATUS_SCHEMA, settings.encoding)
        if settings.claim == EXCLUSIVE:
            refuse_rivals(session, root, cancelled)
        self._session = session
        self._root = root
        self._settings = settings
        self._utc_ns = utc_ns
        self._failed, self._dropped = failed, dropped
        self._began_s = time.monotonic()
        self._run = utc_ns()
        self._has_ended = False
        self.tracks = self._stream(TRACKS, codec.content_type)
        self._status = self._stream(STATUS, self._status_codec.content_type) if settings.status else None
        self.records = RecordSender(
            session, self.tracks, codec, settings, utc_ns, failed, self._publish_status
        )
        self.media = {name: self._media_sender(name) for name in media}
        self._executors = [self.records.executor, *(sender.executor for sender in self.media.values())]
        self._control = Control(session, root, elements, failed) if settings.control else None
        if self._control is not None:
            self._executors.append(self._control.executor)
        self.receivers = watch_receivers(session, self._receiver_appeared)
        handler = zenoh.handlers.Callback(self._reply, indirect=False)
        self._queryable = session.declare_queryable(f"{root}/**", handler)
        # Closing the session removes the token; undeclared alone, its end could overtake the last records.
        self._token = declare_publisher_token(session, self.tracks.key)
        self._rivals = RivalWatch(session, root, Claimant.here(settings.claim, self._run), self._give_way)

    def flush(self, patience_s: float, cancelled: threading.Event) -> int:
        """Waits until everything is sent and delivered; returns how many messages are left."""
        left = sum(executor.wait_idle(patience_s, cancelled) for executor in self._executors)
        if not left and not cancelled.is_set():
            self.records.end_tracks()
        self._publish_end()
        wait_until_delivered(self._session, self.tracks.key, self.receivers, patience_s, cancelled)
        return left

    def close(self, limit_s: float, cancelled: threading.Event | None = None) -> bool:
        """Ends all streams and the session; returns whether that was done within the limit."""
        senders: list[RecordSender | MediaSender] = [self.records, *self.media.values()]
        for sender in senders:
            if left := sender.executor.abandon():
                sender.count_lost(left, "not sent before the end")
        if self._control is not None:
            self._control.executor.abandon()
        streams = [*self._streams(), *([] if self._status is None else [self._status])]
        undeclare: list[Callable[[], object]] = [
            self._publish_end,
            self.receivers.close,
            self._rivals.close,
            self._queryable.undeclare,
            *([] if self._control is None else [self._control.close]),
            *(stream.close for stream in streams),
        ]
        is_closed = close_session(self._session, limit_s, cancelled, undeclare)
        ended = [executor.close(JOIN_LIMIT_S) for executor in self._executors]
        return is_closed and all(ended)

    def _streams(self) -> list[NumberedStream]:
        return [self.tracks, *(sender.stream for sender in self.media.values())]

    def _stream(self, name: str, content_type: str) -> NumberedStream:
        cut_off_s = self._settings.cut_off_s
        return NumberedStream(
            self._session,
            self._root,
            name,
            self._run,
            content_type,
            self._qos[name],
            cut_off_s,
            self._dropped,
        )

    def _media_sender(self, name: str) -> MediaSender:
        settings = self._settings
        image_format = settings.mosaic_format if name == MOSAIC else settings.frame_format
        is_video = name == VIDEO
        content = (
            f"application/octet-stream;{VIDEO_SCHEMA}" if is_video else f"image/{image_format};{FRAME_SCHEMA}"
        )
        kind = VideoSender if is_video else FrameSender
        return kind(self._stream(name, content), settings, self._utc_ns, self._failed)

    def _give_way(self, reason: KeyInUse) -> None:
        """Ends this publisher at its next frame."""
        self.records.end_with(ResourceError(str(reason)))
        self._failed(reason)

    def _receiver_appeared(self, token: str) -> None:
        name = token.removeprefix(f"{LISTENING}/")
        for stream in self._streams():
            if listens_to(token, stream.key):
                stream.add_receiver(name)

    def _reply(self, query: zenoh.Query) -> None:
        """Sends the last message of each key that a query matches, for receivers that come late."""
        with query:
            asked = query.key_expr
            media = (sender.replies(asked) for sender in self.media.values())
            status = self._status_reply(asked, query.parameters.get(RECEIVER))
            schemas = schema_replies(asked, f"{self._root}/{SCHEMA}")
            for replies in (self.records.replies(asked), *media, status, schemas):
                try:
                    for key, payload, encoding, attachment in replies:
                        query.reply(key, payload, encoding=encoding, attachment=attachment)
                except Exception as error:
                    self._failed(error)

    def _status_reply(self, asked: zenoh.KeyExpr, receiver: str | None) -> Iterable[Reply]:
        if self._status is not None and asked.intersects(self._status.key):
            # The asking receiver has subscribed: from the next number on, it is sent everything.
            self.tracks.refresh()
            payload = self._status_codec.encode(self._status_record(receiver))
            yield Reply(self._status.key, payload, self._status.encoding)

    def _publish_end(self) -> None:
        if not self._has_ended:
            self._has_ended = True
            self._publish_status()

    def _publish_status(self) -> None:
        if self._status is None:
            return
        self._status.refresh()
        if self._status.has_subscriber:
            payload = self._status_codec.encode(self._status_record())
            self._status.put(payload, self._status.stamp().attachment())

    def _status_record(self, receiver: str | None = None) -> StatusRecord:
        frame, frames = self.records.last_frame, self.records.frames
        playing: Literal["starting", "playing"] = "playing" if frames else "starting"
        return StatusRecord(
            schema=STATUS_SCHEMA,
            source=self._settings.key,
            state="ended" if self._has_ended else playing,
            run=self._run,
            published_ns=self._utc_ns(),
            uptime_s=round(time.monotonic() - self._began_s, 3),
            frames=frames,
            seq=None if frame is None else frame.seq,
            epoch=None if frame is None else frame.epoch,
            tracks=self.records.targets,
            age_ms=self.records.age_ms,
            streams=tuple(stream.status(receiver) for stream in self._streams()),
            drops=tuple(drop for stream in self._streams() for drop in stream.drop_counts()),
            control=self._control is not None,
            changes=() if self._control is None else self._control.changes(),
            elements=self._statuses(),
        )


def schema_replies(asked: zenoh.KeyExpr, root: str) -> Iterable[Reply]:
    """Replies with all schemas at `root` itself, and with each file at `root/NAME`."""
    if asked.intersects(root):
        yield Reply(root, schema_index(), zenoh.Encoding.APPLICATION_JSON)
    for name, content in schema_files().items():
        if asked.intersects(f"{root}/{name}"):
            media_type = "application/schema+json" if name.endswith(".json") else "text/plain"
            yield Reply(f"{root}/{name}", content, zenoh.Encoding(media_type))

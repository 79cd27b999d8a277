"""Publication: all streams of one publisher, its replies to queries, and its liveliness token."""

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Literal

import zenoh

from streamkit import Element, ResourceError
from streamkit_zenoh.keys import LISTENING, RECEIVER, SCHEMA, STATUS, alive_key, listens_to
from streamkit_zenoh.presence import (
    EXCLUSIVE,
    Claimant,
    KeyInUse,
    LivelinessWatch,
    RivalWatch,
    refuse_rivals,
    wait_until_delivered,
)
from streamkit_zenoh.publish.control import Control
from streamkit_zenoh.publish.numbered_stream import NumberedStream, Publisher, Reply, Sender
from streamkit_zenoh.publish.senders import MEDIA_SENDERS, RecordSender
from streamkit_zenoh.session import close_session
from streamkit_zenoh.wire.encodings import Codec
from streamkit_zenoh.wire.messages import (
    STATUS_SCHEMA,
    ElementStatus,
    StatusRecord,
    schema_files,
    schema_index,
)

JOIN_LIMIT_S = 1.0


class Publication:
    """The streams of one publisher; `close` closes its session, too.

    Args:
        publisher: who publishes.
        media: which of `frame`, `mosaic` and `video` to publish.
        elements: gives the elements that can be controlled.
        statuses: gives what the elements have done so far.

    Attributes:
        records: takes frames for their records.
        media: takes frames for their images, and coded packets, by stream.
        receivers: watches the tokens of receivers.
        session: that of the publisher.

    Raises:
        InvalidQos: a quality of service is malformed.
        MissingLibrary: the encoding's library is not installed.
        KeyInUse: another publisher is at the key. Before any of these, nothing is declared.
    """

    def __init__(
        self,
        publisher: Publisher,
        media: Iterable[str],
        elements: Callable[[], Sequence[Element]],
        statuses: Callable[[], tuple[ElementStatus, ...]],
    ) -> None:
        session, root, settings = publisher.session, publisher.root, publisher.settings
        settings.qos()
        self._status_codec = Codec(StatusRecord, STATUS_SCHEMA, settings.encoding)
        if settings.claim == EXCLUSIVE:
            refuse_rivals(session, root, publisher.cancelled)
        self.session, self._publisher, self._statuses = session, publisher, statuses
        self._began_s = time.monotonic()
        self._has_ended = False
        status = (
            NumberedStream(publisher, STATUS, self._status_codec.content_type) if settings.status else None
        )
        self._status = status
        self.records = RecordSender(publisher, self._publish_status)
        self.media = {name: MEDIA_SENDERS[name](publisher) for name in media}
        self._senders: list[Sender] = [self.records, *self.media.values()]
        self._control = Control(publisher, elements) if settings.control else None
        self.receivers = LivelinessWatch(session, f"{LISTENING}/**", appeared=self._receiver_appeared)
        handler = zenoh.handlers.Callback(self._reply, indirect=False)
        self._queryable = session.declare_queryable(f"{root}/**", handler)
        # Closing the session removes the token; undeclared alone, its end could overtake the last records.
        self._token = session.liveliness().declare_token(alive_key(self.records.key))
        own = Claimant.here(settings.claim, publisher.run)
        self._rivals = RivalWatch(session, root, own, self._give_way)

    def drain(self) -> int:
        """Waits until everything is sent and delivered; returns how many messages are left."""
        patience_s, cancelled = self._publisher.settings.cut_off_s, self._publisher.cancelled
        left = sum(part.executor.wait_idle(patience_s, cancelled) for part in self._parts())
        if not left and not cancelled.is_set():
            self.records.end_tracks()
        self._publish_end()
        key = self.records.key
        wait_until_delivered(self.session, key, self.receivers, patience_s, cancelled)
        return left

    def close(self, limit_s: float, cancelled: threading.Event | None = None) -> bool:
        """Ends all streams and the session; returns whether that was done within the limit."""
        for part in self._parts():
            part.abandon()
        undeclare: list[Callable[[], object]] = [
            self._publish_end,
            self.receivers.close,
            self._rivals.close,
            self._queryable.undeclare,
            *(part.close for part in self._parts()),
        ]
        if self._status is not None:
            undeclare.append(self._status.close)
        is_closed = close_session(self.session, limit_s, cancelled, undeclare)
        ended = [part.executor.close(JOIN_LIMIT_S) for part in self._parts()]
        return is_closed and all(ended)

    def _parts(self) -> list[Sender | Control]:
        """What works in a thread of its own."""
        return [*self._senders, *([] if self._control is None else [self._control])]

    def _give_way(self, reason: KeyInUse) -> None:
        """Ends this publisher at its next frame."""
        self.records.end_with(ResourceError(str(reason)))
        self._publisher.failed(reason)

    def _receiver_appeared(self, token: str) -> None:
        name = token.removeprefix(f"{LISTENING}/")
        for sender in self._senders:
            if listens_to(token, sender.key):
                sender.add_receiver(name)

    def _reply(self, query: zenoh.Query) -> None:
        """Sends the last message of each key that a query matches, for receivers that come late."""
        with query:
            asked = query.key_expr
            replies = (
                *(sender.replies(asked) for sender in self._senders),
                self._status_reply(asked, query.parameters.get(RECEIVER)),
                schema_replies(asked, f"{self._publisher.root}/{SCHEMA}"),
            )
            for found in replies:
                try:
                    for key, payload, encoding, attachment in found:
                        query.reply(key, payload, encoding=encoding, attachment=attachment)
                except Exception as error:
                    self._publisher.failed(error)

    def _status_reply(self, asked: zenoh.KeyExpr, receiver: str | None) -> Iterable[Reply]:
        if self._status is not None and asked.intersects(self._status.key):
            # The asking receiver has subscribed: from the next number on, it is sent everything.
            payload = self._status_codec.encode(self._status_record(receiver))
            yield Reply(self._status.key, payload, self._status.encoding)

    def _publish_end(self) -> None:
        if not self._has_ended:
            self._has_ended = True
            self._publish_status()

    def _publish_status(self) -> None:
        if self._status is not None and self._status.has_subscriber:
            payload = self._status_codec.encode(self._status_record())
            self._status.put(payload, self._status.take_stamp().attachment())

    def _status_record(self, receiver: str | None = None) -> StatusRecord:
        records, frame = self.records, self.records.last_frame
        playing: Literal["starting", "playing"] = "starting" if frame is None else "playing"
        return StatusRecord(
            schema=STATUS_SCHEMA,
            source=self._publisher.settings.key,
            state="ended" if self._has_ended else playing,
            run=self._publisher.run,
            published_ns=self._publisher.utc_ns(),
            uptime_s=round(time.monotonic() - self._began_s, 3),
            frames=records.next_stamp.number,  # each frame has one, whether it is sent or not
            seq=None if frame is None else frame.seq,
            epoch=None if frame is None else frame.epoch,
            tracks=records.targets,
            age_ms=records.age_ms,
            streams=tuple(sender.status(receiver) for sender in self._senders),
            drops=tuple(drop for sender in self._senders for drop in sender.drop_counts()),
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

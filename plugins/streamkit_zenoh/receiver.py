"""MessageReceiver: receives the messages of a key expression, bounded, with losses counted."""

import threading
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import zenoh

from streamkit.handoff.bounded_queue import BoundedQueue
from streamkit_zenoh.keys import LISTENING, RECEIVER, STATUS, alive_key, listening_key, root_of
from streamkit_zenoh.presence import LivelinessWatch, declare_receiver
from streamkit_zenoh.wire.encodings import BadPayload, decode_message
from streamkit_zenoh.wire.messages import STATUS_SCHEMA, StatusRecord
from streamkit_zenoh.wire.numbering import (
    ATTACHMENT_LIMIT_BYTES,
    LossTracker,
    RecentDict,
    Stamp,
    read_attachment,
)

QUERY_LIMIT_S = 5.0
STATUS_LIMIT_BYTES = 64 * 1024
NO_STAMP = Stamp(0, 0)
JUMP_WARNING = (
    "message numbers jump by more than ten million: another sender uses the publisher's name, or the "
    "link was down for very long; where that matters, let only known senders in (docs/zenoh-security.md)"
)
INTERLEAVED_WARNING = (
    "two publishers use one key: messages of an earlier one come between those of a later one; "
    "end one of them, or give each a key of its own"
)


class PublisherStates:
    """The last reported state of each publisher of a key: running or ended."""

    def __init__(self) -> None:
        self._latest_run = 0  # of the records
        self._running: RecentDict[str, tuple[int, bool]] = RecentDict()
        self._awaits_status = False  # of a publisher that has appeared

    def note_appeared(self) -> None:
        """Notes that a publisher has appeared, which has not sent a status yet."""
        self._awaits_status = True

    def note_record(self, run: int) -> None:
        """Notes the run of a record."""
        self._latest_run = max(self._latest_run, run)

    def note_status(self, status: StatusRecord) -> None:
        """Notes a status; one of an earlier run, or a reply from before the end, may come after it."""
        self._awaits_status = False
        run, is_running = self._running.get(status.source, (status.run, True))
        if status.run > run or (status.run == run and is_running):
            self._running[status.source] = (status.run, status.state != "ended")

    def has_unended(self) -> bool:
        """Whether a publisher never said that it ends; False where none says anything of itself.

        One that is killed at its start has appeared, or sent records, and perhaps no status yet.
        """
        known = self._running.values()
        is_unknown = self._awaits_status or all(run < self._latest_run for run, _ in known)
        return bool(known) and (is_unknown or any(is_running for _, is_running in known))


class ReceivedMessage(NamedTuple):
    """A message.

    Attributes:
        key: where it was published.
        payload: its bytes.
        content_type: zenoh's encoding, `application/json;streamkit.tracks/1`.
        header: the attachment after the stamp.
        stamp: run and number, 0 without a stamp.
        is_deleted: whether it deletes the key.
        is_reply: whether it is the reply to a query for the publisher's last message, of any age.
    """

    key: str
    payload: bytes
    content_type: str
    header: bytes
    stamp: Stamp
    is_deleted: bool
    is_reply: bool


class Counts(msgspec.Struct, frozen=True):
    """Messages by what became of them.

    Attributes:
        received: received once or more.
        lost: gaps in the publishers' numbers.
        overwritten: dropped from the full queue for newer ones.
        repeated: received again; passed on once.
        bad: too large, or invalid; skipped.
        restarts: how often a publisher followed another.
        interleaved: of an earlier publisher, after the first of a later one at its key.
        jumps: steps of more than ten million numbers, not counted as losses: see `wire.numbering`.
        publishers: alive now.
    """

    received: int
    lost: int
    overwritten: int
    repeated: int
    bad: int
    restarts: int
    interleaved: int
    jumps: int
    publishers: int


class MessageReceiver:
    """Puts messages into a queue from zenoh's thread, which waits while a lossless queue is full.

    Args:
        session: an open session.
        expression: which keys, with wildcards and several publishers if need be.
        capacity, max_bytes: most messages and bytes in the queue.
        newest: whether a full queue drops the oldest message; else the publisher waits.
        limit_bytes: larger messages are bad.
        ask_last: whether to query the last message of each publisher.
        ends_with_publisher: whether the queue ends while no publisher is alive.

    Attributes:
        queue: the messages.
        undeclare: calls that undeclare everything.
    """

    def __init__(
        self,
        session: zenoh.Session,
        expression: str,
        *,
        capacity: int,
        max_bytes: int,
        newest: bool,
        limit_bytes: int,
        ask_last: bool,
        ends_with_publisher: bool,
    ) -> None:
        self.queue: BoundedQueue[ReceivedMessage] = BoundedQueue(capacity, max_bytes)
        self._wait_s = 0.0 if newest else None  # for room in a full queue; None has no limit
        self._session = session
        self._expression = expression
        self._limit_bytes = limit_bytes
        self._ask_last = ask_last
        self._ends_with_publisher = ends_with_publisher
        self._losses = LossTracker()
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()
        self._states = PublisherStates()
        status_key = f"{root_of(expression)}/{STATUS}"
        name = listening_key(str(session.info.zid()), expression).removeprefix(f"{LISTENING}/")
        self._status_selector = f"{status_key}?{RECEIVER}={name}"
        # First: a publisher that has a subscriber for its records has one for its last status, too.
        status = self._subscribe(status_key, self._status_published)
        subscriber = self._subscribe(expression, self._published)
        # Right after the subscription: from here on publishers count what they send to this receiver.
        presence = declare_receiver(session, expression)
        alive = LivelinessWatch(session, alive_key(expression), self._alive_changed)
        self.undeclare: list[Callable[[], object]] = [
            *presence, alive.close, status.undeclare, subscriber.undeclare,
        ]  # fmt: skip

    def _subscribe(self, key: str, take: Callable[[zenoh.Sample], None]) -> zenoh.Subscriber[None]:
        # Called in zenoh's own thread, so that no messages wait but those in the queue.
        return self._session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False))

    def counts(self) -> Counts:
        """What became of the messages so far."""
        with self._lock:
            return Counts(**{name: self._counts[name] for name in Counts.__struct_fields__})

    @property
    def has_vanished(self) -> bool:
        """Whether all publishers are gone and at least one never reported `ended`."""
        with self._lock:
            return not self._counts["publishers"] and self._states.has_unended()

    def warnings(self) -> list[str]:
        """What a user must know about the numbers so far."""
        counts = self.counts()
        found = {JUMP_WARNING: counts.jumps, INTERLEAVED_WARNING: counts.interleaved}
        return [text for text, count in found.items() if count]

    def count_bad(self) -> None:
        """Counts an invalid message."""
        with self._lock:
            self._counts["bad"] += 1

    def _published(self, sample: zenoh.Sample, is_reply: bool = False) -> None:
        attachment = sample.attachment
        raw = b"" if attachment is None or len(attachment) > ATTACHMENT_LIMIT_BYTES else attachment.to_bytes()
        stamp, header = read_attachment(raw)
        key, size = str(sample.key_expr), len(sample.payload)
        is_too_large = size > self._limit_bytes
        if not self._count(key, stamp, is_reply=is_reply, is_too_large=is_too_large):
            return
        message = ReceivedMessage(
            key,
            sample.payload.to_bytes(),
            str(sample.encoding),
            header,
            stamp or NO_STAMP,
            sample.kind == zenoh.SampleKind.DELETE,
            is_reply,
        )
        if dropped := self.queue.put(message, size + len(header), wait_s=self._wait_s):
            with self._lock:
                self._counts["overwritten"] += dropped

    def _count(self, key: str, stamp: Stamp | None, *, is_reply: bool, is_too_large: bool) -> bool:
        """Counts a message; returns whether to pass it on."""
        with self._lock:
            losses = self._losses
            continuity = losses.replied(key, stamp) if is_reply else losses.received(key, stamp)
            if stamp is not None and continuity.is_new:
                self._states.note_record(stamp.run)
            self._counts.update(
                received=continuity.is_new,
                lost=continuity.lost,
                restarts=continuity.is_restart,
                interleaved=continuity.is_interleaved,
                jumps=continuity.is_jump,
                repeated=not is_reply and not continuity.is_new,
                bad=continuity.is_new and is_too_large,
            )
        return continuity.is_new and not is_too_large

    def _alive_changed(self, count: int) -> None:
        with self._lock:
            has_appeared = count > self._counts["publishers"]
            self._counts["publishers"] = count
            if has_appeared:
                self._states.note_appeared()
        if has_appeared:
            # The status first: it shows which records are published to this receiver.
            self._query(self._status_selector, self._status_published)
        if has_appeared and self._ask_last:
            # After all published messages, whatever their priority.
            last = {
                "priority": zenoh.Priority.BACKGROUND,
                "congestion_control": zenoh.CongestionControl.BLOCK,
            }
            self._query(self._expression, self._published, **last)
        if self._ends_with_publisher and count:
            self.queue.reopen()
        elif self._ends_with_publisher:
            self.queue.end()

    def _query(self, selector: str, take: Callable[[zenoh.Sample, bool], None], **options: Any) -> None:
        """Gives each reply to `take`."""

        def replied(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                take(reply.ok, True)

        handler = zenoh.handlers.Callback(replied, indirect=False)
        self._session.get(selector, handler, timeout=QUERY_LIMIT_S, **options)

    def _status_published(self, sample: zenoh.Sample, is_reply: bool = False) -> None:
        """Counts losses that no later record would show."""
        if sample.kind == zenoh.SampleKind.DELETE or len(sample.payload) > STATUS_LIMIT_BYTES:
            return
        try:
            data, encoding = sample.payload.to_bytes(), str(sample.encoding)
            status = decode_message(StatusRecord, STATUS_SCHEMA, encoding, data)
        except BadPayload:
            return
        name = self._expression.rsplit("/", 1)[-1]
        key = f"{str(sample.key_expr).removesuffix(STATUS)}{name}"
        with self._lock:
            self._states.note_status(status)
            for stream in (stream for stream in status.streams if stream.name == name):
                numbers = self._losses.numbers_of(key, stream.run)
                if is_reply:
                    next_number = max(stream.next_number, stream.settled_number)
                    first = next_number if stream.first_number is None else stream.first_number
                    self._counts["lost"] += numbers.starts_at(first)
                # A status may overtake records: its number is used when the next status is here.
                has_ended = status.state == "ended"
                settled = stream.settled_number if has_ended else numbers.reported_number
                self._counts["lost"] += numbers.settled_up_to(settled)
                numbers.reported_number = stream.settled_number

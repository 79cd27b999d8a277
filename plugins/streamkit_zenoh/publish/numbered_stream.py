"""Streams: what is published at one key, with numbers; a sender makes its messages in a thread of its own."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import zenoh

from streamkit import Frame
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_zenoh.presence import is_matching
from streamkit_zenoh.publish.settings import PublicationSettings
from streamkit_zenoh.wire.messages import DropCount, StreamStatus
from streamkit_zenoh.wire.numbering import RecentDict, Stamp


@dataclass(frozen=True)
class Publisher:
    """What the streams of one publisher share.

    Attributes:
        session: an open session.
        root: the key below which everything is published.
        settings: what to publish.
        utc_ns: the clock.
        run: when it began, UTC ns.
        failed: called with what went wrong, from any thread.
        dropped: called with stream and reason, and the number of messages not delivered, from any thread.
        cancelled: ends every wait when set.
    """

    session: zenoh.Session
    root: str
    settings: PublicationSettings
    utc_ns: Callable[[], int]
    run: int
    failed: Callable[[Exception], None]
    dropped: Callable[[str, int], object]
    cancelled: threading.Event


class Reply(NamedTuple):
    """The reply to a query for one key."""

    key: str
    payload: bytes
    encoding: zenoh.Encoding
    attachment: bytes | None = None


class ReceiverCutOff(TimeoutError):
    """A message blocked until zenoh closed the link to its receiver."""


class NumberedStream:
    """Publishes messages of one encoding and schema at `key`, ROOT/NAME, each with its stamp.

    Attributes:
        publisher: whose stream it is.
        declared: zenoh's publisher of the key.
    """

    def __init__(self, publisher: Publisher, name: str, content_type: str) -> None:
        self.publisher, self.name = publisher, name
        self.key = f"{publisher.root}/{name}"
        self.encoding = zenoh.Encoding(content_type)
        self._next_number = 0
        self._published = self._bytes = 0
        self._closed = False
        self._lock = threading.Lock()
        self.declared = publisher.session.declare_publisher(
            self.key,
            encoding=self.encoding,
            reliability=zenoh.Reliability.RELIABLE,
            **publisher.settings.qos()[name]._asdict(),
        )

    @property
    def has_subscriber(self) -> bool:
        """Whether zenoh knows of a subscriber now; False after `close`."""
        # zenoh does not undeclare a publisher that another thread is using.
        with self._lock:
            return not self._closed and is_matching(self.declared)

    @property
    def next_stamp(self) -> Stamp:
        """The stamp that the next message will have."""
        return Stamp(self.publisher.run, self._next_number)

    def take_stamp(self) -> Stamp:
        """Takes the stamp of the next message, which the caller sends or counts as dropped."""
        self._next_number += 1
        return Stamp(self.publisher.run, self._next_number - 1)

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publishes a message; may block with congestion control `block`.

        Raises:
            ReceiverCutOff: it blocked until zenoh closed the link to a receiver.
        """
        began_s, limit_s = time.monotonic(), self.publisher.settings.cut_off_s
        self.declared.put(payload, attachment=attachment)
        self._published += 1
        self._bytes += len(payload)
        if time.monotonic() - began_s >= limit_s:
            raise ReceiverCutOff(
                f"a receiver of {self.key} has taken nothing for {limit_s:g} s and was cut off"
            )

    def close(self) -> None:
        """Undeclares the key."""
        with self._lock:
            self._closed = True
        self.declared.undeclare()  # type: ignore[no-untyped-call]


@dataclass(frozen=True, slots=True, eq=False)
class Outgoing:
    """A frame whose message is to be published, when it was given, and its stamp."""

    frame: Frame
    stamp: Stamp
    made_ns: int


class Sender(NumberedStream):
    """Numbers frames, and makes and publishes their messages in a thread; a full queue drops the oldest.

    Without a subscriber a message is made only when a query asks for it. At most `capacity` frames wait,
    and a further one `patience_s` for room; `periodic` is called in the thread once a second.

    Attributes:
        last: the last frame whose message was sent, or had no subscriber; all before it are settled.
        executor: the thread; its owner's to close.
        part_publisher: of keys at which parts of the message are published, too; None without any.
    """

    drop_reason: ClassVar[str] = "queue full"

    def __init__(
        self,
        publisher: Publisher,
        name: str,
        content_type: str,
        capacity: int,
        patience_s: float = 0.0,
        periodic: Callable[[], object] | None = None,
    ) -> None:
        super().__init__(publisher, name, content_type)
        self.last: Outgoing | None = None
        self.part_publisher: zenoh.Publisher | None = None
        self._patience_s = patience_s
        self._drops: Counter[str] = Counter()
        self._first_numbers: RecentDict[str, int] = RecentDict()
        self.executor = BackgroundExecutor(
            f"zenoh {name}", self._not_sent, capacity=capacity, periodic=periodic
        )

    def submit(self, frame: Frame) -> None:
        """Queues a frame."""
        item = Outgoing(frame, self.take_stamp(), self.publisher.utc_ns())
        if not (self.has_subscriber or is_matching(self.part_publisher)):
            self.settle(item)
            return
        cancelled = self.publisher.cancelled
        if dropped := self.executor.submit_dropping(lambda: self.send(item), self._patience_s, cancelled):
            self.count_drop(self.drop_reason, dropped)

    def send(self, item: Outgoing) -> None:
        """Makes and publishes a message; called in the thread."""
        raise NotImplementedError

    def replies(self, asked: zenoh.KeyExpr) -> Iterable[Reply]:
        """The last message, for a query that matches its key; none where it is of no use alone."""
        return ()

    def settle(self, item: Outgoing) -> None:
        """Notes that a message and all before it were sent or dropped, or had no subscriber."""
        # Without a subscriber a frame is settled at once, while frames before it may still be in the queue.
        if self.last is None or item.stamp.number > self.last.stamp.number:
            self.last = item

    def count_drop(self, reason: str, count: int) -> None:
        """Counts stamped messages that were not sent."""
        with self._lock:
            self._drops[reason] += count
        self.publisher.dropped(f"{self.name}: {reason}", count)

    def _not_sent(self, error: Exception) -> None:
        self.count_drop("not sent", 1)
        self.publisher.failed(error)

    def add_receiver(self, name: str) -> None:
        """Stores the first number that a receiver is sent, whose subscription is known now."""
        if name not in self._first_numbers:
            self._first_numbers[name] = self._next_number

    def status(self, receiver: str | None = None) -> StreamStatus:
        """Counters; for a known receiver also the first number that it is sent."""
        return StreamStatus(
            name=self.name,
            run=self.publisher.run,
            settled_number=0 if self.last is None else self.last.stamp.number + 1,
            published=self._published,
            bytes=self._bytes,
            has_subscriber=int(self.has_subscriber),
            next_number=self._next_number,
            first_number=None if receiver is None else self._first_numbers.get(receiver),
        )

    @property
    def dropped(self) -> int:
        """Number of messages not delivered."""
        return sum(drop.count for drop in self.drop_counts())

    def drop_counts(self) -> list[DropCount]:
        """Messages not delivered, by reason."""
        with self._lock:
            drops = dict(self._drops)
        return [DropCount(stream=self.name, reason=reason, count=count) for reason, count in drops.items()]

    def abandon(self) -> None:
        """Drops what waits."""
        if left := self.executor.abandon():
            self.count_drop("not sent before the end", left)

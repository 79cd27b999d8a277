"""NumberedStream: one stream at one key, its messages numbered, its subscribers known."""

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import zenoh

from streamkit_zenoh.presence import is_matching
from streamkit_zenoh.publish.settings import PublicationSettings
from streamkit_zenoh.wire.numbering import RecentDict, Stamp
from streamkit_zenoh.wire.status import DropCount, StreamStatus


@dataclass(frozen=True)
class Publisher:
    """What the streams and senders of one publisher share.

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
    """Publishes messages of one encoding and schema at `key`, ROOT/NAME, each with its stamp."""

    def __init__(self, publisher: Publisher, name: str, content_type: str) -> None:
        self.name = name
        self.key = f"{publisher.root}/{name}"
        self.encoding = zenoh.Encoding(content_type)
        self._owner = publisher
        self._drops: Counter[str] = Counter()
        self._next_number = 0
        self._published = self._bytes = 0
        self._first_numbers: RecentDict[str, int] = RecentDict()
        self._closed = False
        self._lock = threading.Lock()
        self.publisher = publisher.session.declare_publisher(
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
            return not self._closed and is_matching(self.publisher)

    @property
    def next_stamp(self) -> Stamp:
        """The stamp that the next message will have."""
        return Stamp(self._owner.run, self._next_number)

    def stamp(self) -> Stamp:
        """The stamp of the next message; its owner sends the message or counts it as dropped."""
        self._next_number += 1
        return Stamp(self._owner.run, self._next_number - 1)

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publishes a message; may block with congestion control `block`.

        Raises:
            ReceiverCutOff: it blocked until zenoh closed the link to a receiver.
        """
        began_s, limit_s = time.monotonic(), self._owner.settings.cut_off_s
        self.publisher.put(payload, attachment=attachment)
        self._published += 1
        self._bytes += len(payload)
        if time.monotonic() - began_s >= limit_s:
            raise ReceiverCutOff(
                f"a receiver of {self.key} has taken nothing for {limit_s:g} s and was cut off"
            )

    def count_drop(self, reason: str, count: int) -> None:
        """Counts stamped messages that were not sent."""
        with self._lock:
            self._drops[reason] += count
        self._owner.dropped(f"{self.name}: {reason}", count)

    def add_receiver(self, name: str) -> None:
        """Stores the first number that a receiver is sent, whose subscription is known now."""
        if name not in self._first_numbers:
            self._first_numbers[name] = self._next_number

    def status(self, settled_number: int, receiver: str | None = None) -> StreamStatus:
        """Counters; all messages with lower numbers than `settled_number` were sent or dropped."""
        return StreamStatus(
            name=self.name,
            run=self._owner.run,
            settled_number=settled_number,
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

    def close(self) -> None:
        """Undeclares the publisher."""
        with self._lock:
            self._closed = True
        self.publisher.undeclare()  # type: ignore[no-untyped-call]

"""Sender: base of the senders of records, images and packets, each with a thread of its own."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import ClassVar

import zenoh

from streamkit import Frame
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_zenoh.publish.numbered_stream import NumberedStream, Publisher, Reply
from streamkit_zenoh.wire.numbering import Stamp
from streamkit_zenoh.wire.status import StreamStatus


@dataclass(frozen=True, slots=True, eq=False)
class Outgoing:
    """A frame whose message is to be published, when it was given, and its stamp."""

    frame: Frame
    stamp: Stamp
    made_ns: int


class Sender:
    """Numbers frames, and makes and publishes their messages in a thread; a full queue drops the oldest.

    A message without subscriber is made only when a query asks for it. At most `capacity` frames wait, and a
    further one `patience_s` for room; `periodic` is called in the thread once a second.

    Attributes:
        last: the last frame whose message was sent, or had no subscriber; all before it are settled.
        executor: the thread.
    """

    drop_reason: ClassVar[str] = "queue full"

    def __init__(
        self,
        publisher: Publisher,
        stream: NumberedStream,
        capacity: int,
        patience_s: float = 0.0,
        periodic: Callable[[], object] | None = None,
    ) -> None:
        self.publisher = publisher
        self.stream = stream
        self.last: Outgoing | None = None
        self._patience_s = patience_s
        self.executor = BackgroundExecutor(
            f"zenoh {stream.name}", self._not_sent, capacity=capacity, periodic=periodic
        )

    @property
    def has_subscriber(self) -> bool:
        """Whether anyone receives the messages."""
        return self.stream.has_subscriber

    def submit(self, frame: Frame) -> None:
        """Queues a frame."""
        item = Outgoing(frame, self.stream.stamp(), self.publisher.utc_ns())
        if not self.has_subscriber:
            self.settle(item)
            return
        cancelled = self.publisher.cancelled
        if dropped := self.executor.submit_dropping(lambda: self.send(item), self._patience_s, cancelled):
            self.stream.count_drop(self.drop_reason, dropped)

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

    def status(self, receiver: str | None = None) -> StreamStatus:
        """Counters; for a known receiver also the first number that it is sent."""
        return self.stream.status(0 if self.last is None else self.last.stamp.number + 1, receiver)

    def abandon(self) -> None:
        """Drops what waits."""
        if left := self.executor.abandon():
            self.stream.count_drop("not sent before the end", left)

    def close(self) -> None:
        """Undeclares the stream; the executor is its owner's to close."""
        self.stream.close()

    def _not_sent(self, error: Exception) -> None:
        self.stream.count_drop("not sent", 1)
        self.publisher.failed(error)

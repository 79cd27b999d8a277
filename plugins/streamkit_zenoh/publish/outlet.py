"""One stream at one key: numbers what it publishes, and knows whether anybody listens."""

import threading
import time
from collections import Counter, OrderedDict

import zenoh

from streamkit_zenoh.publish.quality import Quality
from streamkit_zenoh.wire.numbering import Stamp, remember
from streamkit_zenoh.wire.status import DropCount, StreamStatus


class ReceiverCutOff(TimeoutError):
    """A message could not be handed over for so long that zenoh closed the link to its receiver."""


class Outlet:
    """Publishes messages at a key, each with its stamp.

    Args:
        session: an open session.
        key: where.
        name: of the stream.
        run: when the publisher began, UTC ns.
        encoding: of the messages.
        quality: how zenoh treats them.
        cut_off_s: how long zenoh waits for a receiver that takes nothing.

    Attributes:
        name: of the stream.
        key: where.
        is_wanted: whether anybody listens.
        drops: messages not delivered, by reason.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        name: str,
        run: int,
        encoding: str,
        quality: Quality,
        cut_off_s: float,
    ) -> None:
        self.name = name
        self.key = key
        self.encoding = zenoh.Encoding(encoding)
        self.is_wanted = False
        self.drops: Counter[str] = Counter()
        self._run = run
        self._cut_off_s = cut_off_s
        self._next_number = self._settled_number = 0
        self._published = self._bytes = 0
        self._first_numbers: OrderedDict[str, int] = OrderedDict()
        self._closed = False
        self._lock = threading.Lock()
        self.publisher = session.declare_publisher(
            key,
            encoding=self.encoding,
            congestion_control=quality.congestion,
            priority=quality.priority,
            express=quality.express,
            reliability=zenoh.Reliability.RELIABLE,
        )
        # Asking zenoh at every frame takes longer than publishing does: it tells when that changes.
        self._listener = self.publisher.declare_matching_listener(
            zenoh.handlers.Callback(self._matching_changed, indirect=False)
        )
        if self.is_matching:
            self.is_wanted = True

    @property
    def is_matching(self) -> bool:
        """Whether zenoh knows of a subscriber now; nobody listens to a publisher that is taken back."""
        # zenoh may still call a listener while another thread closes, and refuses to take a publisher back
        # that is being asked.
        with self._lock:
            if self._closed:
                return False
            # zenoh's stub says bool, the library gives an object that is always true.
            return bool(getattr(self.publisher.matching_status, "matching", False))

    def stamp(self) -> Stamp:
        """The stamp of the next message; whoever takes one sends it, or counts it as dropped."""
        number = self._next_number
        self._next_number = number + 1
        return Stamp(self._run, number)

    def settle(self, stamp: Stamp) -> None:
        """Says that this message, and all before it, have been sent or dropped, or nobody wanted them."""
        self._settled_number = max(self._settled_number, stamp.number + 1)

    def put(self, payload: bytes, attachment: bytes) -> None:
        """Publishes a message; may block where the quality says so.

        Raises:
            ReceiverCutOff: it blocked until zenoh gave a receiver up.
        """
        began_s = time.monotonic()
        self.publisher.put(payload, attachment=attachment)
        self._published += 1
        self._bytes += len(payload)
        if time.monotonic() - began_s >= self._cut_off_s:
            raise ReceiverCutOff(
                f"a receiver of {self.key} has taken nothing for {self._cut_off_s:g} s and was cut off"
            )

    def look(self) -> None:
        """Asks zenoh whether anybody listens: it tells of a new subscriber a little late."""
        self.is_wanted = self.is_wanted or self.is_matching

    def count_drop(self, reason: str, count: int) -> None:
        """Counts messages that took a stamp and were not sent."""
        with self._lock:
            self.drops[reason] += count

    def receiver_appeared(self, name: str) -> None:
        """Notes from which number on everything is sent to a receiver whose subscription is known."""
        self.look()
        if name not in self._first_numbers:
            remember(self._first_numbers, name, self._next_number)

    def status(self, receiver: str | None = None) -> StreamStatus:
        """How it is doing; for a receiver that has appeared, what it is sent, too."""
        return StreamStatus(
            name=self.name,
            run=self._run,
            settled_number=self._settled_number,
            published=self._published,
            bytes=self._bytes,
            has_subscriber=int(self.is_wanted),
            next_number=self._next_number,
            first_number=None if receiver is None else self._first_numbers.get(receiver),
        )

    def drop_counts(self) -> list[DropCount]:
        """What was not delivered."""
        with self._lock:
            return [
                DropCount(stream=self.name, reason=reason, count=count)
                for reason, count in self.drops.items()
            ]

    def close(self) -> None:
        """Takes the publisher back."""
        with self._lock:
            self._closed = True
        self._listener.undeclare()  # type: ignore[no-untyped-call]
        self.publisher.undeclare()  # type: ignore[no-untyped-call]

    def _matching_changed(self, status: zenoh.MatchingStatus) -> None:
        # One has gone, but the next may be there already: zenoh tells of each in turn.
        self.is_wanted = status.matching or self.is_matching

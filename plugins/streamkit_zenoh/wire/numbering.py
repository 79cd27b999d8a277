"""Message numbers: a gap in the numbers of a run is a loss, another run is a new publisher.

Each message has the attachment `RUN NUMBER`: when its publisher began (UTC, ns), and its number in its
stream, from 0 on. A header may follow in a second line.
"""

import re
from collections import OrderedDict
from typing import NamedTuple, TypeVar

from typing_extensions import override

from streamkit_zenoh.wire.sequence import Continuity, ReceivedNumbers

# Keys come from the network: their number is bounded.
KEY_LIMIT = 1024
ATTACHMENT_LIMIT_BYTES = 4 * 1024 * 1024
CONFIRMED_MESSAGES = 3
OTHERS_LIMIT = 16
STAMP = re.compile(rb"(\d{1,19}) (\d{1,19})")


class Stamp(NamedTuple):
    """Identifies a message.

    Attributes:
        run: when the publisher began, UTC ns.
        number: of the message in its stream.
    """

    run: int
    number: int

    def attachment(self, header: bytes = b"") -> bytes:
        """The attachment of the message."""
        line = b"%d %d" % self
        return line + b"\n" + header if header else line


def read_attachment(data: bytes) -> tuple[Stamp | None, bytes]:
    """The stamp, or None without one, and the header after it."""
    line, _, header = data.partition(b"\n")
    match = STAMP.fullmatch(line[:64])
    return (Stamp(int(match[1]), int(match[2])), header) if match else (None, b"")


Key = TypeVar("Key")
Value = TypeVar("Value")


class RecentDict(OrderedDict[Key, Value]):
    """A dictionary of at most `KEY_LIMIT` keys; drops the one that was set longest ago."""

    @override
    def __setitem__(self, key: Key, value: Value) -> None:
        super().__setitem__(key, value)
        self.move_to_end(key)
        if len(self) > KEY_LIMIT:
            self.popitem(last=False)


class RunOrder:
    """Detects messages of an earlier publisher between those of a later one at the same key.

    A run counts as the later one from its third message on, until 16 messages of others have come in a row: a
    single forged stamp has no effect.

    Attributes:
        last: run of the last new message.
    """

    def __init__(self, run: int) -> None:
        self.last = self._latest = run
        self._messages = self._others = 0

    def received(self, run: int, *, is_first: bool) -> bool:
        """Counts a new message; returns whether the earlier publisher sent it."""
        self.last = run
        if is_first or self._others == OTHERS_LIMIT:
            self._latest, self._messages = run, 0
        if run == self._latest:
            self._messages, self._others = self._messages + 1, 0
            return False
        self._others += 1
        return self._messages >= CONFIRMED_MESSAGES


class LossTracker:
    """Detects lost and repeated messages of each publisher at each key."""

    def __init__(self) -> None:
        self._numbers: RecentDict[tuple[str, int], ReceivedNumbers] = RecentDict()
        self._orders: RecentDict[str, RunOrder] = RecentDict()

    def received(self, key: str, stamp: Stamp | None) -> Continuity:
        """Notes a published message.

        Messages before the first one received are not lost, unless `starts_at` gives an earlier start, or
        the publisher follows another one: this receiver then subscribed before its first message.
        """
        if stamp is None:
            return Continuity()
        run, number = stamp
        numbers, order = self.numbers_of(key, run), self._orders.get(key)
        is_first = not numbers.has_received
        if order is not None and is_first and run > order.last:
            numbers.starts_at(0)
        is_restart = order is not None and is_first
        continuity = numbers.received(number)
        if not continuity.is_new and not is_restart:
            return continuity
        order = self._orders[key] = order or RunOrder(run)
        is_interleaved = order.received(run, is_first=is_first)
        return continuity._replace(is_restart=is_restart, is_interleaved=is_interleaved)

    def replied(self, key: str, stamp: Stamp | None) -> Continuity:
        """Notes the reply to a query for the last message; it may overtake published messages."""
        if stamp is None:
            return Continuity()
        run, number = stamp
        numbers, order = self.numbers_of(key, run), self._orders.get(key)
        is_old = not numbers.has_received and order is not None and run < order.last
        return Continuity(is_new=not is_old and numbers.replied(number))

    def numbers_of(self, key: str, run: int) -> ReceivedNumbers:
        """The numbers received from a publisher at a key."""
        numbers = self._numbers[key, run] = self._numbers.get((key, run)) or ReceivedNumbers()
        return numbers

"""Message numbers: a gap in the numbers of a run is a loss, another run is a new publisher.

Each message has the attachment `RUN NUMBER`: when its publisher began (UTC, ns), and its number in its
stream, from 0 on. A header may follow in a second line.

Attachments are not authenticated: any sender that reaches the receiver may use any number. A message is
therefore a repetition only if its own number was received before, not because a higher one was, and a step of
more than `JUMP_LIMIT` numbers is reported as a jump instead of being counted as losses.
"""

import re
from collections import OrderedDict
from typing import NamedTuple, TypeVar

from typing_extensions import override

JUMP_LIMIT = 10_000_000  # 46 hours without a link at 60 messages a second
OLDER_LIMIT = 16  # a message at most so much older than the first one received is skipped as outdated
RANGE_LIMIT = 64
# Keys come from the network: their number is bounded.
KEY_LIMIT = 1024
ATTACHMENT_LIMIT_BYTES = 4 * 1024 * 1024
CONFIRMED_MESSAGES = 3
OTHERS_LIMIT = 16
STAMP = re.compile(rb"(\d{1,19}) (\d{1,19})")


class Continuity(NamedTuple):
    """What the number of a message shows.

    Attributes:
        lost: change of the number of lost messages; -1 if this one had been counted as lost.
        is_new: False for a repetition, and for one older than the first message received.
        is_jump: whether the step to it is too large: a forged number, or a very long outage.
        is_restart: whether its publisher follows another one.
        is_interleaved: whether its publisher is not the last that began, and both publish.
    """

    lost: int = 0
    is_new: bool = True
    is_jump: bool = False
    is_restart: bool = False
    is_interleaved: bool = False


class NumberSet:
    """A set of numbers as ranges, at most `RANGE_LIMIT` of them.

    The range that has not grown for longest is forgotten: forged numbers do not displace the publisher's.
    """

    def __init__(self) -> None:
        self._ranges: list[range] = []  # disjoint, in the order in which they have last grown

    def __len__(self) -> int:
        """How many ranges there are."""
        return len(self._ranges)

    def __contains__(self, number: int) -> bool:
        return any(number in span for span in self._ranges)

    def below(self, number: int) -> int | None:
        """The highest number of the set that is lower, or None."""
        return max((min(span.stop, number) - 1 for span in self._ranges if span.start < number), default=None)

    def above(self, number: int) -> int | None:
        """The lowest number of the set that is not lower, or None."""
        return min((max(span.start, number) for span in self._ranges if span.stop > number), default=None)

    def add(self, start: int, stop: int) -> None:
        """Adds the numbers from start to before stop."""
        if start >= stop:
            return
        touched = [span for span in self._ranges if span.start <= stop and start <= span.stop]
        grown = range(
            min([start, *(span.start for span in touched)]), max([stop, *(span.stop for span in touched)])
        )
        kept = [span for span in self._ranges if span not in touched]
        self._ranges = [*kept, grown][-RANGE_LIMIT:]


class ReceivedNumbers:
    """The numbers of one publisher at one key, in bounded memory.

    A number is settled once it is known to be received or lost.

    Attributes:
        reported_number: the settled number in the publisher's last status.
    """

    def __init__(self) -> None:
        self.reported_number = 0
        self._received = NumberSet()
        self._settled = NumberSet()
        self._latest: int | None = None  # settled last
        self._first: int | None = None  # losses are counted from this number on
        self._start: int | None = None  # first number that was sent to this receiver, where that is known
        self._reply: int | None = None  # received as the reply to a query

    @property
    def has_received(self) -> bool:
        """Whether a published message was received, or a status that settles some."""
        return self._latest is not None

    def received(self, number: int) -> Continuity:
        """Notes a published message."""
        if number in self._received:
            return Continuity(is_new=False)
        is_new, is_jump, change = number != self._reply, False, 0
        if number in self._settled:
            change = -1
        else:
            below, above = self._settled.below(number), self._settled.above(number)
            if below is None and above is not None and above - number <= OLDER_LIMIT:
                return Continuity(is_new=False)
            expected = self._expected(number) if below is None else below + 1
            is_jump = number - expected > JUMP_LIMIT or (below is None and above is not None)
            change = 0 if is_jump else self._lose(expected, number)
        self._received.add(number, number + 1)
        self._settle(number, number + 1)
        return Continuity(change, is_new, is_jump)

    def replied(self, number: int) -> bool:
        """Notes the reply to a query for the last message; returns whether it is new."""
        is_late = any(known is not None and number <= known for known in (self._latest, self._reply))
        is_still_to_come = self._latest is None and self._start is not None and number >= self._start
        if is_late or is_still_to_come or number in self._settled:
            return False
        self._reply = number
        return True

    def starts_at(self, number: int) -> int:
        """Notes that this receiver was sent all from this number on; returns how many more are lost by that.

        It may be known before the first message or after; the lowest number counts.
        """
        if number < 0 or (self._start is not None and self._start <= number):
            return 0
        self._start = number
        if self._first is None or not 0 < self._first - number <= JUMP_LIMIT:
            return 0
        lost, self._first = self._lose(number, self._first), number
        return lost

    def settled_up_to(self, next_number: int) -> int:
        """Notes that all lower numbers were sent or dropped; returns how many after the last one are lost."""
        below = self._settled.below(next_number)
        expected = self._start if self._latest is None else None if below is None else below + 1
        if expected is None or not 0 < next_number - expected <= JUMP_LIMIT:
            return 0
        lost = self._lose(expected, next_number)
        self._settle(expected, next_number)
        return lost

    def _settle(self, start: int, stop: int) -> None:
        self._settled.add(start, stop)
        self._latest = stop - 1
        if self._first is None:
            self._first = start

    def _lose(self, start: int, stop: int) -> int:
        """Counts the numbers from start to before stop as lost, but for the reply; returns how many."""
        if start >= stop:
            return 0
        if self._first is None:
            self._first = start
        self._settled.add(start, stop)
        if self._reply is None or not start <= self._reply < stop:
            return stop - start
        self._received.add(self._reply, self._reply + 1)
        return stop - start - 1

    def _expected(self, number: int) -> int:
        """The first number if nothing is lost, when this one is the first received."""
        if self._latest is not None:
            return number
        if self._start is not None:
            return self._start
        return number if self._reply is None else min(self._reply, number)


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

"""The message numbers of one publisher: which were received, and how many of the others are lost.

Attachments are not authenticated: any sender that reaches the receiver may use any number. A message is
therefore a repetition only if its own number was received before, not because a higher one was, and a step of
more than `JUMP_LIMIT` numbers is reported as a jump instead of being counted as losses.
"""

from bisect import bisect_left, bisect_right
from typing import NamedTuple

# 46 hours without a link at 60 messages a second.
JUMP_LIMIT = 10_000_000
JUMP_WARNING = (
    "message numbers jump by more than ten million: another sender uses the publisher's name, or the "
    "link was down for very long; where that matters, let only known senders in (docs/zenoh-security.md)"
)
INTERLEAVED_WARNING = (
    "two publishers use one key: messages of an earlier one come between those of a later one; "
    "end one of them, or give each a key of its own"
)
# A message at most so much older than the first one received is skipped as outdated.
OLDER_LIMIT = 16
RANGE_LIMIT = 64


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
        self._ranges: list[range] = []  # ascending, with at least one number between two
        self._grown: list[int] = []  # for each range, when it grew
        self._growths = 0

    def __len__(self) -> int:
        """How many ranges there are."""
        return len(self._ranges)

    def __contains__(self, number: int) -> bool:
        return self.below(number + 1) == number

    def below(self, number: int) -> int | None:
        """The highest number of the set that is lower, or None."""
        at = bisect_left(self._ranges, number, key=lambda one: one.start)
        return min(self._ranges[at - 1].stop, number) - 1 if at else None

    def above(self, number: int) -> int | None:
        """The lowest number of the set that is not lower, or None."""
        at = bisect_left(self._ranges, number, key=lambda one: one.stop - 1)
        return max(self._ranges[at].start, number) if at < len(self._ranges) else None

    def add(self, start: int, stop: int) -> None:
        """Adds the numbers from start to before stop."""
        if start >= stop:
            return
        first = bisect_left(self._ranges, start, key=lambda one: one.stop)
        last = bisect_right(self._ranges, stop, key=lambda one: one.start)
        touched = self._ranges[first:last]
        lowest = min([start, *(one.start for one in touched)])
        highest = max([stop, *(one.stop for one in touched)])
        self._growths += 1
        self._ranges[first:last], self._grown[first:last] = [range(lowest, highest)], [self._growths]
        self._bound()

    def remove(self, number: int) -> None:
        """Removes a number of the set."""
        at = bisect_right(self._ranges, number, key=lambda one: one.start) - 1
        one, grown = self._ranges[at], self._grown[at]
        left = [part for part in (range(one.start, number), range(number + 1, one.stop)) if part]
        self._ranges[at : at + 1], self._grown[at : at + 1] = left, [grown] * len(left)
        self._bound()

    def _bound(self) -> None:
        if len(self._ranges) > RANGE_LIMIT:
            oldest = self._grown.index(min(self._grown))
            del self._ranges[oldest], self._grown[oldest]


class ReceivedNumbers:
    """The numbers of one publisher at one key, in bounded memory.

    Each number from the first on is received, lost, or not settled yet.
    """

    def __init__(self) -> None:
        self._received = NumberSet()
        self._lost = NumberSet()
        self._latest: int | None = None  # received or settled
        self._first: int | None = None  # all numbers from here on are accounted for
        self._start: int | None = None  # from here on, this receiver was sent everything
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
        if number in self._lost:
            self._lost.remove(number)
            change = -1
        else:
            below, above = self._known_around(number)
            if below is None and above is not None and above - number <= OLDER_LIMIT:
                return Continuity(is_new=False)
            expected = self._expected(number) if below is None else below + 1
            is_jump = number - expected > JUMP_LIMIT or (below is None and above is not None)
            change = 0 if is_jump else self._lose(expected, number)
        self._received.add(number, number + 1)
        self._settled(number, number + 1)
        return Continuity(change, is_new, is_jump)

    def replied(self, number: int) -> bool:
        """Notes the reply to a query for the last message; whether it is new."""
        is_late = any(known is not None and number <= known for known in (self._latest, self._reply))
        is_still_to_come = self._latest is None and self._start is not None and number >= self._start
        if is_late or is_still_to_come or number in self._received or number in self._lost:
            return False
        self._reply = number
        return True

    def starts_at(self, number: int) -> int:
        """Notes that all from this number on were sent to this receiver; returns the new losses this shows.

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
        below, _ = self._known_around(next_number)
        expected = self._start if self._latest is None else None if below is None else below + 1
        if expected is None or not 0 < next_number - expected <= JUMP_LIMIT:
            return 0
        lost = self._lose(expected, next_number)
        self._settled(expected, next_number)
        return lost

    def _settled(self, start: int, stop: int) -> None:
        self._latest = stop - 1
        if self._first is None:
            self._first = start

    def _lose(self, start: int, stop: int) -> int:
        """Counts the numbers from start to before stop as lost, but for the reply; returns how many."""
        if start >= stop:
            return 0
        if self._first is None:
            self._first = start
        if self._reply is None or not start <= self._reply < stop:
            self._lost.add(start, stop)
            return stop - start
        self._received.add(self._reply, self._reply + 1)
        self._lost.add(start, self._reply)
        self._lost.add(self._reply + 1, stop)
        return stop - start - 1

    def _expected(self, number: int) -> int:
        """The first number if nothing is lost, when this one is the first received."""
        if self._latest is not None:
            return number
        if self._start is not None:
            return self._start
        return number if self._reply is None else min(self._reply, number)

    def _known_around(self, number: int) -> tuple[int | None, int | None]:
        """The next received or lost number below and above one that is neither."""
        below = [n for n in (self._received.below(number), self._lost.below(number)) if n is not None]
        above = [n for n in (self._received.above(number), self._lost.above(number)) if n is not None]
        return max(below, default=None), min(above, default=None)

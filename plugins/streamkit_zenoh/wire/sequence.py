"""The message numbers of one publisher: which were received, and how many of the others are lost.

Attachments are not authenticated: any sender that reaches the receiver may use any number. A message is
therefore a repetition only if its own number was received before, not because a higher one was, and a step of
more than `JUMP_LIMIT` numbers is reported as a jump instead of being counted as losses.
"""

from bisect import bisect_right
from dataclasses import dataclass
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
SPAN_LIMIT = 64


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


@dataclass(slots=True)
class Span:
    """Numbers `start` <= n < `end` were received; the `missing` ones before them count as lost."""

    start: int
    end: int
    missing: int
    used: int


class ReceivedNumbers:
    """The numbers of one publisher at one key, in bounded memory."""

    def __init__(self) -> None:
        self._spans: list[Span] = []
        self._latest: Span | None = None
        self._uses = 0
        self._first: int | None = None  # all numbers from here on were received or count as lost
        self._start: int | None = None
        self._replied = -1

    @property
    def has_received(self) -> bool:
        """Whether a published message was received, or a status that settles some."""
        return self._latest is not None

    def received(self, number: int) -> Continuity:
        """Notes a published message."""
        at, below, above = self._around(number)
        if below is not None and number < below.end:
            return Continuity(is_new=False)
        was_replied = number == self._replied
        if above is not None and above.start - above.missing <= number:
            missing = number - (above.start - above.missing)
            above.missing = above.start - number - 1
            self._add(at, Span(number, number + 1, missing, 0))
            return Continuity(0 if was_replied else -1, not was_replied)
        if below is None and above is not None and above.start - number <= OLDER_LIMIT:
            return Continuity(is_new=False)
        expected = self._expected(number) if below is None else below.end
        gap = max(0, number - expected)
        is_jump = gap > JUMP_LIMIT or (below is None and above is not None)
        gap = 0 if is_jump else gap
        self._add(at, Span(number, number + 1, gap, 0))
        return Continuity(self._without_reply(number - gap, number), not was_replied, is_jump)

    def replied(self, number: int) -> bool:
        """Notes the reply to a query for the last message; whether it is new."""
        last = self._replied if self._latest is None else max(self._replied, self._latest.end - 1)
        is_published = self._latest is None and self._start is not None and number >= self._start
        _, below, above = self._around(number)
        is_received = below is not None and number < below.end
        counts_as_lost = above is not None and above.start - above.missing <= number
        if number <= last or is_published or is_received or counts_as_lost:
            return False
        self._replied = number
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
        lost = self._without_reply(number, self._first)
        lowest = self._spans[0]
        if lowest.start - lowest.missing == self._first:
            lowest.missing += self._first - number
        self._first = number
        return lost

    def settled_up_to(self, next_number: int) -> int:
        """Notes that all lower numbers were sent or dropped; returns how many after the last one are lost."""
        at, below, above = self._around(next_number)
        expected = self._start if self._latest is None else None if below is None else below.end
        if expected is None or not 0 < next_number - expected <= JUMP_LIMIT:
            return 0
        if above is not None and above.start - above.missing <= next_number:
            return 0
        self._add(at, Span(next_number, next_number, next_number - expected, 0))
        return self._without_reply(expected, next_number)

    def _expected(self, number: int) -> int:
        """The first number if nothing is lost, when this one is the first received."""
        if self._latest is not None:
            return number
        if self._start is not None:
            return self._start
        return number if self._replied < 0 else min(self._replied, number)

    def _without_reply(self, start: int, end: int) -> int:
        """How many numbers from start to before end were not received as a reply."""
        return end - start - (start <= self._replied < end)

    def _around(self, number: int) -> tuple[int, Span | None, Span | None]:
        """Index of a number among the spans, the span that starts at or below it, and the next one."""
        latest, spans = self._latest, self._spans
        if latest is not None and latest is spans[-1] and latest.start <= number:
            return len(spans), latest, None
        at = bisect_right(spans, number, key=lambda span: span.start)
        return at, spans[at - 1] if at else None, spans[at] if at < len(spans) else None

    def _add(self, at: int, span: Span) -> None:
        """Inserts a span, joined with adjacent ones."""
        below = self._spans[at - 1] if at else None
        if self._first is None:
            self._first = span.start - span.missing
        if below is not None and span.missing == 0 and below.end == span.start:
            below.end = span.end
            span = below
        else:
            self._spans.insert(at, span)
            at += 1
        above = self._spans[at] if at < len(self._spans) else None
        if above is not None and above.missing == 0 and above.start == span.end:
            span.end = above.end
            del self._spans[at]
        self._uses += 1
        span.used = self._uses
        self._latest = span
        if len(self._spans) > SPAN_LIMIT:
            # The one that has not grown for longest: forged numbers do not displace the publisher's.
            self._spans.remove(min(self._spans, key=lambda one: one.used))

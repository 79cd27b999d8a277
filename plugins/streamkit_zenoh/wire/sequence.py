"""The numbers of one publisher's messages: which have come, and how many of the others are lost.

Attachments are not authenticated: anybody who reaches the receiver may send any number. So a message is a
repetition only where its own number has come before, never because a higher one has, and a step of more than
`JUMP_LIMIT` numbers is told as a jump instead of being counted as so many losses.
"""

from bisect import bisect_right
from dataclasses import dataclass
from typing import NamedTuple

# 46 hours without a link at 60 messages a second.
JUMP_LIMIT = 10_000_000
JUMP_WARNING = (
    "message numbers jump by more than ten million: somebody else sends in the publisher's name, or the "
    "link was down for very long; where that matters, let only known senders in (docs/zenoh-security.md)"
)
# A receiver that begins in mid-stream takes what is so little older than its first message for out of date.
OLDER_LIMIT = 16
SPAN_LIMIT = 64


class Heard(NamedTuple):
    """What a number tells.

    Attributes:
        lost: by how much the number of losses changes; -1 where this one had been taken for lost.
        is_new: False for a repetition.
        is_jump: whether it is too far from all numbers before to be their continuation.
    """

    lost: int = 0
    is_new: bool = True
    is_jump: bool = False


@dataclass(slots=True)
class Span:
    """Numbers from `start` to before `end` have come; the `missing` ones before them count as lost."""

    start: int
    end: int
    missing: int
    used: int


class Sequence:
    """Follows one publisher's numbers at one key; its memory is bounded."""

    def __init__(self) -> None:
        self._spans: list[Span] = []
        self._latest: Span | None = None
        self._uses = 0
        self._first: int | None = None  # every number from here on has come, or counts as lost
        self._begins: int | None = None
        self._answered = -1

    @property
    def is_heard(self) -> bool:
        """Whether a message has come by itself, or the end has been told."""
        return self._latest is not None

    def arrived(self, number: int) -> Heard:
        """Takes note of a message that comes by itself."""
        at, below, above = self._around(number)
        if below is not None and number < below.end:
            return Heard(is_new=False)
        was_answered = number == self._answered
        if above is not None and above.start - above.missing <= number:
            missing = number - (above.start - above.missing)
            above.missing = above.start - number - 1
            self._add(at, Span(number, number + 1, missing, 0))
            return Heard(0 if was_answered else -1, not was_answered)
        if below is None and above is not None and above.start - number <= OLDER_LIMIT:
            return Heard(is_new=False)
        expected = self._expected(number) if below is None else below.end
        gap = max(0, number - expected)
        is_jump = gap > JUMP_LIMIT or (below is None and above is not None)
        gap = 0 if is_jump else gap
        self._add(at, Span(number, number + 1, gap, 0))
        return Heard(self._without_answer(number - gap, number), not was_answered, is_jump)

    def answered(self, number: int) -> bool:
        """Takes note of the last message, asked for: whether it is new."""
        last = self._answered if self._latest is None else max(self._answered, self._latest.end - 1)
        comes_by_itself = self._latest is None and self._begins is not None and number >= self._begins
        if number <= last or comes_by_itself:
            return False
        self._answered = number
        return True

    def begins(self, number: int) -> int:
        """Everything from this number on was sent here: how many are lost that nothing has shown before.

        The publisher may say so before its first message comes or after; the lowest number said counts.
        """
        if number < 0 or (self._begins is not None and self._begins <= number):
            return 0
        self._begins = number
        if self._first is None or not 0 < self._first - number <= JUMP_LIMIT:
            return 0
        lost = self._without_answer(number, self._first)
        lowest = self._spans[0]
        if lowest.start - lowest.missing == self._first:
            lowest.missing += self._first - number
        self._first = number
        return lost

    def caught_up(self, next_number: int) -> int:
        """Everything below this number has been sent or dropped: how many are lost behind the last heard."""
        at, below, above = self._around(next_number)
        expected = self._begins if self._latest is None else None if below is None else below.end
        if expected is None or not 0 < next_number - expected <= JUMP_LIMIT:
            return 0
        if above is not None and above.start - above.missing <= next_number:
            return 0
        self._add(at, Span(next_number, next_number, next_number - expected, 0))
        return self._without_answer(expected, next_number)

    def _expected(self, number: int) -> int:
        """What would have come first if nothing were lost, when this is the first to come."""
        if self._latest is not None:
            return number
        if self._begins is not None:
            return self._begins
        return number if self._answered < 0 else min(self._answered, number)

    def _without_answer(self, start: int, end: int) -> int:
        """How many numbers from start to before end have not come as an answer."""
        return end - start - (start <= self._answered < end)

    def _around(self, number: int) -> tuple[int, Span | None, Span | None]:
        """Where a number belongs among the spans, the one that starts at or below it, and the next one."""
        latest, spans = self._latest, self._spans
        if latest is not None and latest is spans[-1] and latest.start <= number:
            return len(spans), latest, None
        at = bisect_right(spans, number, key=lambda span: span.start)
        return at, spans[at - 1] if at else None, spans[at] if at < len(spans) else None

    def _add(self, at: int, span: Span) -> None:
        """Puts a span in its place, joined with a neighbour that it touches."""
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
            # The one that has not grown for longest: a stranger's numbers do not displace the publisher's.
            self._spans.remove(min(self._spans, key=lambda one: one.used))

"""Publishers number what they publish: gaps are losses, and another run is a new publisher.

Each message carries as attachment `RUN NUMBER`: when its publisher began (UTC, ns), and its number in its
stream, from 0 on. A header may follow in a second line.
"""

import re
from collections import OrderedDict
from typing import NamedTuple, TypeVar

# Keys come from the network: those heard longest ago are forgotten.
KEY_LIMIT = 1024
ATTACHMENT_LIMIT_BYTES = 4 * 1024 * 1024
STAMP = re.compile(rb"(\d{1,19}) (\d{1,19})")


class Stamp(NamedTuple):
    """Which message of which publisher.

    Attributes:
        run: when the publisher began, UTC ns.
        number: of the message in its stream.
    """

    run: int
    number: int

    def attachment(self, header: bytes = b"") -> bytes:
        """The bytes that travel with the message."""
        line = b"%d %d" % self
        return line + b"\n" + header if header else line


def read_attachment(data: bytes) -> tuple[Stamp | None, bytes]:
    """The stamp, or None where the attachment begins with none, and the header behind it."""
    line, _, header = data.partition(b"\n")
    match = STAMP.fullmatch(line[:64])
    return (Stamp(int(match[1]), int(match[2])), header) if match else (None, b"")


class Arrival(NamedTuple):
    """What a stamp tells on arrival.

    Attributes:
        lost: messages of this key that were missed just before this one.
        is_new: False for a message that was here before, or is older than one that was.
        is_restart: whether its publisher has taken over from another.
    """

    lost: int = 0
    is_new: bool = True
    is_restart: bool = False


class Numbering:
    """Follows the numbers of each publisher at each key."""

    def __init__(self) -> None:
        self._last: OrderedDict[tuple[str, int], int] = OrderedDict()
        self._runs: OrderedDict[str, int] = OrderedDict()
        self._begins: OrderedDict[tuple[str, int], int] = OrderedDict()
        self._answered: OrderedDict[tuple[str, int], int] = OrderedDict()

    def arrived(self, key: str, stamp: Stamp | None) -> Arrival:
        """Takes note of a message; one without stamp tells nothing.

        What a publisher sent before the first message that arrived here is not missed, unless `begins` was
        told, or it took over from another one heard before: then this receiver was there from its first
        number on.
        """
        if stamp is None:
            return Arrival()
        run, number = stamp
        last, heard, answered = (
            self._last.get((key, run)),
            self._runs.get(key),
            self._answered.get((key, run)),
        )
        if last is not None and number <= last:
            return Arrival(is_new=False)
        first = self._first_missed(key, run, number)
        remember(self._last, (key, run), number)
        remember(self._runs, key, run)
        is_restart = last is None and heard is not None
        lost = max(0, number - first)
        if answered is not None and first <= answered < number:
            lost -= 1
        return Arrival(lost, is_new=number != answered, is_restart=is_restart)

    def answered(self, key: str, stamp: Stamp | None) -> Arrival:
        """Takes note of the last message, asked for: it may overtake those that come by themselves."""
        if stamp is None:
            return Arrival()
        run, number = stamp
        last, heard, begins = self._last.get((key, run)), self._runs.get(key), self._begins.get((key, run))
        known = max(-1 if last is None else last, self._answered.get((key, run), -1))
        of_the_past = last is None and heard is not None and run < heard
        comes_by_itself = last is None and begins is not None and number >= begins
        if number <= known or of_the_past or comes_by_itself:
            return Arrival(is_new=False)
        remember(self._answered, (key, run), number)
        return Arrival()

    def begins(self, key: str, run: int, next_number: int) -> None:
        """A publisher says which number comes next, now that this receiver is there."""
        if (key, run) not in self._last and (key, run) not in self._begins:
            remember(self._begins, (key, run), next_number)

    def catch_up(self, key: str, run: int, next_number: int) -> int:
        """How many were missed at the end, when a publisher says which number comes next."""
        first = self._first_missed(key, run, next_number)
        if (key, run) not in self._last or next_number <= first:
            return 0
        self._last[key, run] = next_number - 1
        return next_number - first - (first <= self._answered.get((key, run), -1) < next_number)

    def _first_missed(self, key: str, run: int, number: int) -> int:
        """The first number that is missing if this one comes next."""
        last, heard = self._last.get((key, run)), self._runs.get(key)
        if last is not None:
            return last + 1
        if heard is not None:
            return 0 if run > heard else number
        answered = self._answered.get((key, run), number)
        return self._begins.get((key, run), min(answered, number))


Key = TypeVar("Key")
Value = TypeVar("Value")


def remember(known: OrderedDict[Key, Value], key: Key, value: Value) -> None:
    """Notes a value; of too many keys, the one heard longest ago is forgotten."""
    known[key] = value
    known.move_to_end(key)
    if len(known) > KEY_LIMIT:
        known.popitem(last=False)

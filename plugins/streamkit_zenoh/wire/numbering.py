"""Publishers number what they publish: gaps are losses, and another run is a new publisher.

Each message carries as attachment `RUN NUMBER`: when its publisher began (UTC, ns), and its number in its
stream, from 0 on. A header may follow in a second line.
"""

import re
from collections import OrderedDict
from typing import NamedTuple, TypeVar

from streamkit_zenoh.wire.sequence import Sequence

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
        lost: by how much the number of lost messages changes; -1 where this one had been taken for lost.
        is_new: False for a message that was here before, or is older than the first one that was.
        is_restart: whether its publisher has taken over from another.
        is_jump: whether its number is too far from those before: a forged one, or a very long outage.
    """

    lost: int = 0
    is_new: bool = True
    is_restart: bool = False
    is_jump: bool = False


class Numbering:
    """Follows the numbers of each publisher at each key."""

    def __init__(self) -> None:
        self._sequences: OrderedDict[tuple[str, int], Sequence] = OrderedDict()
        self._runs: OrderedDict[str, int] = OrderedDict()

    def arrived(self, key: str, stamp: Stamp | None) -> Arrival:
        """Takes note of a message; one without stamp tells nothing.

        What a publisher sent before the first message that arrived here is not missed, unless `begins` is
        told, or it took over from another one heard before: then this receiver was there from its first
        number on.
        """
        if stamp is None:
            return Arrival()
        run, number = stamp
        sequence, heard = self._sequence(key, run), self._runs.get(key)
        is_restart = heard is not None and not sequence.is_heard
        if is_restart and heard is not None and run > heard:
            sequence.begins(0)
        found = sequence.arrived(number)
        if found.is_new or is_restart:
            remember(self._runs, key, run)
        return Arrival(found.lost, found.is_new, is_restart, found.is_jump)

    def answered(self, key: str, stamp: Stamp | None) -> Arrival:
        """Takes note of the last message, asked for: it may overtake those that come by themselves."""
        if stamp is None:
            return Arrival()
        run, number = stamp
        sequence, heard = self._sequence(key, run), self._runs.get(key)
        of_the_past = not sequence.is_heard and heard is not None and run < heard
        return Arrival(is_new=not of_the_past and sequence.answered(number))

    def begins(self, key: str, run: int, number: int) -> int:
        """A publisher says from which number on it has sent everything here: how many losses that shows."""
        return self._sequence(key, run).begins(number)

    def catch_up(self, key: str, run: int, next_number: int) -> int:
        """How many were missed at the end, when a publisher says which number comes next."""
        return self._sequence(key, run).caught_up(next_number)

    def _sequence(self, key: str, run: int) -> Sequence:
        sequence = self._sequences.get((key, run)) or Sequence()
        remember(self._sequences, (key, run), sequence)
        return sequence


Key = TypeVar("Key")
Value = TypeVar("Value")


def remember(known: OrderedDict[Key, Value], key: Key, value: Value) -> None:
    """Notes a value; of too many keys, the one heard longest ago is forgotten."""
    known[key] = value
    known.move_to_end(key)
    if len(known) > KEY_LIMIT:
        known.popitem(last=False)

"""SubRip subtitles: texts with a beginning and an end, read from whatever a file holds.

A subtitle without times of its own is shown by the aircraft's clock, or by the time since the last one:

    2018-09-02 10:22:05,325,621        local time, here to the microsecond; older models have whole seconds
    FrameCnt : 7, DiffTime : 33ms      time that this subtitle is shown
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from datetime import datetime, timedelta

# Some aircraft write 00:00:60,000 for the end of a minute.
TIMES = re.compile(
    r"^\s*(\d{1,3}):(\d{1,2}):(\d{1,2})[,.](\d{1,3})\s*-->\s*\d{1,3}:\d{1,2}:\d{1,2}[,.]\d{1,3}"
)
ARROW = "-->"
NUMBER = re.compile(r"[0-9]{1,9}")
MAX_TEXT = 4096
STAMP = re.compile(
    r"\b(\d{4})[-.](\d{1,2})[-.](\d{1,2})\s+(\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d{3})(?:[.,](\d{3}))?)?(?!\d)"
)
STEP = re.compile(r"\bDiffTime\s*:\s*(\d{1,7})\s*ms")
MAX_NS = 1000 * 3600 * 1_000_000_000  # as long as a subtitle's own times reach


# A subtitle: its beginning, ns, None where it has a number but no line of times; its text.
Cue = tuple[int | None, str]


class SubtitleReader:
    """Reads subtitles line by line, in bounded memory."""

    def __init__(self) -> None:
        self.broken = 0  # subtitles whose times cannot be read, and one that ends after its times
        self._times: re.Match[str] | None = None
        self._lines: list[str] = []
        self._size = 0

    def cues(self, lines: Iterable[str]) -> Iterator[Cue]:
        """The subtitles of some lines, in their order."""
        for line in lines:
            times = TIMES.match(line)
            bare = line.strip("\ufeff\r\n")
            if times is None and bare.strip() and not self._begins_next(bare):
                self._keep(bare)
                continue
            if (cue := self._complete()) is not None:
                yield cue
            self._times = times
            if times is None and bare.strip():
                self._keep(bare)
        if self._times is not None and not self._lines:
            self.broken += 1
        elif (cue := self._complete()) is not None:
            yield cue

    def _begins_next(self, line: str) -> bool:
        """Whether a line is the number of the next subtitle without times; some files have no blank line."""
        if self._times is not None or len(self._lines) < 2:
            return False
        number, following = self._lines[0].strip(), line.strip()
        are_numbers = NUMBER.fullmatch(number) is not None and NUMBER.fullmatch(following) is not None
        return are_numbers and int(following) == int(number) + 1

    def _keep(self, line: str) -> None:
        if self._size <= MAX_TEXT:
            self._lines.append(line)
            self._size += len(line) + 1

    def _complete(self) -> Cue | None:
        """The subtitle of the lines so far; None where they are none."""
        times, lines = self._times, self._lines
        self._times, self._lines, self._size = None, [], 0
        if times is not None:
            return _ns(*times.groups()), "\n".join(lines)[:MAX_TEXT]
        if any(ARROW in line for line in lines):
            self.broken += 1
            return None
        is_numbered = len(lines) > 1 and NUMBER.fullmatch(lines[0].strip()) is not None
        return (None, "\n".join(lines[1:])[:MAX_TEXT]) if is_numbered else None


def subtitle_text(text: str) -> str:
    """The text of a subtitle packet: the last field of an ASS line, line breaks restored."""
    parts = text.split(",", 8)
    is_ass = len(parts) == 9 and parts[0].strip().isdigit()
    return (parts[8] if is_ass else text).replace("\\N", "\n")


def _ns(hours: str, minutes: str, seconds: str, thousandths: str) -> int:
    whole = (int(hours) * 60 + int(minutes)) * 60 + int(seconds)
    return whole * 1_000_000_000 + int(thousandths.ljust(3, "0")) * 1_000_000


class AircraftClock:
    """Finds when subtitles begin, by the aircraft's clock where they have no time of their own."""

    def __init__(self) -> None:
        self._begin_stamp: datetime | None = None  # local time at the video's beginning, once known
        self._next_ns: int | None = None

    def begin_ns(self, text: str, own_ns: int | None) -> int | None:
        """When a subtitle is shown first, ns.

        Args:
            text: of the subtitle, in the order of the file.
            own_ns: its own time, from the beginning of the video; None where it has none. Sets the clock.

        Returns:
            `own_ns`, or the time by the clock; None where the text has neither.
        """
        begin_ns = own_ns
        step, (stamp, is_fine) = STEP.search(text), read_stamp(text)
        if begin_ns is None and step is not None and not is_fine:
            begin_ns = self._next_ns if self._next_ns is not None or stamp is not None else 0
        if begin_ns is None and stamp is not None:
            passed = timedelta(0) if self._begin_stamp is None else stamp - self._begin_stamp
            begin_ns = passed // timedelta(microseconds=1) * 1000
        if begin_ns is None or not 0 <= begin_ns < MAX_NS:
            return None
        if self._begin_stamp is None and stamp is not None:
            self._begin_stamp = _earlier(stamp, begin_ns)
        self._next_ns = None if step is None else begin_ns + int(step[1]) * 1_000_000
        return begin_ns


def read_stamp(text: str) -> tuple[datetime | None, bool]:
    """The local time in a text, and whether it has parts of a second; None where there is none."""
    found = STAMP.search(text)
    if found is None:
        return None, False
    year, month, day, hour, minute, second, milli, micro = (int(part) for part in found.groups(default="0"))
    try:
        stamp = datetime(year, month, day, hour, minute, second, milli * 1000 + micro)
        return stamp, found[7] is not None
    except ValueError:  # no such day or time
        return None, False


def _earlier(stamp: datetime, ns: int) -> datetime | None:
    try:
        return stamp - timedelta(microseconds=ns // 1000)
    except OverflowError:
        return None

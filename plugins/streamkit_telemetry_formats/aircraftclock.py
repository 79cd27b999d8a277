"""When a subtitle without times of its own is shown: by the aircraft's clock or the time since the last one.

2018-09-02 10:22:05,325,621        local time, here to the microsecond; older models have whole seconds
FrameCnt : 7, DiffTime : 33ms      time that this subtitle is shown
"""

from __future__ import annotations

import re
from datetime import datetime, timedelta

STAMP = re.compile(
    r"\b(\d{4})[-.](\d{1,2})[-.](\d{1,2})\s+(\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d{3})(?:[.,](\d{3}))?)?(?!\d)"
)
STEP = re.compile(r"\bDiffTime\s*:\s*(\d{1,7})\s*ms")
LONGEST_NS = 1000 * 3600 * 1_000_000_000  # as long as a subtitle's own times reach


class AircraftClock:
    """Places subtitles on the video's line of time; those that have times of their own set it."""

    def __init__(self) -> None:
        self._zero: datetime | None = None  # what the clock shows at the video's beginning
        self._next: int | None = None

    def place(self, text: str, begin: int | None = None) -> int | None:
        """When a subtitle is shown first, ns.

        Args:
            text: of the subtitle, in the order of the file.
            begin: by its own times; None where it has none.

        Returns:
            `begin`, or the time by the clock; None where the text has neither.
        """
        step, (stamp, is_fine) = STEP.search(text), read_stamp(text)
        if begin is None and step is not None and not is_fine:
            begin = self._next if self._next is not None or stamp is not None else 0
        if begin is None and stamp is not None:
            begin = 0 if self._zero is None else _ns(stamp - self._zero)
        if begin is None or not 0 <= begin < LONGEST_NS:
            return None
        if self._zero is None and stamp is not None:
            self._zero = _earlier(stamp, begin)
        self._next = None if step is None else begin + int(step[1]) * 1_000_000
        return begin


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


def _ns(length: timedelta) -> int:
    return length // timedelta(microseconds=1) * 1000

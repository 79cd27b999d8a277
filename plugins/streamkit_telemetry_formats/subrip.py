"""SubRip subtitles: texts with a beginning and an end, read from whatever a file holds."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

# Some aircraft write 00:00:60,000 for the end of a minute.
_TIME = r"(\d{1,3}):(\d{1,2}):(\d{1,2})[,.](\d{1,3})"
TIMES = re.compile(rf"^\s*{_TIME}\s*-->\s*{_TIME}")
ARROW = "-->"
NUMBER = re.compile(r"[0-9]{1,9}")
LONGEST_TEXT = 4096


@dataclass(frozen=True, slots=True)
class Cue:
    """One subtitle.

    Attributes:
        begin: ns; None where it has a number but no line of times.
        end: ns, likewise.
        text: its lines, without the number.
    """

    begin: int | None
    end: int | None
    text: str


class SubtitleReader:
    """Reads subtitles line by line, in bounded memory.

    Attributes:
        broken: subtitles whose times cannot be read, and one that ends after its times.
    """

    def __init__(self) -> None:
        self.broken = 0
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
        if self._size <= LONGEST_TEXT:
            self._lines.append(line)
            self._size += len(line) + 1

    def _complete(self) -> Cue | None:
        """The subtitle of the lines so far; None where they are none."""
        times, lines = self._times, self._lines
        self._times, self._lines, self._size = None, [], 0
        if times is not None:
            parts = times.groups()
            return Cue(_ns(parts[:4]), _ns(parts[4:]), "\n".join(lines)[:LONGEST_TEXT])
        if any(ARROW in line for line in lines):
            self.broken += 1
            return None
        is_numbered = len(lines) > 1 and NUMBER.fullmatch(lines[0].strip()) is not None
        return Cue(None, None, "\n".join(lines[1:])[:LONGEST_TEXT]) if is_numbered else None


def subtitle_text(text: str) -> str:
    """The text of a subtitle packet: the last field of an ASS line, line breaks restored."""
    parts = text.split(",", 8)
    is_ass = len(parts) == 9 and parts[0].strip().isdigit()
    return (parts[8] if is_ass else text).replace("\\N", "\n")


def _ns(parts: tuple[str, ...]) -> int:
    hours, minutes, seconds = (int(part) for part in parts[:3])
    return ((hours * 60 + minutes) * 60 + seconds) * 1_000_000_000 + int(parts[3].ljust(3, "0")) * 1_000_000

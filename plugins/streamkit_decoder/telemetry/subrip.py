"""SubRip subtitles: texts with a beginning and an end, read from whatever a file holds."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

# Some aircraft write 00:00:60,000 for the end of a minute.
_TIME = r"(\d{1,3}):(\d{1,2}):(\d{1,2})[,.](\d{1,3})"
TIMES = re.compile(rf"^\s*{_TIME}\s*-->\s*{_TIME}")
LONGEST_TEXT = 4096


@dataclass(frozen=True, slots=True)
class Cue:
    """One subtitle.

    Attributes:
        begin: ns.
        end: ns.
        text: its lines.
    """

    begin: int
    end: int
    text: str


def read_cues(text: str) -> Iterator[Cue]:
    """The subtitles of a file, in its order; what is none is passed over."""
    times: re.Match[str] | None = None
    lines: list[str] = []
    for line in text.replace("\r\n", "\n").split("\n"):
        found = TIMES.match(line)
        if found is None and line.strip():
            lines.append(line)
            continue
        if times is not None:
            yield _cue(times, lines)
        times, lines = found, []
    if times is not None and lines:
        yield _cue(times, lines)


def _cue(times: re.Match[str], lines: list[str]) -> Cue:
    parts = times.groups()
    return Cue(_ns(parts[:4]), _ns(parts[4:]), "\n".join(lines)[:LONGEST_TEXT])


def _ns(parts: tuple[str, ...]) -> int:
    hours, minutes, seconds = (int(part) for part in parts[:3])
    return ((hours * 60 + minutes) * 60 + seconds) * 1_000_000_000 + int(parts[3].ljust(3, "0")) * 1_000_000
